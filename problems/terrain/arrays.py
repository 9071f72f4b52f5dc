"""Convert a terrain problem into the arrays that its kernels take."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from problems.terrain.model import Terrain

BLOCKED = -1  # the class of impassable cells
HEADINGS = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")  # heading k is k·π/4, anticlockwise


def world_arrays(problem: Terrain) -> tuple[NDArray[Any], ...]:
    """Return the fields of `problems.terrain.walking.World`, in its order.

    They are the settings, the penalty K, the classes of the cells, the costs of steps, and the closed corners.
    """
    characters = np.array([list(row) for row in problem.map])
    # Only what is on the map: K is made of the highest difficulty that occurs.
    present = [(char, name) for char, name in problem.legend.items() if np.any(characters == char)]
    classes = np.full(characters.shape, BLOCKED, np.int64)
    for place, (character, _) in enumerate(present):
        classes[characters == character] = place
    rows, columns = characters.shape
    obstacles, least = classes == BLOCKED, problem.robot_radius + problem.clearance
    if least > 0.5:  # the centre of a free cell is never nearer than half a cell to another cell
        classes[_near(obstacles, least, (rows, columns), 0.5)] = BLOCKED
    # Half-way, a diagonal step passes a corner of cells. With a clearance it may be too near to an obstacle there, even
    # where both of its ends are free.
    corners = np.zeros((0, 0), np.int64)
    if problem.clearance > 0.0:
        corners = _near(obstacles, least, (rows + 1, columns + 1), 0.0).astype(np.int64)
    ranked = np.array([[_ranked(problem, name, heading) for heading in range(8)] for _, name in present])
    # K of §3.4, with difficulties ranked as numbers.
    worst = np.sqrt(2.0) * max(characters.shape) ** 2 * ranked.max()
    # Odd headings are diagonals.
    lengths = np.where(np.arange(8) % 2 == 0, 1.0, np.sqrt(2.0))
    settings = np.array([*problem.start, *problem.goal, problem.corner_cutting], np.int64)
    return settings, np.array([worst]), classes, ranked * lengths, corners


def _near(blocked: NDArray[np.bool_], radius: float, shape: tuple[int, int], into: float) -> NDArray[np.bool_]:
    """Return which points come nearer than ``radius`` to a blocked cell, a square of side 1.

    Args:
        blocked: Whether each cell is blocked, (rows, columns).
        radius: The distance, in cells.
        shape: The shape of the grid of points, which is as fine as the cells.
        into: The place of the first point within the first cell, along rows and columns: 0.5 for its centre, 0 for its
            first corner.
    """
    reach = int(np.ceil(radius)) + 1
    offsets = np.arange(-reach, reach + 1)  # between the number of a cell and that of the point, along rows or columns
    gaps = np.maximum(np.maximum(offsets - into, into - 1.0 - offsets), 0.0)
    # In each row of cells the near ones are a range. Prefix sums tell whether any cell of a range is blocked, for all
    # points at once: the count of blocked cells before the range differs from that before its end.
    padded = np.pad(blocked, ((reach, reach + 1), (reach, reach + 1)))
    before = np.pad(np.cumsum(padded, axis=1, dtype=np.int32), ((0, 0), (1, 0)))
    near = np.zeros(shape, np.bool_)
    for row, gap in enumerate(gaps):
        columns = np.flatnonzero(np.hypot(gap, gaps) < radius * (1.0 - 1e-12))
        if len(columns):
            counts, first, last = before[row : row + shape[0]], int(columns[0]), int(columns[-1]) + 1
            near |= counts[:, last : last + shape[1]] > counts[:, first : first + shape[1]]
    return near


def _ranked(problem: Terrain, name: str, heading: int) -> float:
    """Return a difficulty for a heading as one number, by the problem's rank."""
    a, b, c = _triangle(problem, name, heading)
    match problem.rank:
        case "pessimistic":
            return c
        case "optimistic":
            return a
        case _:
            return (a + b + c) / 3.0


def _triangle(problem: Terrain, name: str, heading: int) -> tuple[float, float, float]:
    difficulty = problem.difficulties[name]
    if isinstance(difficulty, tuple):
        return difficulty
    off = abs((heading - HEADINGS.index(difficulty.uphill) + 4) % 8 - 4)  # eighths of a turn from uphill
    return difficulty.up if off < 2 else difficulty.across if off == 2 else difficulty.down
