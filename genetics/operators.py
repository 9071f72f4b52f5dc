"""Compiled functions that other compiled code calls by address: a coding's variation, a problem's fitness.

So one kernel can run a whole generation for any coding and any problem, without returning to Python in between. An
address also keeps the kernel that calls it independent of the problem: it is compiled and cached once for all kinds.

All functions of a kind have the same signature. What else a function needs (a world, bounds, lengths) it finds in its
table of pointers to arrays. Neither types nor bounds of these are checked: a table must fit its function.
"""

from math import prod
from typing import Any, NamedTuple

import numpy as np
from numba import carray, types  # type: ignore[attr-defined]
from numba.extending import intrinsic
from numpy.typing import NDArray

from genetics.arrays import Cells, Fitness, Genomes, writable
from genetics.compiled import kernel, subroutine

Table = NDArray[np.int64]  # (arrays, 3): address, rows, columns

TABLE = types.int64[:, ::1]
"""The type of a table, for signatures."""
FITNESS = types.void(types.uint8[:, ::1], types.float64[::1], TABLE)
"""Evaluate: genomes (n, genome_bytes), their fitness (n,) to be filled, and the table."""
MATING = types.void(types.uint8[:, :, ::1], types.uint8[:, ::1], types.uint64, types.int64, types.int64, TABLE)
"""Cross and mutate: couples (n, 2, genome_bytes), two offspring of each (2 * n, genome_bytes) to be filled, seed, cell,
generation, and the table."""
FOUNDING = types.void(types.uint8[:, ::1], types.uint64, types.int64, types.int64, TABLE)
"""Make a first deme: the deme (n, genome_bytes), all zeros, to be filled, seed, cell, generation, and the table."""
STRAYING = types.int64(types.uint8[:, ::1], types.uint64, types.int64, types.int64, TABLE)
"""Change one individual, by the one-bit rule: individuals (n, genome_bytes), seed, cell, generation, and the table.
Returns the index of the changed individual."""


class Operator(NamedTuple):
    """A compiled function of one of the signatures above, with its table.

    Attributes:
        function: the kernel, which Python can call.
        address: the address of its machine code, which compiled code can call. It is valid in this process and in those
            forked from it.
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
        kept = tuple(np.require(np.atleast_2d(_plain(each)), requirements=["C", "W"]) for each in own)
        table = pointers(*kept)
        (compiled,) = function.overloads.values()
        address = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
        return Operator(function, address, table, kept)

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


def _plain(value: Any) -> NDArray[Any]:
    array = np.asarray(value)
    return array.astype(np.float64 if array.dtype.kind == "f" else np.int64)


def _pointer(element: Any) -> Any:
    """Return an intrinsic that turns an address, an int64, into a pointer to ``element``: numba has no such cast."""
    kind: Any = types.CPointer
    kind = kind(element)

    @intrinsic
    def pointer(context: Any, address: Any) -> Any:

        def generate(target: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], target.get_value_type(kind))

        return kind(types.int64), generate

    return pointer


_pointer_to_real = _pointer(types.float64)
_pointer_to_integer = _pointer(types.int64)
_pointer_to_octet = _pointer(types.uint8)


@subroutine
def reals(table: Any, place: Any) -> Any:
    """Return the float64 array at a place of the table, shape (rows, columns): a number (1, 1), a vector (1, n)."""
    return carray(_pointer_to_real(table[place, 0]), (table[place, 1], table[place, 2]))


@subroutine
def integers(table: Any, place: Any) -> Any:
    """Return the int64 array at a place of the table, of a shape as in `reals`."""
    return carray(_pointer_to_integer(table[place, 0]), (table[place, 1], table[place, 2]))


@subroutine
def octets(table: Any, place: Any) -> Any:
    """Return the uint8 array at a place of the table, of a shape as in `reals`."""
    return carray(_pointer_to_octet(table[place, 0]), (table[place, 1], table[place, 2]))


@subroutine
def integers_at(address: Any, rows: Any, columns: Any) -> Any:
    """Return the int64 array at an address; a table itself can be one."""
    return carray(_pointer_to_integer(address), (rows, columns))


@subroutine
def octets_at(address: Any, size: Any) -> Any:
    """Return ``size`` bytes at an address as a uint8 array."""
    return carray(_pointer_to_octet(address), (size,))


@subroutine
def octets_of(payload: Any) -> Any:
    """Return the content of a ``bytes`` object as a uint8 array without a reference: the object must outlive it.

    Counting references, as numba does for an array from `np.frombuffer`, would take half of the time of reading.
    """
    counted = np.frombuffer(payload, np.uint8)
    return carray(_pointer_to_octet(counted.ctypes.data), counted.shape)


@subroutine
def blocks(table: Any, place: Any, rows: Any) -> Any:
    """Return the uint8 array at a place of the table as blocks of ``rows`` rows: shape (blocks, rows, columns)."""
    return carray(_pointer_to_octet(table[place, 0]), (table[place, 1] // rows, rows, table[place, 2]))


_intrinsic: Any = intrinsic  # callers omit the first argument (the context), which the type of `intrinsic` does not say


def _call(target: Any, builder: Any, arguments: Any, signature: Any) -> Any:
    """Generate a call of the function at the address ``arguments[0]`` with the other arguments.

    It follows numba's own calling convention, so the callee is an ordinary kernel. A C function would take arrays as
    bare pointers. The callee's status is dropped, so an exception in it would be lost: such functions must not raise.
    """
    convention = target.call_conv
    kind = convention.get_function_type(signature.return_type, signature.args)
    function = builder.inttoptr(arguments[0], kind.as_pointer())
    _, result = convention.call_function(builder, function, signature.return_type, signature.args, arguments[1:])
    return target.get_dummy_value() if signature.return_type == types.none else result


@_intrinsic  # type: ignore[untyped-decorator]
def call_fitness(context: Any, address: Any, genomes: Any, fitness: Any, table: Any) -> Any:
    """Call a function of signature FITNESS."""
    return types.void(types.int64, *FITNESS.args), lambda target, builder, _, arguments: _call(
        target, builder, arguments, FITNESS
    )


@_intrinsic  # type: ignore[untyped-decorator]
def call_mating(
    context: Any, address: Any, couples: Any, offspring: Any, seed: Any, cell: Any, generation: Any, table: Any
) -> Any:
    """Call a function of signature MATING."""
    return types.void(types.int64, *MATING.args), lambda target, builder, _, arguments: _call(
        target, builder, arguments, MATING
    )


@_intrinsic  # type: ignore[untyped-decorator]
def call_straying(
    context: Any, address: Any, individuals: Any, seed: Any, cell: Any, generation: Any, table: Any
) -> Any:
    """Call a function of signature STRAYING."""
    return types.int64(types.int64, *STRAYING.args), lambda target, builder, _, arguments: _call(
        target, builder, arguments, STRAYING
    )


@_intrinsic  # type: ignore[untyped-decorator]
def call_founding(context: Any, address: Any, deme: Any, seed: Any, cell: Any, generation: Any, table: Any) -> Any:
    """Call a function of signature FOUNDING."""
    return types.void(types.int64, *FOUNDING.args), lambda target, builder, _, arguments: _call(
        target, builder, arguments, FOUNDING
    )


# For many rows at once ------------------------------------------------------------------------------------------------
@kernel("void(int64, uint8[:,:,::1], uint64, int64[::1], int64, int64[:,::1])")
def found_rows(address: int, demes: Genomes, seed: np.uint64, cells: Cells, generation: int, table: Table) -> None:
    """Fill first demes (rows, deme, genome_bytes), each by the function of signature FOUNDING at ``address``."""
    for row in range(cells.size):
        call_founding(address, demes[row], seed, cells[row], generation, table)


@kernel("void(int64, uint8[:,:,:,::1], uint8[:,:,::1], uint64, int64[::1], int64, int64[:,::1])")
def mate_rows(
    address: int,
    couples: Genomes,
    offspring: Genomes,
    seed: np.uint64,
    cells: Cells,
    generation: int,
    table: Table,
) -> None:
    """Fill offspring (rows, 2 * n, bytes) of couples (rows, n, 2, bytes) by the function of signature MATING."""
    for row in range(cells.size):
        call_mating(address, couples[row], offspring[row], seed, cells[row], generation, table)
