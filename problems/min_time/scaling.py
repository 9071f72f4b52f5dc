"""Compiled time scaling: the least time in which an arm follows a curve within its limits, from rest to rest.

The unknown is x = ṡ² on a grid of s (Bobrow, Dubowsky and Gibson 1985; Shin and McKay 1985). A backward pass finds the
controllable sets, a forward pass takes the greatest acceleration that stays in them (Pham and Pham 2018, TOPP-RA).

Unlike in TOPP-RA, s̈ is linear in s on each step, not constant, so x is a parabola there, and the error falls with the
square of the step. A parabola has three Bézier points. The first two differ by s̈ at the step's beginning times the
step's length, the last two by s̈ at its end times the length. The limits of torque and joint acceleration hold at both
ends of a step, each with the s̈ there. So each half of a step is a linear program in two unknowns, s̈ and x, which
elimination solves exactly. Points where a joint's inertia along the curve vanishes need no special case. A limit of
joint speed bounds x itself, at the ends of the step and at its middle Bézier point.

Between grid points the limits may still be exceeded, by an error of second order. Where they are, the limits of that
step are tightened and time is scaled again; in the end the whole motion is slowed down by what little excess is left.

Arrays of x and its bounds have 2 · steps + 1 entries: grid points at even places, middle Bézier points at odd places.
"""

from typing import Any, NamedTuple

import numpy as np

from lowlevel.compiled import inlined, subroutine
from problems.min_time.dynamics import scaled_chain, scaled_two_links

POINTS_OF_STRETCH, POINTS = 8, 128
"""The least number of steps of a stretch between two nodes, and of a whole curve."""

_PARTS = 8  # limits are checked at the places between so many equal parts of a step
_ROUNDS = 4  # the most rounds of tightening the limits
_TIGHT_ENOUGH = 1.002  # a slowdown of squared speeds that ends the rounds: a thousandth of the time
_FASTEST = 1e12  # the bound of ṡ² where nothing limits it; no real motion comes near it
_NO_INERTIA = 1e-9  # kg m²: a smaller inertia along the curve is replaced by this, so that nothing is divided by 0
_ROUNDING = 1e-9


class Task(NamedTuple):
    """The problem as the kernels take it: the arm, its limits, and both ends."""

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
    """The working arrays of one curve, large enough for the longest; each evaluation overwrites them."""

    nodes: Any  # (most nodes + 3, joints), rad: control points with phantom ends
    shares: Any  # (most nodes,): the share of the torque limits that each stretch may use
    angles: Any  # (joints,), rad: at one point
    still: Any  # (joints,), zeros
    slope: Any  # (points + 1, joints): the first derivative by s
    bend: Any  # (points + 1, joints): the second derivative by s
    inertia: Any  # (points + 1, joints): a of `problems.min_time.dynamics`
    pull: Any  # (points + 1, joints): b
    load: Any  # (points + 1, joints): c
    rows: Any  # (2 * points, limits + 1, 3): slant, low, high of a half step's limits, low <= s̈ + slant * x <= high
    caps: Any  # (2 * points + 1,): the greatest x by the speed limits
    least: Any  # (2 * points + 1,): the least controllable x
    most: Any  # (2 * points + 1,): the greatest controllable x
    x: Any  # (2 * points + 1,)
    tightness: Any  # (points,): divisor of the limits of a step's moving torques and accelerations
    speeds: Any  # (points + 1,): ṡ at equally spaced moments


@subroutine
def room_of(task: Any, stretches: Any, points: Any) -> Any:
    """Return working arrays for so many stretches and steps."""
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
    """Fill the control points before the first node and after the last one, so that the spline ends in the nodes."""
    for joint in range(nodes.shape[1]):
        nodes[0, joint] = 2.0 * nodes[1, joint] - nodes[2, joint]
        nodes[stretches + 2, joint] = 2.0 * nodes[stretches + 1, joint] - nodes[stretches, joint]


@subroutine
def place_on_curve(nodes: Any, stretch: Any, share: Any, angles: Any, slope: Any, bend: Any) -> Any:
    """Fill the curve and its first two derivatives by s, at a share of a stretch."""
    rest = 1.0 - share
    for joint in range(nodes.shape[1]):
        one, two = nodes[stretch, joint], nodes[stretch + 1, joint]
        three, four = nodes[stretch + 2, joint], nodes[stretch + 3, joint]
        # Second differences of the control points: the second derivative runs linearly from the first to the second.
        before, after = one - 2.0 * two + three, two - 2.0 * three + four
        angles[joint] = rest * two + share * three + (rest * rest * rest * before + share * share * share * after) / 6.0
        slope[joint] = three - two + 0.5 * (share * share * after - rest * rest * before)
        bend[joint] = rest * before + share * after


@subroutine
def weigh(task: Any, room: Any, point: Any, stretch: Any, share: Any) -> Any:
    """Fill the derivatives, a, b and c at a grid point; this counts as one evaluation of the inverse dynamics."""
    slope, bend = room.slope[point], room.bend[point]
    place_on_curve(room.nodes, stretch, share, room.angles, slope, bend)
    a, b, c = room.inertia[point], room.pull[point], room.load[point]
    if task.is_chain:
        scaled_chain(task.chain, room.angles, slope, bend, room.still, a, b, c)
    else:
        scaled_two_links(task.links, room.angles, slope, bend, a, b, c)


@subroutine
def weigh_stretch(task: Any, room: Any, stretch: Any, first: Any, steps: Any) -> Any:
    """Weigh all grid points of a stretch except its end, from grid point ``first`` on."""
    for step in range(steps):
        weigh(task, room, first + step, stretch, step / steps)


@subroutine
def weigh_end(task: Any, room: Any, stretch: Any, point: Any) -> Any:
    """Weigh the grid point at the end of a stretch."""
    weigh(task, room, point, stretch, 1.0)


# Limits ---------------------------------------------------------------------------------------------------------------
@subroutine
def cap_speeds(task: Any, room: Any, first: Any, points: Any, steps: Any) -> Any:
    """Fill the greatest x that the speed limits allow, on ``points`` steps from grid point ``first`` on.

    The cap of a middle Bézier point is such that the parabola of all three caps has in its middle what is allowed
    there. It is kept between half of what is allowed there and all of it: where no joint moves at an end of the step,
    that end's cap is huge and would make the middle one negative.
    """
    for point in range(first, first + points + 1):
        greatest = 0.0
        for joint in range(task.joints):
            greatest = max(greatest, abs(room.slope[point, joint]) / task.velocity[joint])
        room.caps[2 * point] = _cap(greatest)
    for point in range(first, first + points):
        greatest = 0.0
        for joint in range(task.joints):
            # The slope in the middle of the step. The slope is a parabola in s along a stretch, so this is exact.
            turned = room.bend[point + 1, joint] - room.bend[point, joint]
            slope = 0.5 * (room.slope[point, joint] + room.slope[point + 1, joint]) - turned / (8.0 * steps)
            greatest = max(greatest, abs(slope) / task.velocity[joint])
        middle = _cap(greatest)
        even = 2.0 * middle - 0.5 * (room.caps[2 * point] + room.caps[2 * point + 2])
        room.caps[2 * point + 1] = min(middle, max(0.5 * middle, even))


@subroutine
def _cap(share: Any) -> Any:
    """Return the greatest x where a joint has this share of its speed limit at ṡ = 1."""
    return _FASTEST if share * share * _FASTEST <= 1.0 else 1.0 / (share * share)


@subroutine
def _limit(row: Any, inertia: Any, pull: Any, low: Any, high: Any) -> Any:
    """Fill a row with low <= inertia * s̈ + pull * x <= high, solved for s̈.

    With hardly any inertia the row still bounds x alone, by pull * x, so such points are rows like any other.
    """
    # A row bounds s̈ from both sides, so a negative factor exchanges its sides.
    if inertia < 0.0:
        inertia, pull, low, high = -inertia, -pull, -high, -low
    each = 1.0 / max(inertia, _NO_INERTIA)
    row[0], row[1], row[2] = pull * each, low * each, high * each


@subroutine
def limit_half(rows: Any, task: Any, room: Any, point: Any, share: Any, tightness: Any, shift: Any) -> Any:
    """Fill the rows of the limits at a grid point, where x is ``shift`` * s̈ more than the x of the rows.

    ``share`` is the share of the torque limits that the stretch may use. ``tightness`` divides what is left for motion;
    the load of gravity is not divided, since no slower motion lessens it.
    """
    for joint in range(task.joints):
        # x at the grid point is the row's x plus shift * s̈, so a s̈ + b x becomes (a + b * shift) s̈ + b * (the row's
        # x).
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
    """Return the range of x from which some allowed s̈ leads to x + ``length`` * s̈ in [``least``, ``most``].

    This linear program is solved exactly, by elimination of s̈: each lower limit of s̈ must lie below each upper one.
    An empty range is returned with its lower end above its upper end. A negative ``length`` goes backwards in s.
    """
    slant = 1.0 / length
    # The last row holds the target: least <= x + length * s̈ <= most, divided by the length.
    end = rows[rows.shape[0] - 1]
    end[0], end[1], end[2] = slant, min(least * slant, most * slant), max(least * slant, most * slant)
    lowest, highest = 0.0, _FASTEST
    for upper in range(rows.shape[0]):
        for lower in range(rows.shape[0]):
            # From s̈ <= high - slant * x of one row and s̈ >= low - slant * x of the other: rise * x <= room_left.
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
    """Return the greatest s̈ that all rows allow at x; the last row is the target range that `controllable` wrote."""
    greatest = np.inf
    for row in range(rows.shape[0]):
        greatest = min(greatest, rows[row, 2] - rows[row, 0] * x)
    return greatest


@subroutine
def _is_scaled(task: Any, room: Any, points: Any, steps: Any) -> Any:
    """Fill x along a curve of stretches of ``steps`` steps, rest to rest; return False if the limits forbid it."""
    least, most, x, rows, length = room.least, room.most, room.x, room.rows, 1.0 / steps
    # Backwards from rest at the goal: the x from which the rest of the curve can be followed.
    least[2 * points], most[2 * points] = 0.0, 0.0
    for half in range(2 * points - 1, -1, -1):
        share, tightness = room.shares[half // (2 * steps)], room.tightness[half // 2]
        # The limits of the first half hold at the step's beginning, where x is the row's own. Those of the second half
        # hold at its end, where x is the middle Bézier point, which is the row's x, plus length * s̈.
        shift = length if half % 2 == 1 else 0.0
        limit_half(rows[half], task, room, (half + 1) // 2, share, tightness, shift)
        low, high = controllable(rows[half], least[half + 1], most[half + 1], length)
        high = min(high, room.caps[half])
        if high < low:
            return False
        least[half], most[half] = low, high
    # The arm starts at rest, which must be among the controllable x.
    if least[0] > _ROUNDING:
        return False
    x[0] = 0.0
    for half in range(2 * points):
        # x stays in the controllable sets by construction; the clamp only takes off rounding errors.
        change = length * greatest_acceleration(rows[half], x[half])
        x[half + 1] = min(most[half + 1], max(least[half + 1], x[half] + change))
    return True


@subroutine
def scale_time(task: Any, room: Any, points: Any, steps: Any) -> Any:
    """Fill x along a curve of stretches of ``steps`` steps, rest to rest; return the time, s, inf if there is none.

    Jerk is not limited here: see `problems.min_time.smoothing`.
    """
    x, slowdown = room.x, 1.0
    room.tightness[:points] = 1.0
    cap_speeds(task, room, 0, points, steps)
    for _ in range(_ROUNDS):
        if not _is_scaled(task, room, points, steps):
            return np.inf
        # Tightening accumulates from round to round.
        slowdown = _tighten(task, room, points, steps)
        if slowdown <= _TIGHT_ENOUGH:
            break
    time = 0.0
    for point in range(points):
        time += step_time(x[2 * point], x[2 * point + 1], x[2 * point + 2], 1.0 / steps)
    if not time < np.inf:
        return np.inf
    # s̈ and ṡ² fall by the same factor, and with them all moving torques and accelerations: one factor is enough.
    for place in range(2 * points + 1):
        x[place] /= slowdown
    return time * np.sqrt(slowdown)


@subroutine
def step_time(first: Any, middle: Any, last: Any, length: Any) -> Any:
    """Return the time of a step, s: the integral of 1 / √x, where x is the parabola of these Bézier points.

    It has a closed form. Return inf where x reaches 0 within the step, because the motion would not pass that place.
    """
    speeds = np.sqrt(first) + np.sqrt(last)
    if speeds <= 0.0:
        return np.inf
    bend = (first - 2.0 * middle + last) / (speeds * speeds)
    if bend >= 1.0:
        return np.inf
    if abs(bend) < 1e-3:  # the series of artanh(√b) / √b, where the quotient would lose digits
        factor = 1.0 + bend * (1.0 / 3.0 + bend * (0.2 + bend * (1.0 / 7.0 + bend / 9.0)))
    elif bend > 0.0:
        factor = np.arctanh(np.sqrt(bend)) / np.sqrt(bend)
    else:
        factor = np.arctan(np.sqrt(-bend)) / np.sqrt(-bend)
    return 2.0 * length / speeds * factor


# Between grid points --------------------------------------------------------------------------------------------------
@subroutine
def _tighten(task: Any, room: Any, points: Any, steps: Any) -> Any:
    """Tighten the limits of the steps between whose ends they are exceeded.

    Returns:
        The divisor of x, at least 1, with which the limits hold between grid points too.
    """
    slowdown = 1.0
    for point in range(points):
        divisor, excess = 1.0, 1.0
        first, middle, last = room.x[2 * point], room.x[2 * point + 1], room.x[2 * point + 2]
        for part in range(1, _PARTS):
            share = part / _PARTS
            # s̈ is half of the slope of x; a parabola's slope is linear between the differences of its Bézier points.
            push = steps * ((middle - first) * (1.0 - share) + (last - middle) * share)
            x = first * (1.0 - share) ** 2 + 2.0 * middle * share * (1.0 - share) + last * share**2
            forced, fast, _ = exceeded_at(task, room, point, share, steps, push, x, 0.0)
            divisor, excess = max(divisor, forced), max(excess, fast)
        room.tightness[point] *= divisor
        # A step's caps are those of its two ends and its middle; neighbours share the ends, so they become slower there
        # too.
        for place in range(2 * point, 2 * point + 3):
            room.caps[place] /= excess
        slowdown = max(slowdown, divisor, excess)
    return slowdown


@inlined
def exceeded_at(task: Any, room: Any, point: Any, share: Any, steps: Any, push: Any, x: Any, surge: Any) -> Any:
    """Return how far limits are used or exceeded at a share of a step, where s̈ is ``push`` and ṡ is √x.

    The curve's derivatives, a, b and c are interpolated by cubics through four grid points of the stretch, so the
    inverse dynamics are not evaluated again. For the derivatives, which are polynomials there, that is exact.

    Returns:
        The divisor of both s̈ and x with which torques and accelerations hold; the divisor of x with which speeds hold;
        and the greatest share of its limit that a jerk has, where ``surge`` is the third derivative of s by time.
    """
    stretch = point // steps
    # The four points must be of one stretch: at nodes the third derivative jumps, and a cubic across them would be off.
    place = min(max(point - 1, stretch * steps), (stretch + 1) * steps - 3)
    one = point - place + share
    two, three, four = one - 1.0, one - 2.0, one - 3.0
    w1, w2, w3, w4 = (  # Lagrange's weights
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
        # Gravity's load takes its part of the limit; only the rest is left for the torque that moves the arm.
        left = max(limit - c if moving > 0.0 else limit + c, _ROUNDING * limit)
        divisor = max(divisor, abs(moving) / left)
        first = w1 * slope[place, j] + w2 * slope[place + 1, j] + w3 * slope[place + 2, j] + w4 * slope[place + 3, j]
        second = w1 * bend[place, j] + w2 * bend[place + 1, j] + w3 * bend[place + 2, j] + w4 * bend[place + 3, j]
        fastest = max(fastest, abs(first) / task.velocity[j])
        divisor = max(divisor, abs(first * push + second * x) / task.acceleration[j])
        third = steps * (bend[place + 1, j] - bend[place, j])  # constant along a stretch
        jerk = max(jerk, abs(third * speed * x + 3.0 * second * speed * push + first * surge) / task.jerk[j])
    return divisor, fastest * fastest * x, jerk
