"""How paths are made: a straight line if one is free, else a way from two trees, shortened at once."""

from typing import Any

import numpy as np

from genetics.arrays import Genomes
from genetics.operators import INITIALISE, Table
from genetics.randomness import INITIAL
from genetics.sequence_kernels import numbers_of
from lowlevel.compiled import kernel, subroutine
from problems.robot_path.layout_kernels import (
    MOST_POINTS,
    dice_of,
    distance,
    is_step_free,
    task_of,
    write_way,
)
from problems.robot_path.shortening_kernels import drop_points, shorten
from problems.robot_path.tree_kernels import Search, grow

FIRST_BUDGET = 40000
"""The most configurations that a tree of the first generation tests; later ones may test twice as many."""
_MOST_DOUBLINGS = 1
STEP = 1.5
"""The greatest length of a step of a tree, rad."""
_TRIES = 10  # to shorten a new way


@subroutine
def search_in(generation: Any) -> Any:
    """Return how far a tree goes in a generation."""
    return Search(FIRST_BUDGET << min(generation, _MOST_DOUBLINGS), STEP, np.inf)


@subroutine
def nearest_goal(task: Any) -> Any:
    """Return the index of the goal nearest to the start."""
    best = 0
    for goal in range(1, task.goals.shape[0]):
        if distance(task.start, task.goals[goal]) < distance(task.start, task.goals[best]):
            best = goal
    return best


@subroutine
def go_straight(numbers: Any, task: Any, way: Any, goal: Any) -> Any:
    """Write the straight line to a goal."""
    way[0], way[1] = task.start, task.goals[goal]
    write_way(way, 2, goal, task, numbers)


@subroutine
def find_way(numbers: Any, task: Any, way: Any, search: Any, dice: Any) -> Any:
    """Write a new way from the start to any goal; return whether one was found that fits into a genome."""
    count, goal = grow(way, task.start, task.goals, task, search, dice)
    if count == 0:
        return False
    count = shorten(way, drop_points(way, count, task), task, dice, _TRIES)
    return write_way(way, count, goal, task, numbers)


@subroutine
def free_line(task: Any) -> Any:
    """Return the nearest goal to which the straight line is free; -1 if there is none."""
    best = -1
    for goal in range(task.goals.shape[0]):
        nearer = best < 0 or distance(task.start, task.goals[goal]) < distance(task.start, task.goals[best])
        if nearer and is_step_free(task, task.start, task.goals[goal]):
            best = goal
    return best


@kernel(INITIALISE, may_be_long=True)
def initialise(deme: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Fill the deme: the straight line if it is free, else for each individual what its own trees find."""
    task = task_of(table)
    way = np.empty((MOST_POINTS, task.joints))
    straight = free_line(task)
    for individual in range(deme.shape[0]):
        numbers = numbers_of(deme[individual])
        go_straight(numbers, task, way, nearest_goal(task) if straight < 0 else straight)
        if straight < 0:
            dice = dice_of(seed, cell, generation, INITIAL, individual)
            find_way(numbers, task, way, search_in(0), dice)
