"""The arm-ik planner: its model joined with checker, oracle and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from problems.arm_ik import checker, reach
from problems.arm_ik.model import ArmIkModel
from problems.problem import Answer, Populations, Solution, Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class ArmIk(ArmIkModel):
    """Minimise f(θ) = ‖d(θ) − X‖, +∞ in collision (Ahuactzin et al. 1992, §3.1).

    Each joint angle is one integer of ``bits`` bits; a genome is their concatenation.
    """

    @property
    def unreachable(self) -> str | None:
        """An error about a target that is too far from the base, or too near to it; see `problems.arm_ik.reach`."""
        return reach.complaint(self)

    def check(self, solution: Solution) -> Verdict:
        """Judge a solution with `problems.arm_ik.checker`, which shares no code with `evaluate`."""
        return checker.verify(self, solution)

    def oracle(self) -> Answer:
        """Return the optimum by enumeration if there are few codes, else bounds; see `problems.arm_ik.oracle`."""
        from problems.arm_ik import oracle

        return oracle.solve_exactly(self)

    def draw(self, figure: Figure, solution: Solution | None, populations: Populations) -> None:
        """Draw the arm among its obstacles and, for two links, its configuration space (figures 1 to 3)."""
        from problems.arm_ik import drawing

        drawing.draw(self, figure, solution, populations)
