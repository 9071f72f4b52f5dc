"""The exact optimum of a coordination diagram, by dynamic programming over its free cells.

The least time from a cell to the end is the minimum, over all cells to which a free rectangle leads, of the rectangle's
time plus the least time from there. For any number of synchronisation points (SPs), one pass over the cells in the
order of falling coordinates suffices. For at most n SPs there is one layer for each number of SPs.
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
    from problems.coordination.model import CoordinationModel

Seconds = NDArray[np.float64]  # (N1, N2)
Ends = NDArray[np.int64]  # (N1, N2): the index i * N2 + j of a rectangle's far corner, −1 if there is none
Points = list[tuple[int, int]]

MOST_CELLS = 1 << 18
"""The largest diagram, for which the worst case, with hardly any obstacles, takes some ten seconds."""


def solve_exactly(problem: CoordinationModel) -> Answer:
    """Return the least time of all sequences that the problem's coding can express.

    The figures hold a simple lower bound, the time of the slower path alone.

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
    # Fewer binary codes than cells: some SPs have no code, and the optimum may need them.
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
    """Return the least time from the first cell to the last, s, and SPs that take it; (inf, None) if there is no way.

    Args:
        blocked: the obstacle cells, shape (N1, N2).
        times_1: seconds of a move of robot 1 by 0, 1, .. cells, rest to rest; shape (N1,).
        times_2: the same for robot 2, shape (N2,).
        most_points: the greatest number of SPs; None for any number.
    """
    last_free = _last_free(blocked)
    after = np.full(blocked.shape, np.inf)  # with no rectangle left, only the end itself is a solution
    after[-1, -1] = 0.0
    layers: list[Ends] = []
    for _ in range(1 if most_points is None else most_points + 1):
        now, ends = after.copy(), np.full(blocked.shape, -1)
        _relax(last_free, times_1, times_2, now if most_points is None else after, now, ends)
        layers.append(ends)
        if most_points is not None and np.array_equal(now, after):
            break  # one more SP helps nowhere, so further ones do not, either
        after = now
    return float(after[0, 0]), _points(layers, most_points is None) if np.isfinite(after[0, 0]) else None


def _last_free(blocked: Mask) -> NDArray[np.int64]:
    """Return for each cell (i, j) the last index of the free run (i, j), (i, j + 1), ..; j − 1 if it is an obstacle."""
    columns = blocked.shape[1]
    first_blocked = np.where(blocked, np.arange(columns), columns)
    return np.ascontiguousarray(np.minimum.accumulate(first_blocked[:, ::-1], axis=1)[:, ::-1] - 1, np.int64)


@kernel(
    "void(int64[:,::1], float64[::1], float64[::1], float64[:,::1], float64[:,::1], int64[:,::1])", may_be_long=True
)
def _relax(last_free: Ends, times_1: Seconds, times_2: Seconds, after: Seconds, now: Seconds, ends: Ends) -> None:
    """Improve the least seconds ``now`` from each cell by one rectangle to a cell with the seconds ``after``.

    If both are the same array, the result is for any number of rectangles. ``ends`` receives the far corner of the best
    rectangle.
    """
    rows, columns = last_free.shape
    for i in range(rows - 1, -1, -1):
        for j in range(columns - 1, -1, -1):
            best, end = now[i, j], ends[i, j]
            top = columns - 1
            for k in range(i, rows):  # a rectangle of the rows i to k is free as far as all of these are
                top = min(top, last_free[k, j])
                if top < j:
                    break
                for to in range(j, top + 1):
                    seconds = max(times_1[k - i], times_2[to - j]) + after[k, to]
                    if seconds < best:
                        best, end = seconds, k * columns + to
            now[i, j], ends[i, j] = best, end


def _points(layers: list[Ends], same: bool) -> Points:
    """Return the cells at which the rectangles of the best sequence end, without the last cell.

    Args:
        layers: for each layer the far corners of the best rectangles; the last layer allows the most of them.
        same: whether one layer serves any number of rectangles.
    """
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
