"""Convert robot-ik's solutions to animations: one step for each solution, with the others as pale copies."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.animation import Animation, Ghost
from problems.problem import Solution
from problems.robots.animating import bodies_of, places_of, target_of

if TYPE_CHECKING:
    from problems.robot_ik.model import RobotIkModel


def animation(problem: RobotIkModel, solution: Solution | None) -> Animation:
    """Return the robot at each solution; without any, in the middle of its limits."""
    arm = problem.scene.arm
    found = [] if solution is None else [solution["configuration"], *solution.get("others", [])]
    configurations = np.array(found, np.float64) if found else arm.limits.mean(axis=1)[None]
    frames = places_of(arm, configurations)
    several = len(frames) > 1
    return Animation(
        bodies=bodies_of(problem.robot, arm, problem.obstacles, problem.attached),
        frames=frames,
        along=np.arange(1.0, len(frames) + 1.0),
        along_name="solution",
        ghosts=tuple(Ghost(f"solution {number + 1}", each) for number, each in enumerate(frames) if several),
        targets=target_of(problem.goal_pose)[None],
        names=arm.joints,
        curves=configurations,
        curves_name="joint / rad (m if prismatic)",
    )
