"""The solution of a terrain problem as plain values."""

from __future__ import annotations

from itertools import groupby
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from problems.problem import Solution
from problems.tables import Table

EIGHTH = np.pi / 4.0  # rad
STEPS = ((0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0), (1, 1))
"""The change of row and column of a step, by heading: 0 towards greater columns, anticlockwise; row 0 is at the top."""

Cell = tuple[int, int]
_Place = Annotated[int, Field(ge=-(10**9), le=10**9)]  # also off the map, which the check objects to


class TerrainSolution(Table):
    """A solution of terrain, as `Terrain.decode` writes it."""

    path: Annotated[list[tuple[_Place, _Place]], Field(min_length=1)]
    cost: Annotated[float, Field(ge=0)]
    moves: list[tuple[float, Annotated[int, Field(ge=1)]]]


def solution_of(start: Cell, headings: NDArray[np.int64], cost: float) -> Solution:
    """Return the solution of some steps, given by their headings in eighths of a turn, 0 to 7."""
    places = np.cumsum([start, *(STEPS[heading] for heading in headings)], axis=0)
    moves = [[heading * EIGHTH, len(list(run))] for heading, run in groupby(headings.tolist())]
    return {"path": places.tolist(), "cost": float(cost), "moves": moves}
