"""Walk the blocks of a genome on a map (Fries, §3.1 and §3.4): subroutines of the kernels.

Headings are eighths of a turn: 0 towards greater columns, then anticlockwise; row 0 is at the top.
"""

from typing import Any, NamedTuple

import numpy as np

from lowlevel.compiled import subroutine
from lowlevel.pointers import integers, reals

D_ROW = np.array([0, -1, -1, -1, 0, 1, 1, 1])
D_COLUMN = np.array([1, 1, 0, -1, -1, -1, 0, 1])
START, GOAL, CUTS_CORNERS = 0, 2, 4  # the first places of these in the settings


class World(NamedTuple):
    """A map, and the start and goal on it."""

    settings: Any  # (5,): row and column of the start, row and column of the goal, whether corners may be cut
    penalty: Any  # K of the fitness (§3.4), above the cost of any clear path that enters no cell twice
    classes: Any  # (rows, columns): the class of each cell, -1 if impassable
    costs: Any  # (classes, 8): the cost of a step into a cell of a class, by heading
    corners: Any  # (rows + 1, columns + 1): whether a cell's first corner bars diagonal steps; empty if none does


@subroutine
def world_of(table: Any) -> Any:
    """Return the `World` of the first five parts of a table."""
    return World(integers(table, 0)[0], reals(table, 1)[0, 0], integers(table, 2), reals(table, 3), integers(table, 4))


@subroutine
def is_passable(world: Any, row: Any, column: Any) -> Any:
    """Return whether this is a cell of the map that is not impassable."""
    rows, columns = world.classes.shape
    return 0 <= row < rows and 0 <= column < columns and world.classes[row, column] >= 0


@subroutine
def is_clear(world: Any, row: Any, column: Any, heading: Any) -> Any:
    """Return whether the step by which a cell is entered is free, corners included.

    Only the ends and, for a diagonal step, the middle are looked at, which is exact: no point of a straight step is
    nearer to an obstacle than its ends, none of a diagonal step nearer than its ends and middle.
    """
    if not is_passable(world, row, column):
        return False
    if heading % 2 == 0:
        return True
    before_row, before_column = row - D_ROW[heading], column - D_COLUMN[heading]
    if world.corners.shape[0] > 0 and world.corners[max(row, before_row), max(column, before_column)] != 0:
        return False
    if world.settings[CUTS_CORNERS] != 0:
        return True
    return is_passable(world, before_row, column) and is_passable(world, row, before_column)


@subroutine
def turn_of(gene: Any, bits: Any) -> Any:
    """Return the turn of a block, in eighths: 00 and 11 are ahead, 01 is left, 10 is right (§3.1)."""
    direction = gene >> bits
    return 1 if direction == 1 else -1 if direction == 2 else 0


@subroutine
def length_of(gene: Any, bits: Any) -> Any:
    """Return the length of a block in cells."""
    return gene & ((1 << bits) - 1)


@subroutine
def walk(world: Any, numbers: Any, bits: Any, moves: Any) -> Any:
    """Follow the blocks, at most until the goal (§3.1, §3.4), and fill ``moves``.

    Each block after the first fills a row of ``moves`` with its heading and the number of cells walked. Blocked steps
    are made all the same, and counted: the fitness of a path with few of them is better.

    Returns:
        The fitness, the cost of the clear steps, and the number of rows filled.
    """
    row, column = world.settings[START], world.settings[START + 1]
    goal_row, goal_column = world.settings[GOAL], world.settings[GOAL + 1]
    # The first block is only the first heading (§3.1).
    heading = np.int64(numbers[1]) & 7
    cost, blocked, block = 0.0, 0, 0
    while block + 1 < numbers[0] and not (row == goal_row and column == goal_column):
        gene = np.int64(numbers[block + 2])
        heading = (heading + turn_of(gene, bits)) & 7
        left = length_of(gene, bits)
        moves[block, 0], moves[block, 1] = heading, 0
        while left > 0 and not (row == goal_row and column == goal_column):
            row, column = row + D_ROW[heading], column + D_COLUMN[heading]
            if is_clear(world, row, column, heading):
                cost += world.costs[world.classes[row, column], heading]
            else:
                blocked += 1
            moves[block, 1] += 1
            left -= 1
        block += 1
    away = np.hypot(np.float64(goal_row - row), np.float64(goal_column - column))
    if away == 0.0 and blocked == 0:
        return cost, cost, block
    return world.penalty * (1.0 + blocked) + away, cost, block
