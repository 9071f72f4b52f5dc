"""The compiled fitness of coded trajectories: the least time in which an arm follows a curve within its limits.

The curve is a uniform cubic B-spline whose control points are the nodes. A phantom control point beyond each end makes
it begin in the first node and end in the last. The spline has continuous second derivatives, so torques do not jump at
nodes; straight stretches would need a stop at each node.

The parts of the table (see `genetics.operators`), in the order in which `MinTime` packs them:
    integers 0: joints, most nodes, whether the arm is a chain, whether accelerations are limited, whether jerks are
    integers 1: the greatest gene of each joint
    reals 2: start, goal, and the limits of torque, velocity, acceleration and jerk, shape (6, joints)
    reals 3: the constants of two links
    reals 4: the joints of a chain
    reals 5: gravity
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Fitness, Genomes
from genetics.operators import FITNESS, Table
from genetics.sequence_kernels import numbers_of
from lowlevel.compiled import kernel, subroutine
from lowlevel.pointers import integers, reals
from problems.min_time.dynamics import chain_of
from problems.min_time.levels import LEVELS
from problems.min_time.scaling import (
    POINTS,
    POINTS_OF_STRETCH,
    Task,
    add_phantoms,
    room_of,
    scale_time,
    step_time,
    weigh,
    weigh_end,
    weigh_stretch,
)
from problems.min_time.smoothing import advance, best_window, smooth_push, smooth_time

Floats = NDArray[np.float64]


@subroutine
def task_of(table: Any) -> Any:
    """Return the `Task` that the table holds, with working arrays for its chain."""
    layout, rows = integers(table, 0)[0], reals(table, 2)
    chain = chain_of(reals(table, 4), reals(table, 5)[0])
    return Task(
        layout[0],
        layout[2] != 0,
        layout[3] != 0,
        layout[4] != 0,
        integers(table, 1)[0],
        rows[:2],
        rows[2],
        rows[3],
        rows[4],
        rows[5],
        reals(table, 3)[0],
        chain,
    )


@subroutine
def points_of(stretches: Any) -> Any:
    """Return the number of steps of each stretch, for a curve of so many stretches."""
    return max(POINTS_OF_STRETCH, (POINTS + stretches - 1) // stretches)


@subroutine
def room_for(task: Any, table: Any) -> Any:
    """Return working arrays for the longest curve."""
    most = integers(table, 0)[0, 1]  # n stretches have at most max(POINTS_OF_STRETCH * n, POINTS + n) steps in all
    return room_of(task, most, max(POINTS_OF_STRETCH * most, POINTS + most))


@subroutine
def lay_out(genome: Any, task: Any, room: Any) -> Any:
    """Fill the nodes and torque shares that a genome codes; return the number of stretches.

    Return 0 if the curve would stand still somewhere: where a node coincides with the one before it, or with the one
    before that (a way there and back).
    """
    numbers, width = numbers_of(genome), task.joints + 1
    stretches = np.int64(numbers[0])
    nodes = room.nodes
    for stretch in range(stretches):
        room.shares[stretch] = numbers[1 + stretch * width + task.joints] / LEVELS
        for joint in range(task.joints):
            gene, greatest = np.int64(numbers[1 + stretch * width + joint]), task.greatest[joint]
            start, goal = task.ends[0, joint], task.ends[1, joint]
            # The goal is taken as it is, not computed: the sum may differ from it in the last bit.
            last = stretch == stretches - 1 or gene == greatest
            nodes[stretch + 2, joint] = goal if last else start + (goal - start) * (gene / greatest)
    nodes[1] = task.ends[0]
    for stretch in range(stretches):
        if np.all(nodes[stretch + 1] == nodes[stretch + 2]):
            return 0
        if stretch > 0 and np.all(nodes[stretch] == nodes[stretch + 2]):
            return 0
    add_phantoms(nodes, stretches)
    return stretches


@subroutine
def is_at_goal(task: Any) -> Any:
    """Return whether start and goal are the same, so that there is nothing to do."""
    return np.all(task.ends[0] == task.ends[1])


@subroutine
def _travel(genome: Any, task: Any, room: Any) -> Any:
    """Return the time of a genome's trajectory, s, its number of stretches, and the steps of each stretch."""
    stretches = lay_out(genome, task, room)
    if stretches == 0:
        return (0.0 if is_at_goal(task) else np.inf), 0, 0
    steps = points_of(stretches)
    for stretch in range(stretches):
        weigh_stretch(task, room, stretch, stretch * steps, steps)
    weigh_end(task, room, stretches - 1, stretches * steps)
    time = scale_time(task, room, stretches * steps, steps)
    if task.is_smooth and time < np.inf:
        time = smooth_time(task, room, stretches * steps, steps)
    return time, stretches, steps


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Fill the travel time of each trajectory, s; +inf if the limits forbid it."""
    task = task_of(table)
    room = room_for(task, table)
    for row in range(fitness.size):
        fitness[row] = _travel(genomes[row], task, room)[0]


# The trajectory -------------------------------------------------------------------------------------------------------
@subroutine
def _fill(row: Any, task: Any, room: Any, stretch: Any, share: Any, time: Any, speed: Any, push: Any) -> Any:
    """Fill a row of a trajectory at a place where ṡ is ``speed`` and s̈ is ``push``."""
    weigh(task, room, 0, stretch, share)  # grid point 0 serves as scratch: the time scaling is done
    row[0], row[1], row[2] = time, room.angles, speed * room.slope[0]
    row[3] = push * room.slope[0] + speed * speed * room.bend[0]
    row[4] = push * room.inertia[0] + speed * speed * room.pull[0] + room.load[0]
    row[5] = stretch + share


@subroutine
def _standing(task: Any, room: Any) -> Any:
    """Return the one row of an arm that stays at rest at the start."""
    rows = np.zeros((1, 6, task.joints))
    room.nodes[:4] = task.ends[0]
    _fill(rows[0], task, room, 0, 0.0, 0.0, 0.0, 0.0)
    return rows


@subroutine
def _by_steps(task: Any, room: Any, points: Any, steps: Any) -> Any:
    """Return a row for each grid point."""
    rows, x = np.empty((points + 1, 6, task.joints)), room.x
    time = 0.0
    for point in range(points + 1):
        stretch = min(point // steps, points // steps - 1)
        # s̈ at the step's beginning: the difference of its first two Bézier points over its length. At the last point it
        # is that of the last two.
        push = steps * (x[2 * point + 1] - x[2 * point] if point < points else x[2 * point] - x[2 * point - 1])
        share = (point - stretch * steps) / steps
        _fill(rows[point], task, room, stretch, share, time, np.sqrt(x[2 * point]), push)
        if point < points:
            time += step_time(x[2 * point], x[2 * point + 1], x[2 * point + 2], 1.0 / steps)
    return rows


@subroutine
def _by_moments(task: Any, room: Any, points: Any, steps: Any) -> Any:
    """Return a row for each of the equally spaced moments of the smoothed motion."""
    window, period, slowdown = best_window(task, room, points, steps)
    count, stretches = points + window, points // steps
    rows = np.empty((count + 1, 6, task.joints))
    place, speed, push = 0.0, 0.0, 0.0
    for moment in range(count + 1):  # the last row is set to the goal at rest, without the rounding of the integration
        at = stretches if moment == count else min(max(place, 0.0), stretches)
        fast = 0.0 if moment == count else max(speed, 0.0)
        push = 0.0 if moment == count else push
        stretch = min(np.int64(at), stretches - 1)
        _fill(rows[moment], task, room, stretch, at - stretch, moment * period, fast, push)
        if moment < count:
            # The sampled speeds are those before the slowdown: their period is shorter, and s̈ falls with its square.
            following = smooth_push(room, points, period / slowdown, window, moment + 1) / slowdown**2
            place, speed, push = advance(place, speed, push, (following - push) / period, period)
    return rows


@kernel("Tuple((float64[:,::1], float64[:,:,::1]))(uint8[::1], int64[:,::1])")
def follow(genome: Genomes, table: Table) -> tuple[Floats, Floats]:
    """Return the trajectory of a genome; one row at rest at the start if the limits forbid every trajectory.

    Returns:
        The nodes, start and goal included, rad, shape (nodes, joints).
        The rows, shape (rows, 6, joints): the time in all columns (s), angles (rad), speeds (rad/s), accelerations
        (rad/s²), torques (N·m), and the place s along the curve in all columns. Without a limit of jerk there is a row
        for each grid point. Its accelerations are those at the beginning of the step that begins there; at the last
        point, those at the end of the last step. With a limit of jerk the rows are equally spaced in time.
    """
    task = task_of(table)
    room = room_for(task, table)
    time, stretches, steps = _travel(genome, task, room)
    if stretches == 0:
        return task.ends.copy(), _standing(task, room)
    nodes, points = room.nodes[1 : stretches + 2].copy(), stretches * steps
    if time == np.inf:  # the room holds no speeds to follow
        return nodes, _standing(task, room)
    return nodes, _by_moments(task, room, points, steps) if task.is_smooth else _by_steps(task, room, points, steps)
