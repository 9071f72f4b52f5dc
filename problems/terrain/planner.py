"""The terrain planner: its model joined with checker, oracle, motion and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from problems.advice import advice_on_length
from problems.problem import Answer, Populations, Solution, Verdict
from problems.terrain import checker
from problems.terrain.model import TerrainModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from problems.motion import Motion, Pace
    from problems.run import Run


class Terrain(TerrainModel):
    """Find the easiest way from a cell to another, as a list of turns and straight moves."""

    def check(self, solution: Solution) -> Verdict:
        """Verify a solution by `problems.terrain.checker`, which shares no code with `evaluate`."""
        return checker.verify(self, solution)

    def oracle(self) -> Answer:
        """Return the easiest of all paths, by Dijkstra's algorithm."""
        from problems.terrain import oracle

        return oracle.solve_exactly(self)

    def advice(self, found: Solution | None, run: Run) -> list[str]:
        """Return the default hints, and one to allow longer solutions."""
        hints = super().advice(found, run)
        if self.blocks is not None:
            hints += advice_on_length(self, "blocks", self.blocks, "a way with more turns takes more blocks")
        return hints

    def motion(self, solution: Solution, pace: Pace) -> Motion:
        """Return the motion from cell to cell, from rest to rest between its turns."""
        from problems.terrain import motion

        return motion.motion(self, solution, pace)

    def draw(self, figure: Figure, solution: Solution | None, populations: Populations) -> None:
        """Draw the map and the path (figures 7 to 10 of the paper), and the difficulties (figure 5)."""
        from problems.terrain import drawing

        drawing.draw(self, figure, solution, populations)
