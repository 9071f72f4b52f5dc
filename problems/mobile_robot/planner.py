"""The mobile-robot planner: its model joined with checker, oracle, motion and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from pydantic import ValidationInfo, model_validator

from problems.advice import advice_on_length
from problems.mobile_robot import checker
from problems.mobile_robot.model import MobileRobotModel
from problems.problem import CHECKED, Answer, Populations, Solution, Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from problems.motion import Motion, Pace
    from problems.run import Run


class MobileRobot(MobileRobotModel):
    """Find a list of (rotate, move) commands from whose end, or from an earlier place, the goal is visible (§5)."""

    @model_validator(mode="after")
    def _stands_free(self, info: ValidationInfo) -> Self:
        if info.context == CHECKED:  # another process has checked these fields already; the check is costly
            return self
        for name, pose in (("start", self.start), ("goal", self.goal)):
            objection = checker.objection_to(self, pose)
            if objection is not None:
                raise ValueError(
                    f"{name}: expected a place where the robot stands free, found {list(pose)} {objection}"
                )
        return self

    def check(self, solution: Solution) -> Verdict:
        """Verify a solution by `problems.mobile_robot.checker`, which shares no code with `evaluate`."""
        return checker.verify(self, solution)

    def oracle(self) -> Answer:
        """Return whether there is a way, and bounds of its length; see `problems.mobile_robot.oracle`."""
        from problems.mobile_robot import oracle

        return oracle.solve_exactly(self)

    def advice(self, found: Solution | None, run: Run) -> list[str]:
        """Return the default hints, and one to allow longer solutions."""
        return [
            *super().advice(found, run),
            *advice_on_length(self, "commands", self.pairs, "a way with more turns takes more commands"),
        ]

    def motion(self, solution: Solution, pace: Pace) -> Motion:
        """Return drives and turns as a motion, each from rest to rest; see `problems.mobile_robot.motion`."""
        from problems.mobile_robot import motion

        return motion.motion(self, solution, pace)

    def draw(self, figure: Figure, solution: Solution | None, populations: Populations) -> None:
        """Draw the floor and the swept robot (figure 6 of the paper)."""
        from problems.mobile_robot import drawing

        drawing.draw(self, figure, solution, populations)
