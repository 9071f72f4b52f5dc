"""Compiled inverse dynamics of serial arms, split into the coefficients that time scaling needs.

Along a path q(s) the torques are τ = a s̈ + b ṡ² + c, with a = M q', b = M q'' + C(q, q') q' and c the load of gravity.
They are linear in s̈ and ṡ², so a, b and c are computed once for each grid point, whatever the speed there turns out to
be. Two planar links use a closed form. Any other arm uses the recursive Newton-Euler algorithm (Luh, Walker and Paul
1980) in the frames of its joints.
"""

from typing import Any, NamedTuple

import numpy as np

from lowlevel.compiled import subroutine
from problems.vectors import cross, dot

# First columns of the parts of a joint's row: the rotation and position of its frame in the frame before it, its axis,
# and the mass, centre of mass and inertia of its body, all in the joint's frame. `Arm.rows` fills them in this order.
ROTATION, PLACE, AXIS, MASS, CENTRE, INERTIA = 0, 9, 12, 15, 16, 19
COLUMNS = 28


class Chain(NamedTuple):
    """An arm and the working arrays of its inverse dynamics.

    The arrays are overwritten by every evaluation, so a chain belongs to one kernel call.
    """

    joints: Any  # (n, COLUMNS)
    gravity: Any  # (3,), m/s², in the frame of the base
    turns: Any  # (n, 3, 3): rotation from each joint's frame to the one before
    turning: Any  # (n, 3), rad/s: angular velocity
    swinging: Any  # (n, 3), rad/s²: angular acceleration
    force: Any  # (n, 3), N: first the force on each body, after the backward pass the force that its joint transmits
    moment: Any  # (n, 3), N·m: likewise


@subroutine
def chain_of(joints: Any, gravity: Any) -> Any:
    """Return a `Chain` with working arrays of its own."""
    n = joints.shape[0]
    return Chain(
        joints, gravity, np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    )


@subroutine
def _plus(one: Any, other: Any) -> Any:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


@subroutine
def _times(factor: Any, vector: Any) -> Any:
    return factor * vector[0], factor * vector[1], factor * vector[2]


@subroutine
def _forth(turn: Any, vector: Any) -> Any:
    """Return a vector of a joint's frame in the coordinates of the frame before."""
    return (
        turn[0, 0] * vector[0] + turn[0, 1] * vector[1] + turn[0, 2] * vector[2],
        turn[1, 0] * vector[0] + turn[1, 1] * vector[1] + turn[1, 2] * vector[2],
        turn[2, 0] * vector[0] + turn[2, 1] * vector[1] + turn[2, 2] * vector[2],
    )


@subroutine
def _back(turn: Any, vector: Any) -> Any:
    """Return a vector of the frame before in the coordinates of a joint's frame: the rotation's transpose."""
    return (
        turn[0, 0] * vector[0] + turn[1, 0] * vector[1] + turn[2, 0] * vector[2],
        turn[0, 1] * vector[0] + turn[1, 1] * vector[1] + turn[2, 1] * vector[2],
        turn[0, 2] * vector[0] + turn[1, 2] * vector[1] + turn[2, 2] * vector[2],
    )


@subroutine
def _triple(row: Any, column: Any) -> Any:
    return row[column], row[column + 1], row[column + 2]


@subroutine
def _inertia_times(row: Any, vector: Any) -> Any:
    """Return the inertia about the centre of mass, times a vector."""
    return (
        dot(_triple(row, INERTIA), vector),
        dot(_triple(row, INERTIA + 3), vector),
        dot(_triple(row, INERTIA + 6), vector),
    )


@subroutine
def turn_joints(chain: Any, angles: Any) -> Any:
    """Set the rotation of each joint's frame for a configuration, rad."""
    for joint in range(chain.joints.shape[0]):
        row, turn = chain.joints[joint], chain.turns[joint]
        x, y, z = _triple(row, AXIS)
        cosine, sine = np.cos(angles[joint]), np.sin(angles[joint])
        rest = 1.0 - cosine
        about = (  # Rodrigues' formula, written out
            (cosine + x * x * rest, x * y * rest - z * sine, x * z * rest + y * sine),
            (y * x * rest + z * sine, cosine + y * y * rest, y * z * rest - x * sine),
            (z * x * rest - y * sine, z * y * rest + x * sine, cosine + z * z * rest),
        )
        for line in range(3):
            one, two, three = _triple(row, ROTATION + 3 * line)
            turn[line, 0] = one * about[0][0] + two * about[1][0] + three * about[2][0]
            turn[line, 1] = one * about[0][1] + two * about[1][1] + three * about[2][1]
            turn[line, 2] = one * about[0][2] + two * about[1][2] + three * about[2][2]


@subroutine
def inverse_dynamics(chain: Any, speed: Any, acceleration: Any, weight: Any, torque: Any) -> Any:
    """Fill ``torque``, N·m, by the recursive Newton-Euler algorithm.

    `turn_joints` must have set the frames. Joint speeds are in rad/s, accelerations in rad/s². ``weight`` switches
    gravity on (1) or off (0).
    """
    n = chain.joints.shape[0]
    turning, swinging = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    # The linear acceleration of the frame. An upward acceleration of the base stands for gravity on all bodies.
    rising = _times(-weight, chain.gravity)
    for joint in range(n):  # outwards: motion of each frame, force and moment on each body
        row, turn = chain.joints[joint], chain.turns[joint]
        place, axis, centre = _triple(row, PLACE), _triple(row, AXIS), _triple(row, CENTRE)
        rising = _plus(rising, _plus(cross(swinging, place), cross(turning, cross(turning, place))))
        # From here on all vectors are in the joint's own frame.
        rising, before, swinging = _back(turn, rising), _back(turn, turning), _back(turn, swinging)
        spin = _times(speed[joint], axis)
        turning = _plus(before, spin)
        swinging = _plus(swinging, _plus(_times(acceleration[joint], axis), cross(before, spin)))
        # Newton's law for the force and Euler's for the moment, both at the body's centre of mass.
        at_centre = _plus(rising, _plus(cross(swinging, centre), cross(turning, cross(turning, centre))))
        force = _times(row[MASS], at_centre)
        moment = _plus(_inertia_times(row, swinging), cross(turning, _inertia_times(row, turning)))
        moment = _plus(moment, cross(centre, force))
        for each in range(3):
            chain.force[joint, each], chain.moment[joint, each] = force[each], moment[each]
    for joint in range(n - 1, -1, -1):  # inwards: each joint transmits the loads of all bodies beyond it
        row, turn = chain.joints[joint], chain.turns[joint]
        torque[joint] = dot(_triple(row, AXIS), chain.moment[joint])
        if joint > 0:
            force, moment = _forth(turn, chain.force[joint]), _forth(turn, chain.moment[joint])
            # Moved from this joint's origin to that of the joint before.
            moment = _plus(moment, cross(_triple(row, PLACE), force))
            for each in range(3):
                chain.force[joint - 1, each] += force[each]
                chain.moment[joint - 1, each] += moment[each]


@subroutine
def scaled_chain(chain: Any, angles: Any, slope: Any, bend: Any, still: Any, a: Any, b: Any, c: Any) -> Any:
    """Fill a, b and c at a point of a path with q' ``slope`` and q'' ``bend``; ``still`` is an array of zeros."""
    # The inverse dynamics are M(q) q̈ + C(q, q̇) q̇ + g(q). Each call leaves only the terms of one coefficient.
    turn_joints(chain, angles)
    inverse_dynamics(chain, still, slope, 0.0, a)
    inverse_dynamics(chain, slope, bend, 0.0, b)
    inverse_dynamics(chain, still, still, 1.0, c)


@subroutine
def scaled_two_links(arm: Any, angles: Any, slope: Any, bend: Any, a: Any, b: Any, c: Any) -> Any:
    """Fill a, b and c for two planar links; ``arm`` holds the five constants of `Arm.two_links`."""
    cosine, sine = np.cos(angles[1]), np.sin(angles[1])
    # Entries of the mass matrix: [[inner, outer], [outer, arm[2]]].
    inner, outer = arm[0] + 2.0 * arm[1] * cosine, arm[2] + arm[1] * cosine
    a[0] = inner * slope[0] + outer * slope[1]
    a[1] = outer * slope[0] + arm[2] * slope[1]
    # The factor of the Coriolis and centrifugal terms.
    pull = arm[1] * sine
    b[0] = inner * bend[0] + outer * bend[1] - pull * (2.0 * slope[0] + slope[1]) * slope[1]
    b[1] = outer * bend[0] + arm[2] * bend[1] + pull * slope[0] * slope[0]
    c[1] = arm[4] * np.cos(angles[0] + angles[1])
    c[0] = arm[3] * np.cos(angles[0]) + c[1]
