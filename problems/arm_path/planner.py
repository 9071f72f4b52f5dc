"""The arm-path planner: its model joined with checker, oracle, motion and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from pydantic import model_validator

from problems.advice import advice_on_length
from problems.arm_path import checker
from problems.arm_path.model import ArmPathModel
from problems.problem import Answer, Populations, Solution, Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from problems.motion import Motion, Pace
    from problems.run import Run


class ArmPath(ArmPathModel):
    """Find a Manhattan motion M(k, q) with a corner from which the goal can be reached by a simple path (§4).

    A Manhattan motion moves one joint at a time: k rounds of moving joint 1, joint 2, .., joint n, each to an absolute
    q-bit angle. The simple path turns each joint to the goal once.
    """

    @model_validator(mode="after")
    def _ends_are_free(self) -> Self:
        for name, configuration in (("start", self.start), ("goal", self.goal)):
            if len(configuration) != len(self.arm.links):
                raise ValueError(
                    f"{name}: expected one angle for each of {len(self.arm.links)} links, found {len(configuration)}"
                )
            objection = checker.objection_to(self, configuration)
            if objection is not None:
                raise ValueError(f"{name}: expected a free configuration, found {configuration}: {objection}")
        return self

    def check(self, solution: Solution) -> Verdict:
        """Judge a solution with `problems.arm_path.checker`, which shares no code with `evaluate`."""
        return checker.verify(self, solution)

    def oracle(self) -> Answer:
        """Return whether a two-link arm can reach the goal, and by how many moves; see `problems.arm_path.oracle`."""
        from problems.arm_path import oracle

        return oracle.solve_exactly(self)

    def advice(self, found: Solution | None, run: Run) -> list[str]:
        """Return the default hints, and one to allow longer solutions."""
        return [
            *super().advice(found, run),
            *advice_on_length(self, "rounds", self.rounds, "a way around more corners takes more moves"),
        ]

    def motion(self, solution: Solution, pace: Pace) -> Motion:
        """Return the path over time: one joint moves after another, each from rest to rest within its limits."""
        from problems.arm_path import motion

        return motion.motion(self, solution, pace)

    def draw(self, figure: Figure, solution: Solution | None, populations: Populations) -> None:
        """Draw the path in the workspace and, for two links, in configuration space (figures 4 and 5)."""
        from problems.arm_path import drawing

        drawing.draw(self, figure, solution)
