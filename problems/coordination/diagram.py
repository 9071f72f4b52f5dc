"""Coordination diagrams: which pairs of places along two paths collide, and the duration of moves (§2)."""

from __future__ import annotations

from itertools import groupby
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from problems.tables import Table, quantity

Mask = NDArray[np.bool_]  # (N1, N2), true where the robots would collide
Cell = Annotated[int, Field(ge=0, lt=1 << 16)]
Cells = Annotated[int, Field(ge=1, le=2000)]
Seconds = Annotated[float, Field(ge=0, le=1e6)]
Block = tuple[Cell, Cell, Cell, Cell]
Arrays = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]
"""Seconds of a move of robot 1 by 0, 1, .. cells, (N1,); the same of robot 2, (N2,); and the summed-area table of the
obstacles, (N1 + 1, N2 + 1), whose entry (i, j) counts those with indices below i and j."""
Times = tuple[tuple[Seconds, Seconds], tuple[Seconds, Seconds]]

LEGS = 4  # each robot goes out, back, out and back
_CORRIDOR = 2  # cells along the border of a quarter that stay free, so that there is a way around its region
_MOST_TRIES = 1000  # random diagrams, until one has a way through

_CELLS = {"description": "cells [N1, N2] along the paths of robots 1 and 2"}
_TIMES = {"description": "of each robot [seconds per cell at its speed, seconds to reach that speed]"}
_DEFAULT_TIMES = ((0.1, 0.2), (0.1, 0.2))


class Diagram(Table):
    """A coordination diagram, as its obstacle cells and the speeds of both robots."""

    cells: tuple[Cells, Cells] = quantity("cells", **_CELLS)
    times: Times = quantity("s", **_TIMES, default=_DEFAULT_TIMES)
    obstacles: list[Block] = quantity(
        "cells", "rectangles of obstacle cells [i0, j0, i1, j1], both ends included", default_factory=list
    )

    @model_validator(mode="after")
    def _inside(self) -> Self:
        for number, (i0, j0, i1, j1) in enumerate(self.obstacles):
            if not (i0 <= i1 < self.cells[0] and j0 <= j1 < self.cells[1]):
                raise ValueError(
                    f"obstacles[{number}]: expected i0 <= i1 < {self.cells[0]} and j0 <= j1 < {self.cells[1]}, "
                    f"found {[i0, j0, i1, j1]}"
                )
        return self

    @staticmethod
    def of(blocked: Mask, times: Times) -> Diagram:
        """Return the diagram with the obstacle cells of a mask."""
        first, second = blocked.shape
        return Diagram(cells=(first, second), times=times, obstacles=blocks_of(blocked))

    def mask(self) -> Mask:
        """Return the obstacle cells, shape (N1, N2)."""
        blocked = np.zeros(self.cells, np.bool_)
        for i0, j0, i1, j1 in self.obstacles:
            blocked[i0 : i1 + 1, j0 : j1 + 1] = True
        return blocked


class RandomDiagram(Table):
    """A random diagram with sixteen collision regions, as in figure 3, and at least one way past them."""

    seed: int = quantity("", "the same seed gives the same diagram", ge=0, lt=1 << 63)
    layout: Literal["mirrored", "scattered"] = quantity(
        "",
        '"mirrored": one region, mirrored, as both robots go out and back twice; '
        '"scattered": sixteen different regions, anywhere',
        default="mirrored",
    )
    cells: tuple[Cells, Cells] = quantity("cells", **_CELLS, default=(180, 180))
    times: Times = quantity("s", **_TIMES, default=_DEFAULT_TIMES)

    @model_validator(mode="after")
    def _large_enough(self) -> Self:
        least = 8 * LEGS
        if min(self.cells) < least or any(side % LEGS for side in self.cells):
            raise ValueError(f"cells: expected multiples of {LEGS} from {least} on, found {list(self.cells)}")
        return self

    def mask(self) -> Mask:
        """Return the obstacle cells, shape (N1, N2).

        Raises:
            ValueError: if no diagram with a way through was found for this seed.
        """
        for attempt in range(_MOST_TRIES):
            generator = np.random.default_rng([self.seed, attempt])
            blocked = (
                _mirrored(generator, self.cells) if self.layout == "mirrored" else _scattered(generator, self.cells)
            )
            if is_passable(blocked):
                return blocked
        raise ValueError(f"seed: expected one that gives a passable diagram, found {self.seed}")


def _region(generator: np.random.Generator, quarter: tuple[int, int], middle: NDArray[np.float64], cells: Mask) -> None:
    """Add a region to the mask ``cells``: a disc, stretched and turned, with a wavy edge around ``middle``."""
    side = min(quarter)
    i, j = np.meshgrid(*(np.arange(length) for length in cells.shape), indexing="ij")
    away = (i - middle[0]) + 1j * (j - middle[1])
    away *= np.exp(1j * generator.uniform(0.0, np.pi))
    away = away.real * generator.uniform(0.6, 1.0) + 1j * away.imag * generator.uniform(1.0, 1.6)
    bearing = np.angle(away)
    edge = side * generator.uniform(0.16, 0.36) * np.ones(cells.shape)
    for waves in (2, 3, 5):
        edge *= 1.0 + generator.uniform(0.0, 0.15) * np.cos(waves * bearing + generator.uniform(0.0, 2.0 * np.pi))
    cells |= np.abs(away) <= edge


def _mirrored(generator: np.random.Generator, cells: tuple[int, int]) -> Mask:
    """Return a region in a quarter by a quarter of the diagram, and its mirror images for all pairs of legs."""
    quarter = (cells[0] // LEGS, cells[1] // LEGS)
    out = np.zeros(quarter, np.bool_)
    _region(generator, quarter, generator.uniform(0.3, 0.7, 2) * quarter, out)
    out[:_CORRIDOR] = out[-_CORRIDOR:] = False
    out[:, :_CORRIDOR] = out[:, -_CORRIDOR:] = False
    there_and_back = np.concatenate([out, out[::-1]])
    there_and_back = np.concatenate([there_and_back, there_and_back[:, ::-1]], axis=1)
    return np.tile(there_and_back, (2, 2))


def _scattered(generator: np.random.Generator, cells: tuple[int, int]) -> Mask:
    """Return sixteen different regions at random places."""
    quarter = (cells[0] // LEGS, cells[1] // LEGS)
    blocked = np.zeros(cells, np.bool_)
    for _ in range(LEGS * LEGS):
        _region(generator, quarter, generator.uniform(0.0, 1.0, 2) * cells, blocked)
    return blocked


def is_passable(blocked: Mask) -> bool:
    """Return whether a way through free cells leads from start to end if the robots advance one cell at a time."""
    if blocked[0, 0] or blocked[-1, -1]:
        return False
    reached = np.zeros(blocked.shape[1], np.bool_)
    reached[0] = True
    for column in blocked:
        way = False
        for j, obstacle in enumerate(column):
            way = not obstacle and (way or bool(reached[j]))
            reached[j] = way
    return bool(reached[-1])


def blocks_of(blocked: Mask) -> list[Block]:
    """Return rectangles that together cover exactly the obstacle cells."""
    found: list[Block] = []
    growing: dict[tuple[int, int], int] = {}  # each run of the column before, and the first column of its rectangle
    for i, column in enumerate([*blocked, np.zeros(blocked.shape[1], np.bool_)]):
        runs = _runs(column)
        found += [(begun, j0, i - 1, j1) for (j0, j1), begun in growing.items() if (j0, j1) not in runs]
        growing = {run: growing.get(run, i) for run in runs}
    return sorted(found)


def _runs(column: Mask) -> list[tuple[int, int]]:
    """Return the first and the last index of each run of obstacle cells."""
    runs = []
    for obstacle, group in groupby(enumerate(column.tolist()), key=lambda each: each[1]):
        indices = [index for index, _ in group]
        if obstacle:
            runs.append((indices[0], indices[-1]))
    return runs


def move_times(cells: int, times: tuple[float, float]) -> NDArray[np.float64]:
    """Return the seconds that a robot takes for moves of 0, 1, .., cells − 1 cells from rest to rest, shape (cells,).

    The robot accelerates and decelerates at the same constant rate. On a move too short for full speed it accelerates
    up to the middle and then decelerates.
    """
    per_cell, to_speed = times
    cruising = np.arange(cells) * per_cell  # the time at full speed all the way
    return np.where(cruising >= to_speed, cruising + to_speed, 2.0 * np.sqrt(cruising * to_speed))
