"""Subroutines on sequences of synchronisation points (SPs) and on the coordination diagram, §3.2.

The fitness (`kernels`) and the operators (`coding_kernels`) are compiled with them. A sequence is an array ``points``
of SPs, int64 of shape (room, 2), and its ``count``. It does not include the start (0, 0) and the end
(N1 − 1, N2 − 1). A summed-area table counts the obstacles of a rectangle in constant time.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from genetics.sequence_kernels import clear_after
from lowlevel.compiled import subroutine
from lowlevel.pointers import integers, reals

Points = NDArray[np.int64]  # (n, 2)


class Diagram(NamedTuple):
    """The coordination diagram and the robots' move times."""

    last: Any  # (2,): N1 − 1, N2 − 1
    times_1: Any  # (N1,), s
    times_2: Any  # (N2,), s
    sums: Any  # (N1 + 1, N2 + 1): obstacle cells with smaller indices in both


@subroutine
def diagram_of(table: Any, first: Any) -> Any:
    """Return the diagram in three places of the table, from ``first`` on."""
    times_1, times_2 = reals(table, first)[0], reals(table, first + 1)[0]
    last = np.array([times_1.size - 1, times_2.size - 1])
    return Diagram(last, times_1, times_2, integers(table, first + 2))


@subroutine
def coordinate(points: Any, count: Any, place: Any, axis: Any, diagram: Any) -> Any:
    """Return a coordinate of an SP, or of the start (place −1) or the end (place ``count``)."""
    if place < 0:
        return np.int64(0)
    return points[place, axis] if place < count else diagram.last[axis]


@subroutine
def repair(points: Any, count: Any) -> Any:
    """Make SPs increase in both coordinates: from the last to the first, a greater coordinate takes the next SP's.

    This is the repair of §3.2, restrictions.
    """
    for place in range(count - 2, -1, -1):
        for axis in range(2):
            points[place, axis] = min(points[place, axis], points[place + 1, axis])


@subroutine
def read(numbers: Any, points: Any) -> Any:
    """Fill ``points`` from the numbers of a genome, repaired, and return their count."""
    count = np.int64(numbers[0])
    for place in range(count):
        points[place, 0], points[place, 1] = numbers[1 + 2 * place], numbers[2 + 2 * place]
    repair(points, count)
    return count


@subroutine
def write(points: Any, count: Any, numbers: Any) -> Any:
    """Write the points to the numbers of a genome, and clear the rest: equal individuals must be equal bytes."""
    clear_after(numbers, count, 2)
    for place in range(count):
        numbers[1 + 2 * place], numbers[2 + 2 * place] = points[place, 0], points[place, 1]


@subroutine
def rectangle(diagram: Any, left: Any, bottom: Any, right: Any, top: Any) -> Any:
    """Return the seconds that a rectangle takes, and its obstacle cells; both corner cells belong to it."""
    sums = diagram.sums
    obstacles = sums[right + 1, top + 1] - sums[left, top + 1] - sums[right + 1, bottom] + sums[left, bottom]
    return max(diagram.times_1[right - left], diagram.times_2[top - bottom]), obstacles


@subroutine
def measure(points: Any, count: Any, diagram: Any) -> Any:
    """Return the seconds that a sequence takes, and the obstacle cells of all its rectangles (§3.2, fitness).

    A cell counts once in each rectangle that contains it. Two SPs at the same cell have no rectangle between them.
    """
    time, obstacles = 0.0, np.int64(0)
    left, bottom = np.int64(0), np.int64(0)
    for place in range(count + 1):
        right, top = coordinate(points, count, place, 0, diagram), coordinate(points, count, place, 1, diagram)
        if right > left or top > bottom:
            seconds, hit = rectangle(diagram, left, bottom, right, top)
            time, obstacles = time + seconds, obstacles + hit
        left, bottom = right, top
    return time, obstacles
