"""Convert a map and its difficulties into the arrays that the kernels take."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLOCKED = -1  # the class of impassable cells


def world_arrays(
    rows: Sequence[str],
    legend: Mapping[str, str],
    difficulty: Callable[[str, int], float],
    settings: Sequence[int],
    radius: float,
    clearance: float,
) -> tuple[NDArray[Any], ...]:
    """Return the fields of `problems.terrain.walking.World`, in its order.

    They are the settings, the penalty K, the classes of the cells, the costs of steps, and the closed corners.

    Args:
        rows: the rows of the map.
        legend: the name of the difficulty of each character that is passable.
        difficulty: returns a difficulty as one number, by its name and the heading, 0 to 7.
        settings: the cells of start and goal, and whether paths may cut corners.
        radius: the robot's radius, in cells.
        clearance: the distance that the robot keeps from obstacles, in cells.
    """
    characters = np.array([list(row) for row in rows])
    # Only what is on the map: K is made of the highest difficulty that occurs.
    present = [(char, name) for char, name in legend.items() if np.any(characters == char)]
    classes = np.full(characters.shape, BLOCKED, np.int64)
    for place, (character, _) in enumerate(present):
        classes[characters == character] = place
    height, width = characters.shape
    obstacles, least = classes == BLOCKED, radius + clearance
    if least > 0.5:  # the centre of a free cell is never nearer than half a cell to another cell
        classes[_near(obstacles, least, (height, width), 0.5)] = BLOCKED
    # Half-way, a diagonal step passes a corner of cells. With a clearance it may be too near to an obstacle there, even
    # where both of its ends are free.
    corners = np.zeros((0, 0), np.int64)
    if clearance > 0.0:
        corners = _near(obstacles, least, (height + 1, width + 1), 0.0).astype(np.int64)
    ranked = np.array([[difficulty(name, heading) for heading in range(8)] for _, name in present])
    # K of §3.4, with difficulties ranked as numbers.
    worst = np.sqrt(2.0) * max(characters.shape) ** 2 * ranked.max()
    # Odd headings are diagonals.
    lengths = np.where(np.arange(8) % 2 == 0, 1.0, np.sqrt(2.0))
    return np.array(settings, np.int64), np.array([worst]), classes, ranked * lengths, corners


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
