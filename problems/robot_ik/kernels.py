"""The compiled fitness of robot-ik: each coded configuration is brought towards the pose before it is judged.

A genome holds one block of genes in [0, 1] for each solution that is wanted, a share of each joint's range. Damped
least squares, starting there, are part of what a genome means: `settle` finds the configuration that it stands for.

The table of an operator (see `genetics.operators`) holds, by place:

0. variables, solutions wanted, most steps, the body that carries the link, whether the rotation matters, whether
   contact is tested;
1. lowest value, width of the range, and whether it is an angle, of each variable, shape (3, variables);
2. tolerance of the position (m) and of the angle (rad); the least difference of two solutions (rad or m);
3. the link's frame in its body, then the pose that it is to reach, shape (2, 12);
4. and up: the scene, see `problems.robots.scene_kernels`.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Fitness, Genomes
from genetics.operators import FITNESS, Table
from genetics.randomness import INITIAL, draw, unit
from lowlevel.compiled import kernel, subroutine
from lowlevel.pointers import integers, reals
from problems.robots.collision_kernels import FREE, least_gap, make_search, verdict
from problems.robots.kinematics_kernels import compose, make_step_room, place, pose_error, step_towards
from problems.robots.scene_kernels import scene_of

Floats = NDArray[np.float64]

CONTACT = 10.0
"""The penalty for contact: more than the fitness of any solution, less than that of most other configurations."""
MISSING = 100.0
"""The penalty for each solution that is still missing."""
MOST_GAP = 1.0
"""Distances from obstacles are measured up to this, m."""

_SCENE = 4  # the first entry of the scene in the table
_ENOUGH = 1e-3  # of the tolerances: no further step is made
_ANGLE_WEIGHT = 0.3  # m per rad, in the squares that the steps make least
_DAMPING = 0.1  # of the error, m; towards the pose the steps become Newton's
_GREATEST = 0.6  # rad or m, of one step in any variable


class Task(NamedTuple):
    """The problem as the fitness sees it: all that it depends on besides the genome."""

    variables: Any
    solutions: Any
    steps: Any
    body: Any
    turns: Any  # whether the rotation matters
    touches: Any  # whether contact is tested
    ranges: Any  # (3, variables)
    tolerances: Any  # (3,)
    offset: Any  # (12,)
    target: Any  # (12,)
    scene: Any


class Room(NamedTuple):
    """Working arrays; `settle` leaves the result in them."""

    q: Any  # (variables,)
    frames: Any  # (bodies, 12)
    pose: Any  # (12,)
    errors: Any  # (6,)
    margins: Any  # (bodies,): zeros
    pair_margins: Any  # (pairs,): zeros
    kept: Any  # (solutions, variables): those that count as solutions
    steps: Any  # the working arrays of `step_towards`
    search: Any  # the working arrays of `verdict`


@subroutine
def task_of(table: Any) -> Any:
    """Return the `Task` that a table holds."""
    layout, poses = integers(table, 0)[0], reals(table, 3)
    return Task(
        layout[0],
        layout[1],
        layout[2],
        layout[3],
        layout[4] != 0,
        layout[5] != 0,
        reals(table, 1),
        reals(table, 2)[0],
        poses[0],
        poses[1],
        scene_of(table, _SCENE),
    )


@subroutine
def room_for(task: Any) -> Any:
    """Return working arrays."""
    scene = task.scene
    bodies = scene.kinds.size
    return Room(
        np.empty(task.variables),
        np.empty((bodies, 12)),
        np.empty(12),
        np.empty(6),
        np.zeros(bodies),
        np.zeros(scene.pairs.shape[0]),
        np.empty((task.solutions, task.variables)),
        make_step_room(scene),
        make_search(scene),
    )


@subroutine
def _in_tolerances(task: Any, distance: Any, angle: Any) -> Any:
    """Return the error of a pose: the greater of distance and angle, each as a multiple of its tolerance."""
    error = distance / task.tolerances[0]
    return max(error, angle / task.tolerances[1]) if task.turns else error


@subroutine
def settle(genes: Any, task: Any, room: Any) -> Any:
    """Fill ``room.q`` and ``room.frames`` with the configuration that a block of genes stands for.

    Returns:
        the distance, m, and the angle, rad, that are left between the link and the pose; 0 rad if any rotation will do.
    """
    scene, q, weight = task.scene, room.q, (_ANGLE_WEIGHT if task.turns else 0.0)
    for variable in range(task.variables):
        q[variable] = task.ranges[0, variable] + task.ranges[1, variable] * genes[variable]
    place(scene, q, room.frames)
    for _ in range(task.steps):
        compose(room.frames[task.body], task.offset, room.pose)
        distance, angle = pose_error(room.pose, task.target, room.errors)
        if _in_tolerances(task, distance, angle) <= _ENOUGH:
            break
        damping = _DAMPING * min(1.0, np.sqrt(distance * distance + weight * weight * angle * angle))
        step_towards(scene, q, room.frames, task.body, task.offset, task.target, weight, damping, _GREATEST, room.steps)
    compose(room.frames[task.body], task.offset, room.pose)
    distance, angle = pose_error(room.pose, task.target, room.errors)
    return distance, (angle if task.turns else 0.0)


@subroutine
def _touches(task: Any, room: Any) -> Any:
    """Return whether the configuration in the room does not keep the clearance, for all that the kernels can prove."""
    if not task.touches:
        return False
    return verdict(task.scene, room.frames, room.margins, room.pair_margins, False, room.search) != FREE


@subroutine
def _is_new(task: Any, room: Any, kept: Any) -> Any:
    """Return whether the configuration in the room differs from the first ``kept`` solutions.

    Angles that differ by whole turns are the same.
    """
    for other in range(kept):
        differs = False
        for variable in range(task.variables):
            difference = abs(room.q[variable] - room.kept[other, variable])
            if task.ranges[2, variable] != 0.0:
                difference = abs(difference - 2.0 * np.pi * np.floor(difference / (2.0 * np.pi) + 0.5))
            differs |= difference >= task.tolerances[2]
        if not differs:
            return False
    return True


@subroutine
def _judge(genome: Any, task: Any, room: Any) -> Any:
    """Return the fitness of a genome of float64 genes; see `evaluate`."""
    kept, worst, nearest = 0, 0.0, np.inf
    for block in range(task.solutions):
        distance, angle = settle(genome[block * task.variables :], task, room)
        error = _in_tolerances(task, distance, angle)
        touches = _touches(task, room)
        nearest = min(nearest, error + (CONTACT if touches else 0.0))
        if error <= 1.0 and not touches and _is_new(task, room, kept):
            room.kept[kept] = room.q
            kept, worst = kept + 1, max(worst, error)
    return (worst if kept else nearest) + MISSING * (task.solutions - max(kept, 1))


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Fill the error of each genome, as a multiple of the tolerances.

    It is the greatest error of its solutions plus `MISSING` for each that is missing. A genome without a solution has
    the least error of its configurations, plus `CONTACT` for one that touches something.
    """
    task = task_of(table)
    room = room_for(task)
    genes = genomes.view(np.float64)
    for row in range(fitness.size):
        fitness[row] = _judge(genes[row], task, room)


@kernel("Tuple((float64[:,::1], float64[:,::1]))(float64[::1], int64[:,::1])")
def follow(genes: Floats, table: Table) -> tuple[Floats, Floats]:
    """Return the configurations that a genome stands for, and what is known of them.

    Returns:
        the configurations, rad or m, shape (solutions, variables).
        for each: the distance, m, and the angle, rad, from the pose; a lower bound of the least distance from what it
        must not touch, m, at most `MOST_GAP`; 1 if it keeps the clearance, else 0; 1 if it is one of the solutions.
    """
    task = task_of(table)
    room = room_for(task)
    found, known = np.empty((task.solutions, task.variables)), np.empty((task.solutions, 5))
    kept = 0
    for block in range(task.solutions):
        distance, angle = settle(genes[block * task.variables :], task, room)
        found[block], known[block, 0], known[block, 1] = room.q, distance, angle
        is_free = not _touches(task, room)
        known[block, 2] = least_gap(task.scene, room.frames, MOST_GAP, room.search) if task.touches else MOST_GAP
        known[block, 3] = is_free
        counts = _in_tolerances(task, distance, angle) <= 1.0 and is_free and _is_new(task, room, kept)
        known[block, 4] = counts
        if counts:
            room.kept[kept] = room.q
            kept += 1
    return found, known


@kernel("Tuple((float64[::1], float64, int64))(uint64, int64, int64, int64[:,::1])", may_be_long=True)
def solve(seed: np.uint64, cell: int, most: int, table: Table) -> tuple[Floats, float, int]:
    """Look for one solution among the first individuals of a cell, one after the other; stop at the first.

    Args:
        seed: the run's seed.
        cell: the cell, whose first deme these individuals are.
        most: the number of individuals after which the search ends.
        table: the table of `evaluate`.

    Returns:
        the genes of the best, shape (variables,); its fitness; the number of individuals that were tried.
    """
    task = task_of(table)
    room = room_for(task)
    genes, best, least = np.empty(task.variables), np.empty(task.variables), np.inf
    for individual in range(most):
        for gene in range(task.variables):
            genes[gene] = unit(draw(seed, cell, 0, INITIAL, individual, gene))
        distance, angle = settle(genes, task, room)
        error = _in_tolerances(task, distance, angle) + (CONTACT if _touches(task, room) else 0.0)
        if error < least:
            best[:], least = genes, error
        if least <= 1.0:
            return best, least, individual + 1
    return best, least, most
