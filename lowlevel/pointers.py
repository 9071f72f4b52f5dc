"""Arrays at addresses: how compiled code reads tables of pointers, and memory that CPython or the kernel owns.

An address keeps nothing alive. Whoever makes a table keeps its arrays; see `genetics.operators.pointers`.
"""

from typing import Any

import numpy as np
from numba import carray, types  # type: ignore[attr-defined]
from numba.extending import intrinsic

from lowlevel.compiled import subroutine


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
