"""Vectors of three numbers for compiled code. They are tuples, because arrays would be allocated on the heap."""

from typing import Any

from lowlevel.compiled import subroutine


@subroutine
def difference(begin: Any, end: Any) -> Any:
    """Return the vector from ``begin`` to ``end``."""
    return end[0] - begin[0], end[1] - begin[1], end[2] - begin[2]


@subroutine
def dot(one: Any, other: Any) -> Any:
    """Return the scalar product of two vectors."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


@subroutine
def cross(one: Any, other: Any) -> Any:
    """Return the vector product of two vectors."""
    return (
        one[1] * other[2] - one[2] * other[1],
        one[2] * other[0] - one[0] * other[2],
        one[0] * other[1] - one[1] * other[0],
    )
