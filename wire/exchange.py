"""The exchange message: what a node publishes to its neighbours in each exchange (the spy subscribes to the root's).

Cells keep messages as rows of arrays, because compiled code reads, writes, packs and unpacks them without creating a
Python object for each field (`wire.exchange_layout` defines the layout, `wire.exchange_reader` the checks). This module
is the Python side: the array types, the limits that a receiver enforces, and the words for the reasons to refuse a
message.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from genetics.arrays import Fitness, Genomes
from genetics.coding import Alphabet
from wire import exchange_layout as layout
from wire import exchange_reader
from wire.exchange_layout import HEADER, NEVER, VERSION, Header
from wire.strict import count, fields, fitness, of

__all__ = [
    "NEVER",
    "REASONS",
    "VERSION",
    "Champion",
    "Header",
    "Limits",
    "Messages",
]

# Upper bounds, not exact sizes: with every integer at its longest, the fields outside the list of emigrants take less
# than 100 bytes, and an emigrant takes 15 bytes beside its genome (array, length of the genome, float64).
_OVERHEAD = 256  # bytes of a message beside its genomes
_EACH = 24  # bytes of an emigrant beside its genome
# The compiled code knows only the numbers; the words end up in a node's warnings.
REASONS = {
    layout.TOO_LONG: "too long",
    layout.NOT_MSGPACK: "not msgpack",
    layout.NOT_AN_ARRAY: "not an array",
    layout.WRONG_SHAPE: "wrong shape",
    layout.WRONG_TYPE: "wrong type",
    layout.OUT_OF_BOUNDS: "out of bounds",
    layout.NOT_FINITE: "not finite",
    layout.OTHER_VERSION: "other version",
    layout.GENOME_TOO_LONG: "genome too long",
    layout.NO_SUCH_GENOME: "no such genome",
}


def most_bytes(genome_bytes: int, emigrants: int) -> int:
    """Return an upper bound, in bytes, of a valid message; the one genome beside the emigrants' is the champion's."""
    return _OVERHEAD + genome_bytes + emigrants * (_EACH + genome_bytes)


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


@dataclass(frozen=True)
class Limits:
    """What a receiver accepts in messages of its present job.

    Attributes:
        genome_bytes: the size of a genome, in bytes; in a message it may be shorter (see `Messages.encode`).
        emigrants: the exact number of emigrants in a message.
        cells: the number of cells; a champion's cell of birth must be below it.
        alphabet: which genomes the job's coding can make.
        most_state_bytes: the most bytes of a state that a message may carry; 0 if none may.
    """

    genome_bytes: int
    emigrants: int
    cells: int
    alphabet: Alphabet
    most_state_bytes: int = 0

    @property
    def most_bytes(self) -> int:
        """An upper bound, in bytes, of a valid message. A longer payload is refused before any of it is read."""
        return self.most_bytes_without_state + self.most_state_bytes

    @property
    def most_bytes_without_state(self) -> int:
        """An upper bound, in bytes, of a message without a state."""
        return most_bytes(self.genome_bytes, self.emigrants)


class Messages(NamedTuple):
    """``n`` messages as arrays, one message in each row.

    The shapes depend on the job alone, so a cell allocates all its rows when an epoch begins, and none in an exchange.

    Attributes:
        header: shape (n, HEADER), int64; `wire.exchange_layout` names the columns. ``stop_at`` is NEVER if no stop is
            known.
        genomes: shape (n, emigrants + 1, genome_bytes), uint8: the emigrants, best first, then the champion.
        fitness: shape (n, emigrants + 1), float64, in the order of ``genomes``. A champion's fitness of +inf means that
            the message has no champion.
    """

    header: Header
    genomes: Genomes
    fitness: Fitness

    @staticmethod
    def room(rows: int, genome_bytes: int, emigrants: int) -> "Messages":
        """Allocate ``rows`` empty messages: no champion, all other values zero or +inf."""
        return Messages(
            np.zeros((rows, HEADER), np.int64),
            np.zeros((rows, emigrants + 1, genome_bytes), np.uint8),
            np.full((rows, emigrants + 1), np.inf),
        )

    def copy(self) -> "Messages":
        """Return a copy that shares no memory with these messages."""
        return Messages._make(array.copy() for array in self)

    def decode(self, row: int, payload: bytes, limits: Limits) -> str | None:
        """Unpack a payload into one row. Return None, or why the message is refused: one of `REASONS`.

        The row of a refused message is partly overwritten, so decode only into a row that nothing reads yet.
        """
        code = exchange_reader.decode(payload, limits.most_bytes, limits.cells, *limits.alphabet, *self, row)
        return None if code == 0 else REASONS[-code]

    def champion(self, row: int) -> Champion | None:
        """Return the champion of one row, or None if it has none."""
        its_fitness = float(self.fitness[row, -1])
        if its_fitness == math.inf:
            return None
        header = self.header[row]
        born, birthplace = int(header[layout.BORN]), int(header[layout.BIRTHPLACE])
        return Champion(its_fitness, born, birthplace, self.genomes[row, -1].tobytes())
