"""Compiled functions that other compiled code calls by address: a coding's variation, a problem's fitness.

So one kernel can carry a whole generation out, whatever the coding and the problem are, and without a step into Python
between them. What a function needs beside its arguments (a world, bounds, lengths) is a table of pointers to arrays.
"""

from math import prod
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from genetics.arrays import Fitness, Genomes, writable
from lowlevel import capabilities

Table = NDArray[np.int64]  # (arrays, 3): address, rows, columns

TABLE = types.int64[:, ::1]
"""A table's type, for signatures."""
FITNESS = types.void(types.uint8[:, ::1], types.float64[::1], TABLE)
"""Genomes (n, genome_bytes), their fitness (n,) to be filled, and the table."""
MATING = types.void(types.uint8[:, :, ::1], types.uint8[:, ::1], types.uint64, types.int64, types.int64, TABLE)
"""Couples (n, 2, genome_bytes), two offspring of each (2 * n, genome_bytes) to be filled, seed, cell, generation, and
the table."""
FOUNDING = types.void(types.uint8[:, ::1], types.uint64, types.int64, types.int64, TABLE)
"""A first deme (n, genome_bytes) to be filled, zeros before, seed, cell, generation, and the table."""
STRAYING = types.int64(types.uint8[:, ::1], types.uint64, types.int64, types.int64, TABLE)
"""Individuals (n, genome_bytes) one of which is changed, seed, cell, generation, and the table; returns which."""


class Operator(NamedTuple):
    """A compiled function of one of the signatures above.

    Attributes:
        function: the kernel, for Python to call.
        address: where its code is; 0 where kernels must not be called by their addresses (`lowlevel.capabilities`).
        table: its own arrays, for `reals` and `integers`.
        kept: those arrays, which must live as long as the operator.
    """

    function: Any
    address: int
    table: Table
    kept: tuple[NDArray[Any], ...]

    @staticmethod
    def of(function: Any, *own: Any) -> "Operator":
        """A kernel, with numbers and arrays of at most two dimensions: integers and booleans, or float64."""
        kept = tuple(np.require(np.atleast_2d(_plain(each)), requirements=["C", "W"]) for each in own)
        table = pointers(*kept)
        return Operator(function, _address_of(function), table, kept)

    def fitness(self, genomes: Genomes) -> Fitness:
        """Call a function of signature FITNESS: (n, genome_bytes) to (n,)."""
        values = np.empty(len(genomes))
        self.function(writable(genomes), values, self.table)
        return values


def pointers(*arrays: NDArray[Any]) -> Table:
    """A table of arrays that lie in one piece, of any number of dimensions: it remembers all but the last as rows.

    The arrays must outlive the table.
    """
    assert all(each.flags.c_contiguous for each in arrays), "a pointer knows no strides"
    rows = [[each.ctypes.data, prod(each.shape[:-1]), each.shape[-1]] for each in arrays]
    return np.array(rows, np.int64).reshape(-1, 3)


def _plain(value: Any) -> NDArray[Any]:
    array = np.asarray(value)
    return array.astype(np.float64 if array.dtype.kind == "f" else np.int64)


def _address_of(function: Any) -> int:
    if not capabilities().numba_calls:
        return 0
    from lowlevel.numba_calls import address_of

    return address_of(function)
