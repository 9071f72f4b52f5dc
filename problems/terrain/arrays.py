"""The world of a terrain problem as the arrays that its kernels take."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from problems.terrain.problem import Terrain

BLOCKED = -1
HEADINGS = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")  # k·π/4, anticlockwise


def world_arrays(problem: Terrain) -> tuple[NDArray[Any], ...]:
    """Return where from and to and the rule of corners; K; cells' classes; steps' costs; the corners that are closed.

    See `problems.terrain.walking.World`.
    """
    characters = np.array([list(row) for row in problem.map])
    present = [(char, name) for char, name in problem.legend.items() if np.any(characters == char)]
    classes = np.full(characters.shape, BLOCKED, np.int64)
    for place, (character, _) in enumerate(present):
        classes[characters == character] = place
    rows, columns = characters.shape
    obstacles, least = classes == BLOCKED, problem.robot_radius + problem.clearance
    if least > 0.5:
        classes[_near(obstacles, least, (rows, columns), 0.5)] = BLOCKED
    corners = np.zeros((0, 0), np.int64)
    if problem.clearance > 0.0:
        corners = _near(obstacles, least, (rows + 1, columns + 1), 0.0).astype(np.int64)
    ranked = np.array([[_ranked(problem, name, heading) for heading in range(8)] for _, name in present])
    worst = np.sqrt(2.0) * max(characters.shape) ** 2 * ranked.max()
    lengths = np.where(np.arange(8) % 2 == 0, 1.0, np.sqrt(2.0))
    settings = np.array([*problem.start, *problem.goal, problem.corner_cutting], np.int64)
    return settings, np.array([worst]), classes, ranked * lengths, corners


def _near(blocked: NDArray[np.bool_], radius: float, shape: tuple[int, int], into: float) -> NDArray[np.bool_]:
    """Which points come nearer than ``radius`` to a blocked cell, a square of side 1.

    Args:
        blocked: cells, (rows, columns).
        radius: in cells.
        shape: of the points, a grid as fine as the cells.
        into: where the first point lies in the first cell, along rows and columns: 0.5 its centre, 0 its first corner.
    """
    reach = int(np.ceil(radius)) + 1
    offsets = np.arange(-reach, reach + 1)  # of cells from that of the same number as the point
    gaps = np.maximum(np.maximum(offsets - into, into - 1.0 - offsets), 0.0)
    # Of each row of cells those that are near are a range: one is blocked if the count of those before changes in it.
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
    """A difficulty as one number."""
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
