"""The robot-ik planner: its model joined with checker, oracle and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from pydantic import ValidationInfo, model_validator

from problems.problem import CHECKED, Answer, Populations, Solution, Verdict
from problems.robot_ik import reach
from problems.robot_ik.model import RobotIkModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from problems.animation import Animation


class RobotIk(RobotIkModel):
    """Bring a link of a robot to a pose, clear of obstacles and of the robot itself.

    Each individual codes a configuration, or several. Steps of damped least squares bring it towards the pose before it
    is judged.
    """

    @model_validator(mode="after")
    def _stands_clear(self, info: ValidationInfo) -> Self:
        if info.context != CHECKED:  # else another process has checked these fields already; nodes cannot
            from problems.robots.verifying import refuse_standing_contacts

            refuse_standing_contacts(self)
        return self

    @property
    def unreachable(self) -> str | None:
        """An error about a pose that is too far away; see `problems.robot_ik.reach`."""
        return reach.complaint(self)

    def check(self, solution: Solution) -> Verdict:
        """Verify a solution by `problems.robot_ik.checker`, on the exact meshes and without the compact model."""
        from problems.robot_ik import checker

        return checker.verify(self, solution)

    def oracle(self) -> Answer:
        """Return the best of a local solver with many starts; see `problems.robot_ik.oracle`."""
        from problems.robot_ik import oracle

        return oracle.solve_locally(self)

    def draw(self, figure: Figure, solution: Solution | None, populations: Populations) -> None:
        """Draw the robot at its solutions in its scene, and the joints of the population within their limits."""
        from problems.robot_ik import drawing

        drawing.draw(self, figure, solution, populations)

    def animation(self, solution: Solution | None) -> Animation:
        """Return the robot at each solution; see `problems.robot_ik.animation`."""
        from problems.robot_ik import animation

        return animation.animation(self, solution)
