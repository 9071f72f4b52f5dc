"""The oracle of terrain: the optimum by Dijkstra's algorithm over all cells, by scipy.

It is exact because costs are sums over steps: each step's rank depends only on the cell entered and the heading, and
ranks are linear (`checker.ranked`). Rules and costs come from `checker`, not from the kernels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from problems.problem import Answer
from problems.terrain import checker
from problems.terrain.solution import STEPS, solution_of

if TYPE_CHECKING:
    from problems.terrain.model import TerrainModel

METHOD = "Dijkstra's algorithm over all cells"


def solve_exactly(problem: TerrainModel) -> Answer:
    """Return the cost of the easiest path, and such a path, even if a genome has too few blocks to code it."""
    blocked = problem.impassable
    columns = blocked.shape[1]
    start, goal = (row * columns + column for row, column in (problem.start, problem.goal))
    costs, before = csgraph.dijkstra(_graph(problem, blocked), indices=start, return_predecessors=True)
    # That there is no way is an exact answer too.
    if not np.isfinite(costs[goal]):
        return Answer("optimum", np.inf, METHOD)
    cells = [goal]
    while cells[-1] != start:
        cells.append(int(before[cells[-1]]))
    path = np.column_stack(np.divmod(cells[::-1], columns))
    headings = np.array([STEPS.index(tuple(step)) for step in np.diff(path, axis=0).tolist()], np.int64)
    return Answer(
        "optimum", float(costs[goal]), METHOD, solution_of(problem.start, headings, costs[goal]), {"cells": len(cells)}
    )


def _graph(problem: TerrainModel, blocked: NDArray[np.bool_]) -> sparse.csr_array:
    """Return the graph of all clear steps from each cell to its neighbours, weighed by the costs of the steps."""
    rows, columns = blocked.shape
    numbers = np.arange(rows * columns).reshape(rows, columns)
    free = np.pad(~blocked, 1)
    tails, heads, weights = [], [], []
    for heading, (d_row, d_column) in enumerate(STEPS):
        is_open = _shifted(free, 0, 0) & _shifted(free, d_row, d_column)
        if d_row and d_column and not problem.corner_cutting:
            is_open &= _shifted(free, d_row, 0) & _shifted(free, 0, d_column)
        if d_row and d_column and problem.clearance > 0.0:
            # On the fine grid the middle of a diagonal step is one place away from the centre that it begins at.
            middles = problem.distances[1 + d_row :, 1 + d_column :][::2, ::2][:rows, :columns]
            is_open &= middles >= problem.least_allowed
        tail = numbers[is_open]
        head = tail + d_row * columns + d_column
        tails.append(tail)
        heads.append(head)
        weights.append(np.hypot(d_row, d_column) * _difficulties(problem, heading).ravel()[head])
    edges = (np.concatenate(weights), (np.concatenate(tails), np.concatenate(heads)))
    return sparse.csr_array(edges, shape=(rows * columns, rows * columns))


def _shifted(padded: NDArray[np.bool_], d_row: int, d_column: int) -> NDArray[np.bool_]:
    """Return for each cell the value of the cell one step away; the map is padded by one cell on each side."""
    rows, columns = padded.shape[0] - 2, padded.shape[1] - 2
    return padded[1 + d_row : 1 + d_row + rows, 1 + d_column : 1 + d_column + columns]


def _difficulties(problem: TerrainModel, heading: int) -> NDArray[np.float64]:
    """Return the ranked difficulty of a step into each cell by a heading; NaN where the cell is impassable."""
    characters = np.array([list(row) for row in problem.map])
    ranks = np.full(characters.shape, np.nan)
    for character in problem.legend:
        places = np.argwhere(characters == character)
        if len(places):
            # All cells of a character have the same difficulty, so one of them is enough.
            first = (int(places[0][0]), int(places[0][1]))
            ranks[characters == character] = checker.ranked(problem, checker.difficulty(problem, first, heading))
    return ranks
