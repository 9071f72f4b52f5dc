"""The compiled fitness of robot-path: the length of a path if all of it is proven free.

The table of the operators is described in `problems.robot_path.layout_kernels`.
"""

from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from genetics.arrays import Fitness, Genomes
from genetics.operators import FITNESS, TABLE, Table
from genetics.sequence_kernels import numbers_of
from lowlevel.compiled import kernel, subroutine
from problems.robot_path.layout_kernels import (
    MOST_POINTS,
    distance,
    is_step_free,
    length_of,
    read_way,
    task_of,
)
from problems.robots.motion_kernels import is_way_free
from problems.robots.scene_kernels import with_clearance

Floats = NDArray[np.float64]

BLOCKED = 1000.0
"""The fitness of a path that is not proven free is this plus the length of what is not."""


@subroutine
def _fitness_of(way: Any, count: Any, task: Any) -> Any:
    blocked = 0.0
    is_blocked = False
    for row in range(count - 1):
        if not is_step_free(task, way[row], way[row + 1]):
            is_blocked = True
            blocked += distance(way[row], way[row + 1])
    return BLOCKED + blocked if is_blocked else length_of(way, count)


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Fill in the length of each path, rad, or `BLOCKED` plus the length of the segments that are not free."""
    task = task_of(table)
    way = np.empty((MOST_POINTS, task.joints))
    for individual in range(genomes.shape[0]):
        count, _ = read_way(numbers_of(genomes[individual]), task, way)
        fitness[individual] = _fitness_of(way, count, task)


_ROOMS = (0.02, 0.005)
"""Clearances that a path is tried with, m, beside that of the task."""


@subroutine
def _keeps(task: Any, clearance: Any, way: Any, count: Any) -> Any:
    """Return whether all segments of a way keep another clearance, m."""
    scene = with_clearance(task.scene, clearance)
    for place in range(count - 1):  # noqa: SIM110 - compiled code has no generators
        if not is_way_free(scene, way[place], way[place + 1], task.room):
            return False
    return True


@kernel(types.void(types.uint8[::1], types.float64[:, ::1], types.float64[::1], TABLE), may_be_long=True)
def follow(genome: Genomes, path: Floats, figures: Floats, table: Table) -> None:
    """Fill the path, and the figures: number of points, fitness, and a lower bound of the clearance."""
    task = task_of(table)
    count, _ = read_way(numbers_of(genome), task, path)
    figures[0], figures[1], figures[2] = count, _fitness_of(path, count, task), 0.0
    if figures[1] < BLOCKED:
        figures[2] = task.scene.clearance
        for room in _ROOMS:
            if _keeps(task, task.scene.clearance + room, path, count):
                figures[2] += room
                break


def measured(function: Any, genome: Genomes, table: Table, joints: int) -> tuple[Floats, float, float]:
    """Return what a kernel such as `follow` finds.

    Returns:
        the path, shape (points, joints), the length of what is not proven free, rad, and the path's clearance, m.
    """
    path, figures = np.empty((MOST_POINTS, joints)), np.empty(3)
    function(genome, path, figures, table)
    count, fitness, clearance = figures.tolist()
    return path[: int(count)], max(0.0, fitness - BLOCKED), clearance
