"""The function planner: the model of known functions joined with its checker, oracle and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from problems.function import checker
from problems.function.model import FunctionModel
from problems.problem import Answer, Populations, Solution, Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Function(FunctionModel):
    """A function whose optimum is known.

    Functions of numbers are minimised within the bounds of the literature. The optimal bit string is all ones. For
    graph-partition, the fitness is the number of cut edges less that of the planted partition, plus the sum of the
    squared part sizes less its minimum. The planted partition has the fitness 0. The squares penalise imbalance: with
    two parts, m vertices too many cost 2 m².
    """

    def check(self, solution: Solution) -> Verdict:
        """Judge a solution with `problems.function.checker`, which shares no code with `evaluate`."""
        return checker.verify(self, solution)

    def oracle(self) -> Answer:
        """Return the optimum if it is known, else an upper bound close to it; see `problems.function.oracle`."""
        from problems.function import oracle

        return oracle.solve_exactly(self)

    def draw(self, figure: Figure, solution: Solution | None, populations: Populations) -> None:
        """Draw a map of the first two parameters, the bits, or the graph's edges with vertices sorted by part."""
        from problems.function import drawing

        drawing.draw(self, figure, solution, populations)
