"""A bound of how far a link gets from the robot's first joint, in closed form; contacts and rotations are ignored."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from problems.robots.arm import PRISMATIC

if TYPE_CHECKING:
    from problems.robot_ik.model import RobotIkModel


def reach_of(problem: RobotIkModel) -> tuple[NDArray[np.float64], float]:
    """Return the place of the first joint that moves the link, m, and a bound of the link's distance from it, m.

    The bound is the sum of the distances between one joint and the next, and of the travel of sliding joints.
    """
    arm = problem.scene.arm
    body, frame = arm.link(problem.goal_pose.link)
    farthest = float(np.linalg.norm(frame[3::4]))
    while True:
        parent = int(arm.parents[body])
        if arm.kinds[body] == PRISMATIC:
            multiplier, offset = arm.scales[body]
            farthest += float(np.abs(multiplier * arm.limits[arm.variables[body]] + offset).max())
        if parent <= 0:
            place = arm.placements[0].reshape(3, 4) @ [*arm.placements[body][3::4], 1.0]
            return place, farthest
        farthest += float(np.linalg.norm(arm.placements[body][3::4]))
        body = parent


def complaint(problem: RobotIkModel) -> str | None:
    """Return why the pose cannot be reached; None if it may be."""
    pose = problem.goal_pose
    base, farthest = reach_of(problem)
    away = float(np.linalg.norm(np.array(pose.position) - base))
    missed = away - farthest
    if missed <= pose.position_tolerance:
        return None
    accepting = float(np.ceil(missed / pose.position_tolerance))
    return (
        f"goal_pose.position: expected a point at most {farthest:.4g} m from the first joint at "
        f"{[round(float(each), 4) for each in base]}, the reach of {pose.link}, found {list(pose.position)}, "
        f"{away:.4g} m from it; to get the nearest configuration instead, set the run's target above {accepting:g} "
        "(--target)"
    )
