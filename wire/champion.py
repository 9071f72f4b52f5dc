"""The best individual that a cell knows of, as messages of all kinds tell it."""

from typing import NamedTuple

from wire.strict import count, fields, fitness, of


class Champion(NamedTuple):
    """The best individual that a cell knows of: one that it bred or one that arrived in a message.

    The field order is the order of comparison: (fitness, generation, cell). Generation and cell are those of birth, so
    the order is total, and all cells agree on the champion whatever the order in which messages arrive.
    """

    fitness: float
    generation: int
    cell: int
    genome: bytes

    @staticmethod
    def of(value: object) -> "Champion":
        """Return the champion in an unpacked report or command.

        The genome is only checked to be bytes. Whether the job's coding could have made it, the receiver must check.

        Raises:
            Rejected: if ``value`` is not a valid champion.
        """
        its_fitness, generation, cell, genome = fields(value, 4)
        return Champion(fitness(its_fitness), count(generation), count(cell), of(bytes, genome))
