"""The compiled fitness of coded trajectories: the least time in which an arm follows a curve within its torque limits.

The curve is a uniform cubic B-spline whose control points are the nodes, with phantom ends that make it begin and end
in the first and last. Time scaling goes in x = ṡ² over a grid of s (Bobrow, Dubowsky and Gibson 1985; Shin and McKay
1985), by controllable sets backwards and the greatest acceleration forwards (Pham and Pham 2018, TOPP-RA). On each step
s̈ is linear in s, so x is a parabola, whose ends and middle Bézier point lie half a step's constant s̈ apart; the torque
limits hold at both ends of the step, each with the s̈ there. So each half of a step is a linear program in two unknowns,
which elimination solves exactly, and points where a joint's inertia along the curve vanishes need no case of their own.
Between grid points torques may still exceed their limits, by an error of second order: where they do, the limits of the
step are tightened and time is scaled again, and in the end the whole motion is slowed down by the little that is left.

The table (see `genetics.operators`): joints, most nodes, whether the arm is a chain; the greatest gene of each joint;
start, goal and torque limits, shape (3, joints); constants of two links; joints of a chain; gravity.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Fitness, Genomes
from genetics.compiled import kernel, subroutine
from genetics.operators import FITNESS, Table, integers, reals
from genetics.sequence_kernels import numbers_of
from problems.min_time.coding import LEVELS
from problems.min_time.dynamics import chain_of, scaled_chain, scaled_two_links

Floats = NDArray[np.float64]

POINTS_OF_STRETCH, POINTS = 8, 128
"""The least number of steps that a stretch between two nodes, and a whole curve, is cut into."""

_ROUNDS = 4  # of tightening limits, at most
_TIGHT_ENOUGH = 1.002  # of the squared speeds: a thousandth of the time
_FASTEST = 1e12  # greatest ṡ²: nothing real comes near it
_NO_INERTIA = 1e-9  # kg m²: less counts as this much
_ROUNDING = 1e-9


class Task(NamedTuple):
    """What a trajectory is judged by."""

    joints: Any
    is_chain: Any
    greatest: Any  # (joints,), genes at the goal
    ends: Any  # (2, joints), rad: start and goal
    torque: Any  # (joints,), N·m
    links: Any  # (5,)
    chain: Any


class Room(NamedTuple):
    """Where a curve is worked out; sizes for the longest."""

    nodes: Any  # (most nodes + 3, joints), rad: control points with phantom ends
    shares: Any  # (most nodes,): of the torque limits, on each stretch
    angles: Any  # (joints,), rad: at one point, and its derivatives by s
    slope: Any
    bend: Any
    still: Any  # (joints,), zeros
    inertia: Any  # (points + 1, joints): a
    pull: Any  # (points + 1, joints): b
    load: Any  # (points + 1, joints): c
    rows: Any  # (2 * points, joints + 1, 3): limits of a half step as low <= s̈ + slant * x <= high: slant, low, high
    least: Any  # (2 * points + 1,): of the controllable x; that of the parabola's middle at odd places
    most: Any  # (2 * points + 1,)
    x: Any  # (2 * points + 1,)
    tightness: Any  # (points,): what the limits of a step's moving torques are divided by
    middle: Any  # (3, joints): a, b and c between grid points


@subroutine
def task_of(table: Any) -> Any:
    """What the table holds."""
    layout, ends = integers(table, 0)[0], reals(table, 2)
    chain = chain_of(reals(table, 4), reals(table, 5)[0])
    return Task(layout[0], layout[2] != 0, integers(table, 1)[0], ends[:2], ends[2], reals(table, 3)[0], chain)


@subroutine
def points_of(stretches: Any) -> Any:
    """Steps of each stretch."""
    return max(POINTS_OF_STRETCH, (POINTS + stretches - 1) // stretches)


@subroutine
def room_for(table: Any) -> Any:
    """Room for the longest curve."""
    joints, most = integers(table, 0)[0, 0], integers(table, 0)[0, 1]
    points = max(POINTS_OF_STRETCH * most, POINTS + most)
    return room_of(joints, most, points)


@subroutine
def room_of(joints: Any, stretches: Any, points: Any) -> Any:
    """Room for so many stretches and steps."""
    return Room(
        np.empty((stretches + 3, joints)),
        np.empty(stretches),
        np.empty(joints),
        np.empty(joints),
        np.empty(joints),
        np.zeros(joints),
        np.empty((points + 1, joints)),
        np.empty((points + 1, joints)),
        np.empty((points + 1, joints)),
        np.empty((2 * points, joints + 1, 3)),
        np.empty(2 * points + 1),
        np.empty(2 * points + 1),
        np.empty(2 * points + 1),
        np.empty(points),
        np.empty((3, joints)),
    )


@subroutine
def lay_out(genome: Any, task: Any, room: Any) -> Any:
    """Fill the nodes and shares that a genome codes; returns the number of stretches.

    0 if the curve would stand still somewhere: where a node coincides with the one before it, or before that.
    """
    numbers, width = numbers_of(genome), task.joints + 1
    stretches = np.int64(numbers[0])
    nodes = room.nodes
    for stretch in range(stretches):
        room.shares[stretch] = numbers[1 + stretch * width + task.joints] / LEVELS
        for joint in range(task.joints):
            gene, greatest = np.int64(numbers[1 + stretch * width + joint]), task.greatest[joint]
            start, goal = task.ends[0, joint], task.ends[1, joint]
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
def add_phantoms(nodes: Any, stretches: Any) -> Any:
    """The control points before the first and after the last node."""
    for joint in range(nodes.shape[1]):
        nodes[0, joint] = 2.0 * nodes[1, joint] - nodes[2, joint]
        nodes[stretches + 2, joint] = 2.0 * nodes[stretches + 1, joint] - nodes[stretches, joint]


@subroutine
def place_on_curve(nodes: Any, stretch: Any, share: Any, angles: Any, slope: Any, bend: Any) -> Any:
    """The curve and its first two derivatives by s, at a share of a stretch."""
    rest = 1.0 - share
    for joint in range(nodes.shape[1]):
        one, two = nodes[stretch, joint], nodes[stretch + 1, joint]
        three, four = nodes[stretch + 2, joint], nodes[stretch + 3, joint]
        before, after = one - 2.0 * two + three, two - 2.0 * three + four
        angles[joint] = rest * two + share * three + (rest * rest * rest * before + share * share * share * after) / 6.0
        slope[joint] = three - two + 0.5 * (share * share * after - rest * rest * before)
        bend[joint] = rest * before + share * after


@subroutine
def _weigh(task: Any, room: Any, point: Any, stretch: Any, share: Any) -> Any:
    """Fill a, b and c at a grid point: one evaluation of the inverse dynamics."""
    place_on_curve(room.nodes, stretch, share, room.angles, room.slope, room.bend)
    a, b, c = room.inertia[point], room.pull[point], room.load[point]
    if task.is_chain:
        scaled_chain(task.chain, room.angles, room.slope, room.bend, room.still, a, b, c)
    else:
        scaled_two_links(task.links, room.angles, room.slope, room.bend, a, b, c)


@subroutine
def weigh_stretch(task: Any, room: Any, stretch: Any, first: Any, steps: Any) -> Any:
    """Fill a, b and c along a stretch, but for its end, from grid point ``first`` on."""
    for step in range(steps):
        _weigh(task, room, first + step, stretch, step / steps)


@subroutine
def weigh_end(task: Any, room: Any, stretch: Any, point: Any) -> Any:
    """Fill a, b and c at the end of a stretch."""
    _weigh(task, room, point, stretch, 1.0)


@subroutine
def _limit(row: Any, inertia: Any, pull: Any, low: Any, high: Any) -> Any:
    """Fill a row: low <= inertia * s̈ + pull * x <= high, solved for s̈."""
    if inertia < 0.0:
        inertia, pull, low, high = -inertia, -pull, -high, -low
    each = 1.0 / max(inertia, _NO_INERTIA)
    row[0], row[1], row[2] = pull * each, low * each, high * each


@subroutine
def limit_half(rows: Any, task: Any, room: Any, point: Any, share: Any, tightness: Any, shift: Any) -> Any:
    """Fill the rows of the torque limits at a grid point, where x is ``shift`` * s̈ more than the x of the rows."""
    for joint in range(task.joints):
        torque, load = share * task.torque[joint], room.load[point, joint]
        pull = room.pull[point, joint]
        inertia = room.inertia[point, joint] + shift * pull
        _limit(rows[joint], inertia, pull, (-torque - load) / tightness, (torque - load) / tightness)


@subroutine
def controllable(rows: Any, least: Any, most: Any, length: Any) -> Any:
    """From which x the change by ``length`` * s̈ leads to between ``least`` and ``most``: a linear program.

    By elimination: every lower limit of s̈ must lie below every upper one. An empty range has its ends exchanged.
    """
    slant = 1.0 / length
    end = rows[rows.shape[0] - 1]
    end[0], end[1], end[2] = slant, min(least * slant, most * slant), max(least * slant, most * slant)
    lowest, highest = 0.0, _FASTEST
    for upper in range(rows.shape[0]):
        for lower in range(rows.shape[0]):
            rise, room_left = rows[upper, 0] - rows[lower, 0], rows[upper, 2] - rows[lower, 1]
            if rise > 0.0:
                highest = min(highest, room_left / rise)
            elif rise < 0.0:
                lowest = max(lowest, room_left / rise)
            elif room_left < 0.0:
                return 1.0, 0.0
    return lowest, highest


@subroutine
def greatest_acceleration(rows: Any, x: Any) -> Any:
    """The greatest s̈ from x, the end being limited as it was for `controllable`."""
    greatest = np.inf
    for row in range(rows.shape[0]):
        greatest = min(greatest, rows[row, 2] - rows[row, 0] * x)
    return greatest


@subroutine
def _is_scaled(task: Any, room: Any, points: Any, steps: Any) -> Any:
    """Fill x along a curve of stretches of so many steps, rest to rest; False if there is none."""
    least, most, x, rows, length = room.least, room.most, room.x, room.rows, 1.0 / steps
    least[2 * points], most[2 * points] = 0.0, 0.0
    for half in range(2 * points - 1, -1, -1):
        share, tightness = room.shares[half // (2 * steps)], room.tightness[half // 2]
        shift = length if half % 2 == 1 else 0.0
        limit_half(rows[half], task, room, (half + 1) // 2, share, tightness, shift)
        low, high = controllable(rows[half], least[half + 1], most[half + 1], length)
        if high < low:
            return False
        least[half], most[half] = low, high
    if least[0] > _ROUNDING:
        return False
    x[0] = 0.0
    for half in range(2 * points):
        change = length * greatest_acceleration(rows[half], x[half])
        x[half + 1] = min(most[half + 1], max(least[half + 1], x[half] + change))
    return True


@subroutine
def scale_time(task: Any, room: Any, points: Any, steps: Any) -> Any:
    """Fill x along a curve of stretches of so many steps, rest to rest; returns the time, inf if there is none."""
    x, slowdown = room.x, 1.0
    room.tightness[:points] = 1.0
    for _ in range(_ROUNDS):
        if not _is_scaled(task, room, points, steps):
            return np.inf
        slowdown = _tighten(task, room, points, steps)
        if slowdown <= _TIGHT_ENOUGH:
            break
    time = 0.0
    for point in range(points):
        time += step_time(x[2 * point], x[2 * point + 1], x[2 * point + 2], 1.0 / steps)
    if not time < np.inf:
        return np.inf
    for place in range(2 * points + 1):
        x[place] /= slowdown
    return time * np.sqrt(slowdown)


@subroutine
def step_time(first: Any, middle: Any, last: Any, length: Any) -> Any:
    """The integral of 1 / √x along a step on which x is the parabola of these Bézier points, s."""
    speeds = np.sqrt(first) + np.sqrt(last)
    if speeds <= 0.0:
        return np.inf
    bend = (first - 2.0 * middle + last) / (speeds * speeds)
    if bend >= 1.0:
        return np.inf
    if abs(bend) < 1e-3:
        factor = 1.0 + bend * (1.0 / 3.0 + bend * (0.2 + bend * (1.0 / 7.0 + bend / 9.0)))
    elif bend > 0.0:
        factor = np.arctanh(np.sqrt(bend)) / np.sqrt(bend)
    else:
        factor = np.arctan(np.sqrt(-bend)) / np.sqrt(-bend)
    return 2.0 * length / speeds * factor


@subroutine
def _tighten(task: Any, room: Any, points: Any, steps: Any) -> Any:
    """Tighten the limits of steps on which torques exceed theirs.

    Returns by how much x must be divided for the limits to hold between grid points too; at least 1. What the torques
    are made of there is interpolated between the grid points of the stretch.
    """
    a, b, c = room.middle[0], room.middle[1], room.middle[2]
    slowdown = 1.0
    for point in range(points):
        stretch, divisor = point // steps, 1.0
        place = min(max(point - 1, stretch * steps), (stretch + 1) * steps - 3)
        first, middle, last = room.x[2 * point], room.x[2 * point + 1], room.x[2 * point + 2]
        for quarter in range(1, 4):
            share = 0.25 * quarter
            push = steps * ((middle - first) * (1.0 - share) + (last - middle) * share)
            x = first * (1.0 - share) ** 2 + 2.0 * middle * share * (1.0 - share) + last * share**2
            weights = _cubic(point - place + share)
            _interpolate(room.inertia, place, weights, a)
            _interpolate(room.pull, place, weights, b)
            _interpolate(room.load, place, weights, c)
            for joint in range(task.joints):
                limit = room.shares[stretch] * task.torque[joint]
                moving = a[joint] * push + b[joint] * x
                left = limit - c[joint] if moving > 0.0 else limit + c[joint]
                if abs(moving) > divisor * left:
                    divisor = abs(moving) / max(left, _ROUNDING * limit)
        room.tightness[point] *= divisor
        slowdown = max(slowdown, divisor)
    return slowdown


@subroutine
def _cubic(place: Any) -> Any:
    """The weights of values at 0, 1, 2 and 3 in their cubic's value at a place."""
    one, two, three = place - 1.0, place - 2.0, place - 3.0
    return (
        -one * two * three / 6.0,
        place * two * three / 2.0,
        -place * one * three / 2.0,
        place * one * two / 6.0,
    )


@subroutine
def _interpolate(values: Any, place: Any, weights: Any, result: Any) -> Any:
    """Fill ``result`` with the sum of four rows of values, from ``place`` on, times weights."""
    for joint in range(result.size):
        result[joint] = (
            weights[0] * values[place, joint]
            + weights[1] * values[place + 1, joint]
            + weights[2] * values[place + 2, joint]
            + weights[3] * values[place + 3, joint]
        )


@subroutine
def is_at_goal(task: Any) -> Any:
    """Whether there is nothing to do."""
    return np.all(task.ends[0] == task.ends[1])


@subroutine
def _travel(genome: Any, task: Any, room: Any) -> Any:
    """The time of a genome's trajectory, s, and its number of steps."""
    stretches = lay_out(genome, task, room)
    if stretches == 0:
        return (0.0 if is_at_goal(task) else np.inf), 0
    return travel_nodes(stretches, task, room)


@subroutine
def travel_nodes(stretches: Any, task: Any, room: Any) -> Any:
    """Likewise of the nodes and shares in the room."""
    steps = points_of(stretches)
    for stretch in range(stretches):
        weigh_stretch(task, room, stretch, stretch * steps, steps)
    weigh_end(task, room, stretches - 1, stretches * steps)
    return scale_time(task, room, stretches * steps, steps), stretches * steps


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """The travel time of each trajectory, s, +inf if the torque limits forbid it."""
    task, room = task_of(table), room_for(table)
    for row in range(fitness.size):
        fitness[row] = _travel(genomes[row], task, room)[0]


@subroutine
def _standing(task: Any, room: Any) -> Any:
    """One row: at rest at the start."""
    rows = np.zeros((1, 5, task.joints))
    room.nodes[:4] = task.ends[0]
    _weigh(task, room, 0, 0, 0.0)
    rows[0, 1], rows[0, 4] = task.ends[0], room.load[0]
    return rows


@kernel("Tuple((float64[:,::1], float64[:,:,::1]))(uint8[::1], int64[:,::1])")
def follow(genome: Genomes, table: Table) -> tuple[Floats, Floats]:
    """The trajectory of a feasible genome.

    Returns:
        The nodes, start and goal included, rad, shape (nodes, joints).
        At each grid point a row of the time in all columns (s), angles (rad), speeds (rad/s), accelerations (rad/s²)
        and torques (N·m), shape (points, 5, joints); accelerations are those with which the step that begins there
        begins, at the last point those with which the last step ends.
    """
    task, room = task_of(table), room_for(table)
    _, points = _travel(genome, task, room)
    if points == 0:
        return task.ends.copy(), _standing(task, room)
    stretches = np.int64(numbers_of(genome)[0])
    steps = points // stretches
    rows = np.empty((points + 1, 5, task.joints))
    time, push = 0.0, 0.0
    for point in range(points + 1):
        stretch = min(point // steps, stretches - 1)
        place_on_curve(room.nodes, stretch, (point - stretch * steps) / steps, room.angles, room.slope, room.bend)
        x = room.x[2 * point]
        push = steps * (room.x[2 * point + 1] - x if point < points else x - room.x[2 * point - 1])
        rows[point, 0] = time
        rows[point, 1] = room.angles
        rows[point, 2] = np.sqrt(x) * room.slope
        rows[point, 3] = push * room.slope + x * room.bend
        rows[point, 4] = push * room.inertia[point] + x * room.pull[point] + room.load[point]
        if point < points:
            time += step_time(x, room.x[2 * point + 1], room.x[2 * point + 2], 1.0 / steps)
    return room.nodes[1 : stretches + 2].copy(), rows
