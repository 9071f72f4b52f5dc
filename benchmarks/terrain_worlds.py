"""Random terrain.

The same number gives the same world. No recipe was tuned on the numbers that the benchmark uses.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from problems.terrain import Terrain

Cells = NDArray[np.bool_]
DIFFICULTIES = "emd"  # characters of easy, moderate, difficult
MOST_TRIES = 1000


def terrain_world(number: int, side: int) -> Terrain:
    """Return world ``number`` of ``side`` x ``side`` cells: rooms with doors, clutter, or caves, in turn.

    Half of the passable cells are easy, moderate or difficult, in patches. The start and the goal are at least half a
    side apart, and a way exists between them. In half of the worlds the way may cut corners.
    """
    generator = np.random.default_rng([2004, side, number])
    for _ in range(MOST_TRIES):
        blocked = [_rooms, _clutter, _caves][number % 3](generator, side)
        cuts = bool(number // 3 % 2)
        start, goal = (tuple(int(each) for each in place) for place in generator.integers(0, side, (2, 2)))
        if np.hypot(*np.subtract(start, goal)) < side / 2 or not _is_way(blocked, start, goal, cuts):
            continue
        return Terrain.model_validate(
            {
                "kind": "terrain",
                "start": start,
                "goal": goal,
                "map": _map(generator, blocked),
                "terrain": {"e": "easy", "m": "moderate", "d": "difficult"},
                "corner_cutting": cuts,
            }
        )
    raise RuntimeError(f"no world {number} with a way in {MOST_TRIES} tries")


def _map(generator: np.random.Generator, blocked: Cells) -> list[str]:
    """Return the rows of the map: half of the free cells are clear, the others have one of three difficulties."""
    noise = ndimage.gaussian_filter(generator.normal(size=blocked.shape), max(1.5, len(blocked) / 24))
    ranks = np.searchsorted(np.quantile(noise, [0.5, 2 / 3, 5 / 6]), noise)
    characters = np.array(list("." + DIFFICULTIES))[ranks]
    characters[blocked] = "@"
    return ["".join(row) for row in characters]


def _is_way(blocked: Cells, start: tuple[int, ...], goal: tuple[int, ...], cuts: bool) -> bool:
    regions, _ = ndimage.label(~blocked, np.ones((3, 3)) if cuts else None)
    return bool(regions[start] > 0 and regions[start] == regions[goal])


def _rooms(generator: np.random.Generator, side: int) -> Cells:
    """Return the blocked cells of rooms, by repeated halving of the largest room; each new wall has a door."""
    blocked = np.zeros((side, side), bool)
    rooms = [(0, 0, side, side)]
    for _ in range(int(generator.integers(3, 4 + side // 8))):
        rooms.sort(key=lambda room: (room[2] - room[0]) * (room[3] - room[1]))
        top, left, bottom, right = rooms.pop()
        height, width = bottom - top, right - left
        if max(height, width) < 5:
            continue
        if height > width:
            at = int(generator.integers(top + 2, bottom - 2))
            blocked[at, left:right] = True
            _open_door(generator, blocked[at, left:right], side)
            rooms += [(top, left, at, right), (at + 1, left, bottom, right)]
        else:
            at = int(generator.integers(left + 2, right - 2))
            blocked[top:bottom, at] = True
            _open_door(generator, blocked[top:bottom, at], side)
            rooms += [(top, left, bottom, at), (top, at + 1, bottom, right)]
    return blocked


def _open_door(generator: np.random.Generator, wall: Cells, side: int) -> None:
    wide = min(len(wall), int(generator.integers(1, 2 + side // 32)))
    begin = int(generator.integers(0, len(wall) - wide + 1))
    wall[begin : begin + wide] = False


def _clutter(generator: np.random.Generator, side: int) -> Cells:
    """Return blocks of all sizes that cover a fifth to a third of the map."""
    blocked = np.zeros((side, side), bool)
    share = generator.uniform(0.2, 0.35)
    while blocked.mean() < share:
        height, width = 1 + (generator.uniform(0.0, 1.0, 2) ** 2 * side / 5).astype(int)
        row, column = generator.integers(0, side, 2)
        blocked[row : row + height, column : column + width] = True
    return blocked


def _caves(generator: np.random.Generator, side: int) -> Cells:
    """Return caves: smooth noise, of which the lowest part is rock."""
    noise = ndimage.gaussian_filter(generator.normal(size=(side, side)), max(0.8, side / 48))
    rock: Cells = noise < np.quantile(noise, generator.uniform(0.3, 0.42))
    return rock


def with_obstacles_on(problem: Terrain, path: list[list[int]], generator: np.random.Generator) -> dict[str, Any]:
    """Return the fields of the same problem at a later time.

    The robot is a tenth to a third along its path, and one to three blocks have appeared on the rest of the path.
    """
    characters = np.array([list(row) for row in problem.map])
    side = max(characters.shape)
    stands = int(len(path) * generator.uniform(0.1, 0.33))
    for _ in range(int(generator.integers(1, 4))):
        size = 1 + int(generator.integers(1, 2 + side // 16))
        row, column = path[int(generator.integers(stands + 1, len(path)))]
        top, left = (max(0, each - int(generator.integers(0, size))) for each in (row, column))
        characters[top : top + size, left : left + size] = "@"
    for kept_row, kept_column in (path[stands], path[-1]):
        characters[kept_row, kept_column] = problem.map[kept_row][kept_column]
    fields = problem.model_dump(exclude_unset=True)
    return fields | {"start": tuple(path[stands]), "map": ["".join(row) for row in characters]}
