"""The exact optimum of a coordination diagram, by dynamic programming over its free cells: no genetic algorithm here.

The least time from a cell to the end is the least, over all cells to which a free rectangle leads, of that rectangle's
time and the least time from there. Cells in the order of falling coordinates give that for any number of
synchronisation points (SPs) at once; for at most n of them, each layer allows one more than the one before.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lowlevel.compiled import kernel
from problems.coordination.diagram import Mask
from problems.errors import BadInput
from problems.problem import Answer

if TYPE_CHECKING:
    from problems.coordination.problem import Coordination

Seconds = NDArray[np.float64]  # (N1, N2)
Ends = NDArray[np.int64]  # (N1, N2): the index i * N2 + j of a rectangle's far corner, −1 if there is none
Points = list[tuple[int, int]]

MOST_CELLS = 1 << 18
"""As many take some ten seconds where hardly anything is in the way."""


def solve_exactly(problem: Coordination) -> Answer:
    """The least time of all sequences that the problem's coding holds, and the time of the slower path alone.

    Raises:
        BadInput: if the diagram is too large.
    """
    cells = problem.blocked.size
    if cells > MOST_CELLS:
        raise BadInput(f"dynamic programming: expected at most {MOST_CELLS} cells, found {cells}")
    times = problem.move_times
    if problem.individuals == "variable":
        most, limit = None, "any number of synchronisation points"
    else:
        most, limit = problem.points, f"at most {problem.points} synchronisation points"
    fitness, points = least_time(problem.blocked, *times, most)
    coded_all = problem.individuals != "binary" or max(problem.blocked.shape) <= 1 << problem.bits
    return Answer(
        "optimum" if coded_all else "lower bound",
        fitness,
        f"dynamic programming over the free rectangles, {limit}",
        None if points is None else {"time": fitness, "points": [list(point) for point in points]},
        {"time of the slower path alone": float(max(times[0][-1], times[1][-1]))},
    )


def least_time(
    blocked: Mask, times_1: Seconds, times_2: Seconds, most_points: int | None
) -> tuple[float, Points | None]:
    """The least seconds from the first cell to the last, and SPs that take them; (inf, None) if there is no way.

    Args:
        blocked: the obstacle cells, shape (N1, N2).
        times_1: seconds of a move of robot 1 by 0, 1, .. cells, rest to rest; shape (N1,).
        times_2: likewise of robot 2.
        most_points: how many SPs there may be; None for any number.
    """
    last_free = _last_free(blocked)
    after = np.full(blocked.shape, np.inf)  # with no rectangle left, one must be at the end
    after[-1, -1] = 0.0
    layers: list[Ends] = []
    for _ in range(1 if most_points is None else most_points + 1):
        now, ends = after.copy(), np.full(blocked.shape, -1)
        _relax(last_free, times_1, times_2, now if most_points is None else after, now, ends)
        layers.append(ends)
        if most_points is not None and np.array_equal(now, after):
            break
        after = now
    return float(after[0, 0]), _points(layers, most_points is None) if np.isfinite(after[0, 0]) else None


def _last_free(blocked: Mask) -> NDArray[np.int64]:
    """For each cell (i, j) the last index of the free run (i, j), (i, j + 1), .., or j − 1 if it is an obstacle."""
    columns = blocked.shape[1]
    first_blocked = np.where(blocked, np.arange(columns), columns)
    return np.ascontiguousarray(np.minimum.accumulate(first_blocked[:, ::-1], axis=1)[:, ::-1] - 1, np.int64)


@kernel(
    "void(int64[:,::1], float64[::1], float64[::1], float64[:,::1], float64[:,::1], int64[:,::1])", may_be_long=True
)
def _relax(last_free: Ends, times_1: Seconds, times_2: Seconds, after: Seconds, now: Seconds, ends: Ends) -> None:
    """The least seconds from each cell ``now``, if one rectangle leads from it to a cell whose seconds are ``after``.

    Both may be one array: then any number of rectangles. ``now`` is improved, and ``ends`` says by which rectangle.
    """
    rows, columns = last_free.shape
    for i in range(rows - 1, -1, -1):
        for j in range(columns - 1, -1, -1):
            best, end = now[i, j], ends[i, j]
            top = columns - 1
            for k in range(i, rows):
                top = min(top, last_free[k, j])
                if top < j:
                    break
                for to in range(j, top + 1):
                    seconds = max(times_1[k - i], times_2[to - j]) + after[k, to]
                    if seconds < best:
                        best, end = seconds, k * columns + to
            now[i, j], ends[i, j] = best, end


def _points(layers: list[Ends], same: bool) -> Points:
    """The cells at which the rectangles from the first cell end, but for the last cell."""
    columns = layers[0].shape[1]
    cell, last = (0, 0), (layers[0].shape[0] - 1, columns - 1)
    layer, points = len(layers) - 1, []
    while cell != last:
        end = int(layers[layer][cell])
        if not same:
            layer -= 1
        if end >= 0:
            cell = divmod(end, columns)
            points.append(cell)
    return points[:-1]
