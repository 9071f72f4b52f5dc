"""The compiled kinematics of a robot: placements of its bodies, Jacobians, and steps towards a pose.

A placement is a row-major 3×4 matrix [R | p] as a vector of 12 numbers.
"""

from typing import Any, NamedTuple

import numpy as np

from lowlevel.compiled import inlined, subroutine
from problems.robots.arm import FIXED, REVOLUTE

_NO_TURN = 1e-12  # a sine below which a rotation is taken for none, or for half a turn


class StepRoom(NamedTuple):
    """The working arrays of `step_towards`."""

    jacobian: Any  # (6, n)
    normal: Any  # (6, 6): J Jᵀ, then its Cholesky factor
    errors: Any  # (6,): what is left of the way to the target; then the solution
    pose: Any  # (12,): where the offset pose is
    step: Any  # (n,)
    point: Any  # (3,)


@subroutine
def make_step_room(scene: Any) -> Any:
    """Return working arrays for `step_towards`."""
    variables = scene.limits.shape[0]
    return StepRoom(
        np.empty((6, variables)), np.empty((6, 6)), np.empty(6), np.empty(12), np.empty(variables), np.empty(3)
    )


@inlined
def compose(one: Any, other: Any, result: Any) -> Any:
    """Fill ``result`` with the placement ``other`` in the frame ``one``; it must be neither of them."""
    for row in range(3):
        a, b, c, d = one[4 * row], one[4 * row + 1], one[4 * row + 2], one[4 * row + 3]
        for column in range(4):
            result[4 * row + column] = a * other[column] + b * other[4 + column] + c * other[8 + column]
        result[4 * row + 3] += d


@inlined
def _turn(frame: Any, x: Any, y: Any, z: Any, angle: Any) -> Any:
    """Turn a placement about the axis (x, y, z) of its own frame."""
    sine, cosine = np.sin(angle), np.cos(angle)
    rest = 1.0 - cosine
    for row in range(0, 12, 4):
        a, b, c = frame[row], frame[row + 1], frame[row + 2]
        along = (a * x + b * y + c * z) * rest
        # Each row of R is turned the other way: Rodrigues' formula with the cross product reversed.
        frame[row] = a * cosine + (b * z - c * y) * sine + x * along
        frame[row + 1] = b * cosine + (c * x - a * z) * sine + y * along
        frame[row + 2] = c * cosine + (a * y - b * x) * sine + z * along


@subroutine
def place(scene: Any, q: Any, frames: Any) -> Any:
    """Compute forward kinematics: fill the placement of each body in the world, shape (B, 12)."""
    frames[0] = scene.placements[0]
    for body in range(1, scene.kinds.size):
        frame = frames[body]
        compose(frames[scene.parents[body]], scene.placements[body], frame)
        kind = scene.kinds[body]
        if kind == FIXED:
            continue
        value = scene.scales[body, 0] * q[scene.variables[body]] + scene.scales[body, 1]
        x, y, z = scene.axes[body, 0], scene.axes[body, 1], scene.axes[body, 2]
        if kind == REVOLUTE:
            _turn(frame, x, y, z, value)
        else:
            for row in range(0, 12, 4):
                frame[row + 3] += (frame[row] * x + frame[row + 1] * y + frame[row + 2] * z) * value


@subroutine
def point_jacobian(scene: Any, frames: Any, body: Any, point: Any, jacobian: Any) -> Any:
    """Fill how a point of a body moves and how the body turns with each variable, in the world's axes.

    Args:
        scene: the scene.
        frames: the placements of the bodies, from `place`.
        body: the body.
        point: the point in the world, m, shape (3,).
        jacobian: to be filled, shape (6, n): velocity of the point, then angular velocity, per unit of each variable.
    """
    jacobian[:, :] = 0.0
    while body > 0:
        kind, variable, scale, frame = scene.kinds[body], scene.variables[body], scene.scales[body, 0], frames[body]
        if kind != FIXED:
            a, b, c = scene.axes[body, 0], scene.axes[body, 1], scene.axes[body, 2]
            x = scale * (frame[0] * a + frame[1] * b + frame[2] * c)
            y = scale * (frame[4] * a + frame[5] * b + frame[6] * c)
            z = scale * (frame[8] * a + frame[9] * b + frame[10] * c)
            if kind == REVOLUTE:
                dx, dy, dz = point[0] - frame[3], point[1] - frame[7], point[2] - frame[11]
                jacobian[0, variable] += y * dz - z * dy
                jacobian[1, variable] += z * dx - x * dz
                jacobian[2, variable] += x * dy - y * dx
                jacobian[3, variable] += x
                jacobian[4, variable] += y
                jacobian[5, variable] += z
            else:
                jacobian[0, variable] += x
                jacobian[1, variable] += y
                jacobian[2, variable] += z
        body = scene.parents[body]


@subroutine
def pose_error(pose: Any, target: Any, errors: Any) -> Any:
    """Fill the way from a pose to a target: shift, m, then rotation vector, rad, in the world's axes.

    Returns:
        the distance, m, and the angle, rad.
    """
    for axis in range(3):
        errors[axis] = target[4 * axis + 3] - pose[4 * axis + 3]
    distance = np.sqrt(errors[0] ** 2 + errors[1] ** 2 + errors[2] ** 2)
    # The rotation target · poseᵀ: its antisymmetric part is the axis times the sine, its trace tells the cosine.
    turn = np.empty(9)
    for row in range(3):
        for column in range(3):
            turn[3 * row + column] = (
                target[4 * row] * pose[4 * column]
                + target[4 * row + 1] * pose[4 * column + 1]
                + target[4 * row + 2] * pose[4 * column + 2]
            )
    x, y, z = 0.5 * (turn[7] - turn[5]), 0.5 * (turn[2] - turn[6]), 0.5 * (turn[3] - turn[1])
    sine, cosine = np.sqrt(x * x + y * y + z * z), 0.5 * (turn[0] + turn[4] + turn[8] - 1.0)
    angle = np.arctan2(sine, cosine)
    if sine > _NO_TURN:
        errors[3], errors[4], errors[5] = x * angle / sine, y * angle / sine, z * angle / sine
    elif cosine > 0.0:
        errors[3:] = 0.0
    else:
        _half_turn(turn, errors)
    return distance, angle


@subroutine
def _half_turn(turn: Any, errors: Any) -> Any:
    """Fill the rotation vector of half a turn: (R + I) / 2 is the axis times itself."""
    largest = 0
    for axis in range(1, 3):
        if turn[4 * axis] > turn[4 * largest]:
            largest = axis
    norm = np.sqrt(max(0.5 * (turn[4 * largest] + 1.0), 1e-30))
    for axis in range(3):
        diagonal = 1.0 if axis == largest else 0.0
        errors[3 + axis] = np.pi * 0.5 * (turn[3 * axis + largest] + diagonal) / norm


@subroutine
def _solve(normal: Any, errors: Any) -> Any:
    """Solve a positive definite system in place, by Cholesky's decomposition: ``errors`` becomes the solution."""
    size = errors.size
    for row in range(size):
        for column in range(row + 1):
            total = normal[row, column]
            for inner in range(column):
                total -= normal[row, inner] * normal[column, inner]
            normal[row, column] = np.sqrt(max(total, 1e-300)) if row == column else total / normal[column, column]
    for row in range(size):
        for column in range(row):
            errors[row] -= normal[row, column] * errors[column]
        errors[row] /= normal[row, row]
    for row in range(size - 1, -1, -1):
        for column in range(row + 1, size):
            errors[row] -= normal[column, row] * errors[column]
        errors[row] /= normal[row, row]


@subroutine
def _damped_step(room: Any, damping: Any, free: Any) -> Any:
    """Fill ``room.step`` with Jᵀ (J Jᵀ + λ² I)⁻¹ e over the variables whose ``step`` is not NaN."""
    jacobian, normal, step = room.jacobian, room.normal, room.step
    for row in range(6):
        for column in range(row + 1):
            total = damping * damping if row == column else 0.0
            for variable in range(step.size):
                if free[variable]:
                    total += jacobian[row, variable] * jacobian[column, variable]
            normal[row, column] = total
    _solve(normal, room.errors)
    for variable in range(step.size):
        total = 0.0
        if free[variable]:
            for row in range(6):
                total += jacobian[row, variable] * room.errors[row]
        step[variable] = total


@subroutine
def step_towards(
    scene: Any,
    q: Any,
    frames: Any,
    body: Any,
    offset_pose: Any,
    target_pose: Any,
    angle_weight: Any,
    damping: Any,
    greatest: Any,
    room: Any,
) -> Any:
    """Make one damped-least-squares step that brings a pose on a body towards a target, within the joints' limits.

    A variable that stands at a limit and would be pushed beyond it does not take part in the step.

    Args:
        scene: the scene.
        q: the configuration; the step is added to it.
        frames: the placements of the bodies at ``q``; those of the new ``q`` on return.
        body: the body that carries the pose.
        offset_pose: the pose in the body's frame, shape (12,).
        target_pose: the target in the world, shape (12,).
        angle_weight: what an error of 1 rad weighs against one of 1 m; 0 if only the position matters.
        damping: λ, m; 0 for none.
        greatest: the longest change of any variable in one step, rad or m.
        room: from `make_step_room`.

    Returns:
        the distance, m, and the angle, rad, from the target before the step.
    """
    errors, step, variables = room.errors, room.step, q.size
    compose(frames[body], offset_pose, room.pose)
    distance, angle = pose_error(room.pose, target_pose, errors)
    for axis in range(3):
        room.point[axis] = room.pose[4 * axis + 3]
    point_jacobian(scene, frames, body, room.point, room.jacobian)
    for row in range(3, 6):
        errors[row] *= angle_weight
        for variable in range(variables):
            room.jacobian[row, variable] *= angle_weight
    free = np.ones(variables, np.bool_)
    wanted = errors.copy()
    _damped_step(room, max(damping, 1e-9), free)
    held = False
    for variable in range(variables):
        low, high = scene.limits[variable, 0], scene.limits[variable, 1]
        if (step[variable] > 0.0 and q[variable] >= high) or (step[variable] < 0.0 and q[variable] <= low):
            free[variable], held = False, True
    if held:
        errors[:] = wanted
        _damped_step(room, max(damping, 1e-9), free)
    longest = 0.0
    for variable in range(variables):
        longest = max(longest, abs(step[variable]))
    share = greatest / longest if longest > greatest else 1.0
    for variable in range(variables):
        low, high = scene.limits[variable, 0], scene.limits[variable, 1]
        q[variable] = min(high, max(low, q[variable] + share * step[variable]))
    place(scene, q, frames)
    return distance, angle
