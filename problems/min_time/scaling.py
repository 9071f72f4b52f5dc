"""Time scaling, compiled: the least time in which an arm follows a curve within its limits, rest to rest.

It goes in x = ṡ² over a grid of s (Bobrow, Dubowsky and Gibson 1985; Shin and McKay 1985), by controllable sets
backwards and the greatest acceleration forwards (Pham and Pham 2018, TOPP-RA). On each step s̈ is linear in s, so x is a
parabola, whose ends and middle Bézier point lie half a step's constant s̈ apart; the limits of torque and of joint
acceleration hold at both ends of the step, each with the s̈ there. So each half of a step is a linear program in two
unknowns, which elimination solves exactly, and points where a joint's inertia along the curve vanishes need no case of
their own. A limit of joint speed bounds x itself, at the ends of the step and at its middle Bézier point.

Between grid points limits may still be exceeded, by an error of second order: where they are, those of the step are
tightened and time is scaled again, and in the end the whole motion is slowed down by the little that is left.
"""

from typing import Any, NamedTuple

import numpy as np

from lowlevel.compiled import inlined, subroutine
from problems.min_time.dynamics import scaled_chain, scaled_two_links

POINTS_OF_STRETCH, POINTS = 8, 128
"""The least number of steps that a stretch between two nodes, and a whole curve, is cut into."""

_PARTS = 8  # of a step, between which limits are looked at
_ROUNDS = 4  # of tightening limits, at most
_TIGHT_ENOUGH = 1.002  # of the squared speeds: a thousandth of the time
_FASTEST = 1e12  # greatest ṡ²: nothing real comes near it
_NO_INERTIA = 1e-9  # kg m²: less counts as this much
_ROUNDING = 1e-9


class Task(NamedTuple):
    """What a trajectory is judged by."""

    joints: Any
    is_chain: Any
    is_gradual: Any  # whether joint accelerations are limited
    is_smooth: Any  # whether jerks are limited
    greatest: Any  # (joints,), genes at the goal
    ends: Any  # (2, joints), rad: start and goal
    torque: Any  # (joints,), N·m
    velocity: Any  # (joints,), rad/s, inf where there is no limit, as the following
    acceleration: Any  # (joints,), rad/s²
    jerk: Any  # (joints,), rad/s³
    links: Any  # (5,)
    chain: Any


class Room(NamedTuple):
    """Where a curve is worked out; sizes for the longest."""

    nodes: Any  # (most nodes + 3, joints), rad: control points with phantom ends
    shares: Any  # (most nodes,): of the torque limits, on each stretch
    angles: Any  # (joints,), rad: at one point
    still: Any  # (joints,), zeros
    slope: Any  # (points + 1, joints): the first derivative by s
    bend: Any  # (points + 1, joints): the second
    inertia: Any  # (points + 1, joints): a
    pull: Any  # (points + 1, joints): b
    load: Any  # (points + 1, joints): c
    rows: Any  # (2 * points, limits + 1, 3): limits of a half step as low <= s̈ + slant * x <= high: slant, low, high
    caps: Any  # (2 * points + 1,): the greatest x by the speed limits; that of the parabola's middle at odd places
    least: Any  # (2 * points + 1,): of the controllable x, likewise
    most: Any  # (2 * points + 1,)
    x: Any  # (2 * points + 1,)
    tightness: Any  # (points,): what the limits of a step's moving torques and accelerations are divided by
    speeds: Any  # (points + 1,): ṡ at even moments


@subroutine
def room_of(task: Any, stretches: Any, points: Any) -> Any:
    """Room for so many stretches and steps."""
    joints = task.joints
    limits = 2 * joints if task.is_gradual else joints
    return Room(
        np.empty((stretches + 3, joints)),
        np.empty(stretches),
        np.empty(joints),
        np.zeros(joints),
        np.empty((points + 1, joints)),
        np.empty((points + 1, joints)),
        np.empty((points + 1, joints)),
        np.empty((points + 1, joints)),
        np.empty((points + 1, joints)),
        np.empty((2 * points, limits + 1, 3)),
        np.empty(2 * points + 1),
        np.empty(2 * points + 1),
        np.empty(2 * points + 1),
        np.empty(2 * points + 1),
        np.empty(points),
        np.empty(points + 1),
    )


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
def weigh(task: Any, room: Any, point: Any, stretch: Any, share: Any) -> Any:
    """Fill the derivatives, a, b and c at a grid point: one evaluation of the inverse dynamics."""
    slope, bend = room.slope[point], room.bend[point]
    place_on_curve(room.nodes, stretch, share, room.angles, slope, bend)
    a, b, c = room.inertia[point], room.pull[point], room.load[point]
    if task.is_chain:
        scaled_chain(task.chain, room.angles, slope, bend, room.still, a, b, c)
    else:
        scaled_two_links(task.links, room.angles, slope, bend, a, b, c)


@subroutine
def weigh_stretch(task: Any, room: Any, stretch: Any, first: Any, steps: Any) -> Any:
    """Weigh all grid points of a stretch, but for its end, from grid point ``first`` on."""
    for step in range(steps):
        weigh(task, room, first + step, stretch, step / steps)


@subroutine
def weigh_end(task: Any, room: Any, stretch: Any, point: Any) -> Any:
    """Weigh the grid point at the end of a stretch."""
    weigh(task, room, point, stretch, 1.0)


# Limits ---------------------------------------------------------------------------------------------------------------
@subroutine
def cap_speeds(task: Any, room: Any, first: Any, points: Any, steps: Any) -> Any:
    """Fill the greatest x that the speed limits allow, on so many steps from grid point ``first`` on.

    That of a middle Bézier point is such that the parabola through all three greatest x has in its middle what is
    allowed there, but not more than that, and at least half of it: near a place where no joint moves, any x is allowed.
    """
    for point in range(first, first + points + 1):
        greatest = 0.0
        for joint in range(task.joints):
            greatest = max(greatest, abs(room.slope[point, joint]) / task.velocity[joint])
        room.caps[2 * point] = _cap(greatest)
    for point in range(first, first + points):
        greatest = 0.0
        for joint in range(task.joints):
            turned = room.bend[point + 1, joint] - room.bend[point, joint]
            slope = 0.5 * (room.slope[point, joint] + room.slope[point + 1, joint]) - turned / (8.0 * steps)
            greatest = max(greatest, abs(slope) / task.velocity[joint])
        middle = _cap(greatest)
        even = 2.0 * middle - 0.5 * (room.caps[2 * point] + room.caps[2 * point + 2])
        room.caps[2 * point + 1] = min(middle, max(0.5 * middle, even))


@subroutine
def _cap(share: Any) -> Any:
    """The greatest x where a joint has this share of its speed limit at ṡ = 1."""
    return _FASTEST if share * share * _FASTEST <= 1.0 else 1.0 / (share * share)


@subroutine
def _limit(row: Any, inertia: Any, pull: Any, low: Any, high: Any) -> Any:
    """Fill a row: low <= inertia * s̈ + pull * x <= high, solved for s̈."""
    if inertia < 0.0:
        inertia, pull, low, high = -inertia, -pull, -high, -low
    each = 1.0 / max(inertia, _NO_INERTIA)
    row[0], row[1], row[2] = pull * each, low * each, high * each


@subroutine
def limit_half(rows: Any, task: Any, room: Any, point: Any, share: Any, tightness: Any, shift: Any) -> Any:
    """Fill the rows of the limits at a grid point, where x is ``shift`` * s̈ more than the x of the rows."""
    for joint in range(task.joints):
        torque, load = share * task.torque[joint], room.load[point, joint]
        pull = room.pull[point, joint]
        inertia = room.inertia[point, joint] + shift * pull
        _limit(rows[joint], inertia, pull, (-torque - load) / tightness, (torque - load) / tightness)
    if task.is_gradual:
        for joint in range(task.joints):
            most, bend = task.acceleration[joint] / tightness, room.bend[point, joint]
            _limit(rows[task.joints + joint], room.slope[point, joint] + shift * bend, bend, -most, most)


# The linear programs --------------------------------------------------------------------------------------------------
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
        high = min(high, room.caps[half])
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
    """Fill x along a curve of stretches of so many steps, rest to rest; returns the time, inf if there is none.

    Jerk is not limited here: see `problems.min_time.smoothing`.
    """
    x, slowdown = room.x, 1.0
    room.tightness[:points] = 1.0
    cap_speeds(task, room, 0, points, steps)
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


# Between grid points --------------------------------------------------------------------------------------------------
@subroutine
def _tighten(task: Any, room: Any, points: Any, steps: Any) -> Any:
    """Tighten the limits of steps on which they are exceeded.

    Returns by how much x must be divided for the limits to hold between grid points too; at least 1.
    """
    slowdown = 1.0
    for point in range(points):
        divisor, excess = 1.0, 1.0
        first, middle, last = room.x[2 * point], room.x[2 * point + 1], room.x[2 * point + 2]
        for part in range(1, _PARTS):
            share = part / _PARTS
            push = steps * ((middle - first) * (1.0 - share) + (last - middle) * share)
            x = first * (1.0 - share) ** 2 + 2.0 * middle * share * (1.0 - share) + last * share**2
            forced, fast, _ = exceeded_at(task, room, point, share, steps, push, x, 0.0)
            divisor, excess = max(divisor, forced), max(excess, fast)
        room.tightness[point] *= divisor
        for place in range(2 * point, 2 * point + 3):
            room.caps[place] /= excess
        slowdown = max(slowdown, divisor, excess)
    return slowdown


@inlined
def exceeded_at(task: Any, room: Any, point: Any, share: Any, steps: Any, push: Any, x: Any, surge: Any) -> Any:
    """How far limits are exceeded, or used, at a share of a step, where s̈ is ``push`` and ṡ is √x.

    The curve's derivatives, a, b and c are those of cubics through four grid points of the stretch; for the
    derivatives, which are polynomials there, that is exact.

    Returns:
        By what s̈ and x must both be divided for torques and accelerations to hold; by what x for speeds; and the
        greatest share of its limit that a jerk has, ``surge`` being the third derivative of s by time.
    """
    stretch = point // steps
    place = min(max(point - 1, stretch * steps), (stretch + 1) * steps - 3)
    one = point - place + share
    two, three, four = one - 1.0, one - 2.0, one - 3.0
    w1, w2, w3, w4 = (
        -two * three * four / 6.0,
        one * three * four / 2.0,
        -one * two * four / 2.0,
        one * two * three / 6.0,
    )
    slope, bend, inertia, pull, load = room.slope, room.bend, room.inertia, room.pull, room.load
    speed, full = np.sqrt(x), room.shares[stretch]
    divisor, fastest, jerk = 0.0, 0.0, 0.0
    for j in range(task.joints):
        a = (
            w1 * inertia[place, j]
            + w2 * inertia[place + 1, j]
            + w3 * inertia[place + 2, j]
            + w4 * inertia[place + 3, j]
        )
        b = w1 * pull[place, j] + w2 * pull[place + 1, j] + w3 * pull[place + 2, j] + w4 * pull[place + 3, j]
        c = w1 * load[place, j] + w2 * load[place + 1, j] + w3 * load[place + 2, j] + w4 * load[place + 3, j]
        limit, moving = full * task.torque[j], a * push + b * x
        left = max(limit - c if moving > 0.0 else limit + c, _ROUNDING * limit)
        divisor = max(divisor, abs(moving) / left)
        first = w1 * slope[place, j] + w2 * slope[place + 1, j] + w3 * slope[place + 2, j] + w4 * slope[place + 3, j]
        second = w1 * bend[place, j] + w2 * bend[place + 1, j] + w3 * bend[place + 2, j] + w4 * bend[place + 3, j]
        fastest = max(fastest, abs(first) / task.velocity[j])
        divisor = max(divisor, abs(first * push + second * x) / task.acceleration[j])
        third = steps * (bend[place + 1, j] - bend[place, j])  # constant along a stretch
        jerk = max(jerk, abs(third * speed * x + 3.0 * second * speed * push + first * surge) / task.jerk[j])
    return divisor, fastest * fastest * x, jerk
