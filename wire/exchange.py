"""The exchange message: what a node publishes to its neighbours in each exchange (the spy subscribes to the root's).

Cells keep messages as rows of arrays, because compiled code reads, writes, packs and unpacks them without creating a
Python object for each field (`wire.exchange_layout` defines the layout, `wire.exchange_reader` the checks, and
`wire.limits` what a receiver accepts). This module is the Python side: the array types, and the words for the reasons
to refuse a message.
"""

import math
from typing import NamedTuple

import numpy as np

from genetics.arrays import Fitness, Genomes
from wire import exchange_layout as layout
from wire import exchange_reader
from wire.champion import Champion
from wire.exchange_layout import HEADER, NEVER, VERSION, Header
from wire.limits import Limits

__all__ = [
    "NEVER",
    "REASONS",
    "VERSION",
    "Header",
    "Messages",
]

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
