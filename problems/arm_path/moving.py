"""An arm-path solution over time: one joint turns after another."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.motion import Joints, Motion, Pace, joint_names, planar_links, straight
from problems.plane import outlines
from problems.problem import Solution

if TYPE_CHECKING:
    from problems.arm_path.problem import ArmPath


def motion(problem: ArmPath, solution: Solution, pace: Pace) -> Motion:
    """Each joint turns at the same even speed, rad/s."""
    speed = pace.along(problem.kind, "rad/s")
    pace.refuse(problem.kind, turn_speed="whose joints turn at --speed")
    path = np.array(solution["path"], np.float64)
    times, angles = straight(path, np.abs(np.diff(path, axis=0)).sum(axis=1) / speed, pace)
    arm = problem.arm
    links = planar_links(arm.links, arm.base, angles)
    return Motion(times, (Joints("", joint_names(len(arm.links)), angles, links=links),), outlines(problem.obstacles))
