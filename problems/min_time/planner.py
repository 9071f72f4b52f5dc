"""The min-time planner: its model joined with checker, oracle, motion and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from problems.min_time.model import MinTimeModel
from problems.problem import Answer, Populations, Solution, Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from problems.motion import Motion, Pace


class MinTime(MinTimeModel):
    """Minimise the travel time along a curve through nodes between start and goal (Chan and Zalzala 1993)."""

    def check(self, solution: Solution) -> Verdict:
        """Verify a solution by `problems.min_time.checker`, which shares no code with `evaluate`."""
        from problems.min_time import checker

        return checker.verify(self, solution)

    def oracle(self) -> Answer:
        """Return the best trajectory through nodes of the grid, an upper bound; see `problems.min_time.oracle`."""
        from problems.min_time import oracle

        return oracle.solve_exactly(self)

    def motion(self, solution: Solution, pace: Pace) -> Motion:
        """Return the trajectory as a motion, row by row."""
        from problems.min_time import motion

        return motion.motion(self, solution, pace)

    def draw(self, figure: Figure, solution: Solution | None, populations: Populations) -> None:
        """Draw the nodes in joint space (figure 1), and joints and torques against time (figure 2)."""
        from problems.min_time import drawing

        drawing.draw(self, figure, solution, populations)
