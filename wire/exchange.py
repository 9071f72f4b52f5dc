"""The message that a node publishes to its neighbours in each exchange (and, at the root, to the spy).

Cells keep messages as arrays, which compiled code reads, writes, packs and unpacks.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from genetics.arrays import Fitness, Genomes
from genetics.coding import Alphabet
from wire import exchange_kernels as kernels
from wire.exchange_kernels import HEADER, NEVER, VERSION, Header
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

_OVERHEAD = 256  # bytes of a message beside its genomes, more than enough
_EACH = 24  # bytes of an emigrant beside its genome
REASONS = {
    kernels.TOO_LONG: "too long",
    kernels.NOT_MSGPACK: "not msgpack",
    kernels.NOT_AN_ARRAY: "not an array",
    kernels.WRONG_SHAPE: "wrong shape",
    kernels.WRONG_TYPE: "wrong type",
    kernels.OUT_OF_BOUNDS: "out of bounds",
    kernels.NOT_FINITE: "not finite",
    kernels.OTHER_VERSION: "other version",
    kernels.GENOME_TOO_LONG: "genome too long",
    kernels.NO_SUCH_GENOME: "no such genome",
}


def most_bytes(genome_bytes: int, emigrants: int) -> int:
    """The longest message that can be right."""
    return _OVERHEAD + genome_bytes + emigrants * (_EACH + genome_bytes)


class Champion(NamedTuple):
    """The best individual that a node has seen or heard of, ordered by (fitness, generation, cell)."""

    fitness: float
    generation: int
    cell: int
    genome: bytes

    @staticmethod
    def of(value: object) -> "Champion":
        """The champion in an unpacked report or command; whether its genome is one is for the receiver to ask.

        Raises:
            Rejected: whatever is wrong with it.
        """
        its_fitness, generation, cell, genome = fields(value, 4)
        return Champion(fitness(its_fitness), count(generation), count(cell), of(bytes, genome))


@dataclass(frozen=True)
class Limits:
    """What a receiver accepts for the job it is at.

    Attributes:
        genome_bytes: the bytes of a genome.
        emigrants: the exact number of emigrants in a message.
        cells: the number of cells.
        alphabet: what the job's genomes are made of.
    """

    genome_bytes: int
    emigrants: int
    cells: int
    alphabet: Alphabet

    @property
    def most_bytes(self) -> int:
        """The longest message that can be right."""
        return most_bytes(self.genome_bytes, self.emigrants)


class Messages(NamedTuple):
    """Messages as arrays; ``n`` of them.

    Attributes:
        header: shape (n, HEADER), the columns named in `wire.exchange_kernels`; ``stop_at`` is NEVER if there is none.
        genomes: (n, emigrants + 1, genome_bytes), the emigrants best first, then the champion.
        fitness: (n, emigrants + 1), theirs; a champion of +inf stands for none.
    """

    header: Header
    genomes: Genomes
    fitness: Fitness

    @staticmethod
    def room(rows: int, genome_bytes: int, emigrants: int) -> "Messages":
        """Room for that many."""
        return Messages(
            np.zeros((rows, HEADER), np.int64),
            np.zeros((rows, emigrants + 1, genome_bytes), np.uint8),
            np.full((rows, emigrants + 1), np.inf),
        )

    def copy(self) -> "Messages":
        """The same, in room of their own."""
        return Messages._make(array.copy() for array in self)

    def encode(self, row: int, champion: bool, out: Genomes) -> bytes:
        """One of them as msgpack, with its champion if wanted; ``out`` is room for the longest that can be right."""
        return out[: kernels.encode(*self, row, champion, out)].tobytes()

    def decode(self, row: int, payload: bytes, limits: Limits) -> str | None:
        """Unpack into one row. Returns None, or the reason why the message is refused (then the row holds anything)."""
        code = kernels.decode(payload, limits.most_bytes, limits.cells, *limits.alphabet, *self, row)
        return None if code == 0 else REASONS[-code]

    def champion(self, row: int) -> Champion | None:
        """The champion of one of them."""
        its_fitness = float(self.fitness[row, -1])
        if its_fitness == math.inf:
            return None
        header = self.header[row]
        born, birthplace = int(header[kernels.BORN]), int(header[kernels.BIRTHPLACE])
        return Champion(its_fitness, born, birthplace, self.genomes[row, -1].tobytes())
