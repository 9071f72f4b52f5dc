"""The configurations that reach a goal pose without touching anything: the goals of a path to that pose."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from problems.robots.arm import Scene
from problems.robots.fields import GoalPose, rotation_of

Floats = NDArray[np.float64]

MOST_GOALS = 16
_TRIES = 400
_APART = 0.2  # rad: of two goals that are nearer to each other, one is enough


class Reached(NamedTuple):
    """The outcome of a search for configurations.

    Attributes:
        goals: free configurations that reach the pose, the one nearest to the start first, shape (n, joints).
        reaching: how many reach it, free or not.
        away: the distance of the nearest one found from the pose, m.
        turn: its angle from the pose, rad.
    """

    goals: Floats
    reaching: int
    away: float
    turn: float


def reach(scene: Scene, start: Floats, pose: GoalPose) -> Reached:
    """Search configurations that reach a pose. The same scene, start and pose give the same configurations.

    Raises:
        KeyError: if the robot has no such link.
    """
    from genetics.operators import Operator
    from problems.robot_path import pose_kernels
    from problems.robots.collision import Collisions

    body, offset = scene.arm.link(pose.link)
    target = np.zeros((3, 4))
    target[:, :3] = np.eye(3) if pose.quaternion is None else rotation_of(pose.quaternion)
    target[:, 3] = pose.position
    wanted = np.array([pose.position_tolerance, np.inf if pose.quaternion is None else pose.angle_tolerance])
    found, errors = np.tile(start, (_TRIES, 1)), np.zeros((_TRIES, 2))
    table = Operator.of(pose_kernels.search, *scene.arrays())
    pose_kernels.search(found, errors, body, np.ascontiguousarray(offset), target.ravel(), wanted, table.table)
    reaching = (errors[:, 0] <= wanted[0]) & (errors[:, 1] <= wanted[1])
    best = int(np.argmin(errors[:, 0] + np.where(np.isfinite(wanted[1]), errors[:, 1], 0.0)))
    free = found[reaching][Collisions(scene).are_free(found[reaching])] if reaching.any() else found[:0]
    return Reached(_apart(free, start), int(reaching.sum()), float(errors[best, 0]), float(errors[best, 1]))


def _apart(goals: Floats, start: Floats) -> Floats:
    """Return the goals nearest to the start, each at some distance from the others."""
    kept: list[Floats] = []
    for goal in goals[np.argsort(np.linalg.norm(goals - start, axis=1), kind="stable")]:
        if all(np.linalg.norm(goal - other) > _APART for other in kept):
            kept.append(goal)
        if len(kept) == MOST_GOALS:
            break
    return np.array(kept).reshape(-1, goals.shape[1])
