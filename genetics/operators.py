"""Compiled functions that other compiled code calls by address: a coding's variation, a problem's fitness.

So one kernel can run a whole generation for any coding and any problem, without returning to Python in between. An
address also keeps the kernel that calls it independent of the problem: it is compiled and cached once for all kinds.

All functions of a kind have the same signature. What else a function needs (a world, bounds, lengths) it finds in its
table of pointers to arrays. Neither types nor bounds of these are checked: a table must fit its function.
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
"""The type of a table, for signatures."""
FITNESS = types.void(types.uint8[:, ::1], types.float64[::1], TABLE)
"""Evaluate: genomes (n, genome_bytes), their fitness (n,) to be filled, and the table."""
VARIATION = types.void(types.uint8[:, :, ::1], types.uint8[:, ::1], types.uint64, types.int64, types.int64, TABLE)
"""Cross and mutate: couples (n, 2, genome_bytes), two offspring of each (2 * n, genome_bytes) to be filled, seed, cell,
generation, and the table."""
INITIALISE = types.void(types.uint8[:, ::1], types.uint64, types.int64, types.int64, TABLE)
"""Make a first deme: the deme (n, genome_bytes), all zeros, to be filled, seed, cell, generation, and the table."""
MUTATE_ONE_BIT = types.int64(types.uint8[:, ::1], types.uint64, types.int64, types.int64, TABLE)
"""Change one individual, by the one-bit rule: individuals (n, genome_bytes), seed, cell, generation, and the table.
Returns the index of the changed individual."""


class Operator(NamedTuple):
    """A compiled function of one of the signatures above, with its table.

    Attributes:
        function: the kernel, which Python can call.
        address: the address of its machine code, which compiled code can call. It is valid in this process and in those
            forked from it; 0 where kernels must not be called by their addresses (`lowlevel.capabilities`).
        table: pointers to the arrays that belong to it, to be read with `reals`, `integers` and `octets`.
        kept: these arrays. A table holds no references, so the operator must outlive every use of its address.
    """

    function: Any
    address: int
    table: Table
    kept: tuple[NDArray[Any], ...]

    @staticmethod
    def of(function: Any, *own: Any) -> "Operator":
        """Return the operator of a kernel.

        Args:
            function: the kernel, with exactly one signature.
            own: the entries of its table, in order: numbers or arrays of at most two dimensions. Integers and booleans
                become int64, floats float64.
        """
        kept = _arrays_of(own)
        return Operator(function, _address_of(function), pointers(*kept), kept)

    def sharing(self, function: Any, *own: Any) -> "Operator":
        """Return the operator of another kernel: its table has the arrays of this one, not copies, and then its own."""
        kept = (*self.kept, *_arrays_of(own))
        return Operator(function, _address_of(function), pointers(*kept), kept)

    def fitness(self, genomes: Genomes) -> Fitness:
        """Evaluate genomes with a function of signature FITNESS: (n, genome_bytes) to (n,)."""
        values = np.empty(len(genomes))
        self.function(writable(genomes), values, self.table)
        return values


def pointers(*arrays: NDArray[Any]) -> Table:
    """Return a table of C-contiguous arrays. Of more than two dimensions, all but the last are merged into rows.

    The arrays must outlive the table.
    """
    assert all(each.flags.c_contiguous for each in arrays), "a pointer knows no strides"
    rows = [[each.ctypes.data, prod(each.shape[:-1]), each.shape[-1]] for each in arrays]
    return np.array(rows, np.int64).reshape(-1, 3)


def _arrays_of(own: tuple[Any, ...]) -> tuple[NDArray[Any], ...]:
    """Return copies of the entries of a table, as arrays of two dimensions that compiled code may write to."""
    return tuple(np.require(np.atleast_2d(_plain(each)), requirements=["C", "W"]) for each in own)


def _plain(value: Any) -> NDArray[Any]:
    array = np.asarray(value)
    return array.astype(np.float64 if array.dtype.kind == "f" else np.int64)


def _address_of(function: Any) -> int:
    if not capabilities().numba_calls:
        return 0
    from lowlevel.numba_calls import address_of

    return address_of(function)
