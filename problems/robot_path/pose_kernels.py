"""Configurations that reach a pose: damped least squares from many starting points, all of them counter-based draws."""

from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from genetics.operators import TABLE, Table
from genetics.randomness import INITIAL, draw, unit
from lowlevel.compiled import kernel, subroutine
from problems.robots.kinematics_kernels import make_step_room, place, step_towards
from problems.robots.scene_kernels import scene_of

Floats = NDArray[np.float64]

_STEPS = 80  # of one search
_DAMPING = 0.02  # m
_GREATEST = 0.5  # rad or m: the longest change of a joint in one step
_SHARE = 0.1  # of the tolerances: what is found must be well within them


@subroutine
def _descend(
    scene: Any, q: Any, frames: Any, body: Any, offset: Any, target: Any, weight: Any, wanted: Any, room: Any
) -> Any:
    """Improve a configuration in place; return the distance, m, and the angle, rad, that are left."""
    away, turn = np.inf, np.inf
    place(scene, q, frames)
    for _ in range(_STEPS):
        before = q.copy()
        away, turn = step_towards(scene, q, frames, body, offset, target, weight, _DAMPING, _GREATEST, room)
        if away <= _SHARE * wanted[0] and (weight == 0.0 or turn <= _SHARE * wanted[1]):
            q[:] = before  # the step that was made since is not measured
            break
    return away, turn


@kernel(
    types.void(
        types.float64[:, ::1],
        types.float64[:, ::1],
        types.int64,
        types.float64[::1],
        types.float64[::1],
        types.float64[::1],
        TABLE,
    ),
    may_be_long=True,
)
def search(
    found: Floats, errors: Floats, body: int, offset: Floats, target: Floats, wanted: Floats, table: Table
) -> None:
    """Fill one configuration a row, and how far each is from the pose, m and rad.

    Args:
        found: to be filled, shape (tries, joints). The first search begins in what is given as the first row.
        errors: to be filled, shape (tries, 2).
        body: the body that carries the pose.
        offset: the pose in the body's frame, shape (12,).
        target: the pose in the world, shape (12,).
        wanted: tolerances, m and rad; the second is infinite if any rotation will do.
        table: the arrays of the scene.
    """
    scene = scene_of(table, 0)
    frames, room = np.empty((scene.kinds.size, 12)), make_step_room(scene)
    weight = 0.3 if np.isfinite(wanted[1]) else 0.0
    for row in range(found.shape[0]):
        for joint in range(found.shape[1] if row > 0 else 0):
            low, high = scene.limits[joint, 0], scene.limits[joint, 1]
            found[row, joint] = low + (high - low) * unit(draw(np.uint64(0), 0, 0, INITIAL, row, joint))
        errors[row] = _descend(scene, found[row], frames, body, offset, target, weight, wanted, room)
