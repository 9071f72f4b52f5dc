"""The message that a node publishes to its neighbours in each exchange (and, at the root, to the spy)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from wire.strict import Rejected, count, fields, fitness, of, pack, unpack

VERSION = 1
_FIELDS = 8
_OVERHEAD = 256  # bytes of a message beside its genomes, more than enough
_EACH = 24  # bytes of an emigrant beside its genome


class Emigrant(NamedTuple):
    """An individual on its way to a neighbour."""

    genome: bytes
    fitness: float


class Champion(NamedTuple):
    """The best individual that a node has seen or heard of, ordered by (fitness, generation, cell)."""

    fitness: float
    generation: int
    cell: int
    genome: bytes

    @staticmethod
    def of(value: object) -> "Champion":
        """The champion in an unpacked message; whether its genome is one is for the receiver to ask.

        Raises:
            Rejected: whatever is wrong with it.
        """
        its_fitness, generation, cell, genome = fields(value, 4)
        return Champion(fitness(its_fitness), count(generation), count(cell), of(bytes, genome))


@dataclass(frozen=True, slots=True)
class Exchange:
    """One node's news of one generation.

    Attributes:
        job: number of the job.
        world: number of the world that the fitness values belong to.
        generation: of the sender.
        stop_at: the least generation of a stop that the sender knows, None if nobody proposed one.
        emigrants: its best individuals, best first.
        champion: None under the paper's spy, or while nothing feasible is known.
        sent: how many messages the sender has published for this job, this one included.
        evaluations: how many fitness calls it has made.
    """

    job: int
    world: int
    generation: int
    stop_at: int | None
    emigrants: tuple[Emigrant, ...]
    champion: Champion | None
    sent: int
    evaluations: int

    def encode(self) -> bytes:
        """As msgpack."""
        return pack(
            (
                VERSION,
                self.job,
                self.world,
                self.generation,
                self.stop_at,
                self.emigrants,
                self.champion,
                (self.sent, self.evaluations),
            )
        )


@dataclass(frozen=True)
class Limits:
    """What a receiver accepts for the job it is at.

    Attributes:
        genome_bytes: the most bytes of a genome.
        emigrants: the exact number of emigrants in a message.
        cells: the number of cells.
        accepts: whether a genome is one that the job's coding could have made.
    """

    genome_bytes: int
    emigrants: int
    cells: int
    accepts: Callable[[bytes], bool]

    @property
    def most_bytes(self) -> int:
        """The longest message that can be right."""
        return _OVERHEAD + self.genome_bytes + self.emigrants * (_EACH + self.genome_bytes)


def decode(payload: bytes, limits: Limits) -> Exchange:
    """The message in ``payload``.

    Raises:
        Rejected: whatever is wrong with it; nothing else is ever raised.
    """
    version, job, world, generation, stop_at, emigrants, champion, counters = fields(
        unpack(payload, limits.most_bytes, max(_FIELDS, limits.emigrants)), _FIELDS
    )
    if version != VERSION or type(version) is not int:
        raise Rejected("other version")
    sent, evaluations = fields(counters, 2)
    return Exchange(
        count(job),
        count(world),
        count(generation),
        None if stop_at is None else count(stop_at),
        tuple(_emigrant(each, limits) for each in fields(emigrants, limits.emigrants)),
        None if champion is None else _champion(champion, limits),
        count(sent),
        count(evaluations),
    )


def _emigrant(value: Any, limits: Limits) -> Emigrant:
    genome, its_fitness = fields(value, 2)
    return Emigrant(_genome(genome, limits), fitness(its_fitness))


def _champion(value: Any, limits: Limits) -> Champion:
    champion = Champion.of(value)
    count(champion.cell, limits.cells)
    _genome(champion.genome, limits)
    return champion


def _genome(value: Any, limits: Limits) -> bytes:
    genome = of(bytes, value)
    if len(genome) > limits.genome_bytes:
        raise Rejected("genome too long")
    if not limits.accepts(genome):
        raise Rejected("no such genome")
    return genome
