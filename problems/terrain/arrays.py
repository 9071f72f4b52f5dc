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
    """Where from and to and the rule of corners; K; the class of each cell; each class's cost of a step by heading.

    See `problems.terrain.walking.World`.
    """
    characters = np.array([list(row) for row in problem.map])
    present = [(char, name) for char, name in problem.legend.items() if np.any(characters == char)]
    classes = np.full(characters.shape, BLOCKED, np.int64)
    for place, (character, _) in enumerate(present):
        classes[characters == character] = place
    if problem.robot_radius > 0.5:
        classes[_near(classes == BLOCKED, problem.robot_radius)] = BLOCKED
    ranked = np.array([[_ranked(problem, name, heading) for heading in range(8)] for _, name in present])
    worst = np.sqrt(2.0) * max(characters.shape) ** 2 * ranked.max()
    lengths = np.where(np.arange(8) % 2 == 0, 1.0, np.sqrt(2.0))
    settings = np.array([*problem.start, *problem.goal, problem.corner_cutting], np.int64)
    return settings, np.array([worst]), classes, ranked * lengths


def _near(blocked: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """Cells whose centre is nearer than ``radius`` to one that is blocked, a square."""
    reach = int(np.ceil(radius))
    rows, columns = blocked.shape
    padded = np.pad(blocked, reach)
    near = np.zeros_like(blocked)
    for row in range(-reach, reach + 1):
        for column in range(-reach, reach + 1):
            if np.hypot(max(abs(row) - 0.5, 0.0), max(abs(column) - 0.5, 0.0)) < radius * (1.0 - 1e-12):
                near |= padded[reach + row : reach + row + rows, reach + column : reach + column + columns]
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
