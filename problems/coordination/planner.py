"""The coordination planner: its model joined with checker, oracle, motion and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from problems.coordination import checker
from problems.coordination.model import CoordinationModel
from problems.problem import Answer, Populations, Solution, Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from problems.motion import Motion, Pace


class Coordination(CoordinationModel):
    """Minimise the time of two robots that wait for each other at synchronisation points (SPs), §3.

    Cell (i, j) of the coordination diagram is an obstacle if the robots may collide while robot 1 is in stretch i of
    its path and robot 2 in stretch j. Between two SPs each robot moves on its own, so all cells of the rectangle
    between them must be free.
    """

    def check(self, solution: Solution) -> Verdict:
        """Judge a solution with `problems.coordination.checker`, which shares no code with `evaluate`."""
        return checker.verify(self, solution)

    def oracle(self) -> Answer:
        """Return the optimum by dynamic programming; see `problems.coordination.oracle`."""
        from problems.coordination import oracle

        return oracle.solve_exactly(self)

    def motion(self, solution: Solution, pace: Pace) -> Motion:
        """Return the motion of both robots along their paths, with their waits at the SPs."""
        from problems.coordination import motion

        return motion.motion(self, solution, pace)

    def draw(self, figure: Figure, solution: Solution | None, populations: Populations) -> None:
        """Draw the diagram with the rectangles (figure 3 of the paper) and, if there are any, the arms (figure 4)."""
        from problems.coordination import drawing

        drawing.draw(self, figure, solution, populations)
