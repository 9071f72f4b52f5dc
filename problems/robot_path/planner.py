"""The robot-path planner: its model joined with checker, oracle, motion and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from pydantic import ValidationInfo, model_validator

from problems.problem import CHECKED, Answer, Populations, Solution, Verdict
from problems.robot_path.model import RobotPathModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from problems.animation import Animation
    from problems.motion import Motion, Pace


class RobotPath(RobotPathModel):
    """Find a short path of a robot from one configuration to another, or to a pose, free of contacts throughout."""

    @model_validator(mode="after")
    def _ends_are_free(self, info: ValidationInfo) -> Self:
        if info.context != CHECKED:  # else another process has checked these fields already; nodes cannot
            from problems.robot_path import checker

            checker.refuse_blocked_ends(self)
        return self

    def check(self, solution: Solution) -> Verdict:
        """Verify a solution by `problems.robot_path.checker`, on the exact meshes and without the compact model."""
        from problems.robot_path import checker

        return checker.verify(self, solution)

    def oracle(self) -> Answer:
        """Return the length of the straight line, the least possible; see `problems.robot_path.oracle`."""
        from problems.robot_path import oracle

        return oracle.solve_exactly(self)

    def motion(self, solution: Solution, pace: Pace) -> Motion:
        """Return the trajectory, or the path over time from rest to rest; see `problems.robot_path.motion`."""
        from problems.robot_path import motion

        return motion.motion(self, solution, pace)

    def retimed(self, solution: Solution, pace: Pace) -> Solution:
        """Return the solution with the field ``trajectory``; see `problems.robot_path.motion`."""
        from problems.robot_path import motion

        return motion.retimed(self, solution, pace)

    def draw(self, figure: Figure, solution: Solution | None, populations: Populations) -> None:
        """Draw the robot in its scene, with start, goal and what it sweeps, and the joints along the path."""
        from problems.robot_path import drawing

        drawing.draw(self, figure, solution, populations)

    def animation(self, solution: Solution | None) -> Animation:
        """Return the robot along its path, or the robot at its start; see `problems.robot_path.animation`."""
        from problems.robot_path import animation

        return animation.animation(self, solution)
