"""A memo of segments: whether each was proven free, so that what made a path, and then its fitness, prove it once.

It is an array in the table of all operators of a problem. Each row has the bits of both ends, the answer and a check
number. The answer depends on the ends only, so results are the same with any memo, and whatever another thread has
overwritten: the check number does not fit to a row of two writers.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lowlevel.compiled import subroutine

UNKNOWN, IS_BLOCKED, IS_FREE = 0, 1, 2
_ROWS = 2048  # segments; some hundred are proven in a generation
_PRIME, _BASIS = np.uint64(0x100000001B3), np.uint64(0xCBF29CE484222325)  # FNV-1a


def new_memo(joints: int) -> NDArray[np.int64]:
    """Return an empty memo, shape (rows, 2 * joints + 2)."""
    return np.zeros((_ROWS, 2 * joints + 2), np.int64)


@subroutine
def key_of(one: Any, other: Any) -> Any:
    """Return a number that stands for two configurations, in any order."""
    first, second = _BASIS, _BASIS
    for joint in range(one.size):
        first = (first ^ np.float64(one[joint]).view(np.uint64)) * _PRIME
        second = (second ^ np.float64(other[joint]).view(np.uint64)) * _PRIME
    key = first + second
    return key ^ (key >> np.uint64(29))


@subroutine
def _check_of(key: Any, answer: Any) -> Any:
    return np.int64((key + np.uint64(answer)) * _PRIME)


@subroutine
def _is_at(row: Any, place: Any, point: Any) -> Any:
    for joint in range(point.size):  # noqa: SIM110 - compiled code has no generators
        if row[place + joint] != np.float64(point[joint]).view(np.int64):
            return False
    return True


@subroutine
def recall(memo: Any, key: Any, one: Any, other: Any) -> Any:
    """Return `IS_FREE`, `IS_BLOCKED`, or `UNKNOWN` for the segment between two configurations with that key."""
    row, joints = memo[np.int64(key % np.uint64(memo.shape[0]))], one.size
    answer = row[2 * joints]
    if row[2 * joints + 1] != _check_of(key, answer):
        return UNKNOWN
    if _is_at(row, 0, one) and _is_at(row, joints, other):
        return answer
    if _is_at(row, 0, other) and _is_at(row, joints, one):
        return answer
    return UNKNOWN


@subroutine
def remember(memo: Any, key: Any, one: Any, other: Any, answer: Any) -> Any:
    """Write the answer for a segment in the place of an older one."""
    row, joints = memo[np.int64(key % np.uint64(memo.shape[0]))], one.size
    for joint in range(joints):
        row[joint] = np.float64(one[joint]).view(np.int64)
        row[joints + joint] = np.float64(other[joint]).view(np.int64)
    row[2 * joints], row[2 * joints + 1] = answer, _check_of(key, answer)
