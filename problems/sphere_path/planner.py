"""The sphere-path planner: its model joined with validation, checker, oracle, motion and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from pydantic import model_validator

from problems.advice import advice_on_length
from problems.problem import Answer, Populations, Solution, Verdict
from problems.sphere_path.model import SpherePathModel
from problems.sphere_path.validation import validate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from problems.motion import Motion, Pace
    from problems.run import Run


class SpherePath(SpherePathModel):
    """Find intermediate nodes of a path from start to goal that crosses no obstacle (Eldershaw and Cameron).

    Obstacles are spheres in configuration space: given, random, or made from a vehicle and its obstacles.
    """

    @model_validator(mode="after")
    def _is_a_world(self) -> Self:
        validate(self)
        return self

    def check(self, solution: Solution) -> Verdict:
        """Verify a solution by `problems.sphere_path.checker`, which shares no code with `evaluate`."""
        from problems.sphere_path import checker

        return checker.verify(self, solution)

    def oracle(self) -> Answer:
        """Return what is known about the best path, see `problems.sphere_path.oracle`."""
        from problems.sphere_path import oracle

        return oracle.solve_exactly(self)

    def advice(self, found: Solution | None, run: Run) -> list[str]:
        """Return advice after a run; a finer accuracy if nothing else keeps the best attempt from being free."""
        spare = None if found is None or self.vehicle is None else self._spare(found)
        if spare is None:
            longer = advice_on_length(self, "nodes", self.nodes, "a way around more obstacles takes more nodes")
            return [*super().advice(found, run), *longer]
        finer = min(spare or self.accuracy, self.accuracy) / 2.0
        return [
            f"`accuracy` is what blocks: the vehicle is free on the best path, {spare:.3g} m clear of what it must not "
            f"touch, and crosses spheres only since they reach up to {self.accuracy:g} m farther: try "
            f"accuracy = {finer:.2g} in the problem file (this run: {self.accuracy:g})"
        ]

    def _spare(self, found: Solution) -> float | None:
        """Return the gap beyond the clearance, m, on a path through spheres but is free in the world, or None."""
        verdict = self.check(found)
        # Only a path that crosses spheres, but meets nothing in the world, shows that accuracy is to blame.
        if not (found["crossed"] and verdict.feasible) or verdict.clearance is None:
            return None
        return max(0.0, verdict.clearance.least - self.clearance)

    def motion(self, solution: Solution, pace: Pace) -> Motion:
        """Return the motion along the path, from rest to rest between its corners."""
        from problems.sphere_path import motion

        return motion.motion(self, solution, pace)

    def draw(self, figure: Figure, solution: Solution | None, populations: Populations) -> None:
        """Draw the path among the spheres (the paper's figure), or the vehicle in its world."""
        from problems.sphere_path import drawing

        drawing.draw(self, figure, solution, populations)
