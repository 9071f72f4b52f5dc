"""The coding of trajectories (§III): a variable number of nodes, each with the torque level of the stretch to it."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from genetics.recipe import ONE_BIT, Recipe
from genetics.sequence import Sequence
from problems.min_time.levels import LEVELS

if TYPE_CHECKING:
    from collections.abc import Sequence as Numbers

    from genetics.operators import Operator

FINEST = 0xFFFF  # the greatest gene of a joint if nodes may be anywhere in the box: genes are uint16


class Trajectories(Sequence):
    """Sequences of nodes {α_1, .., α_m, s}, the last of which is the goal.

    Args:
        grid_steps: Steps of each joint's grid from the start to the goal; 0 where start and goal are the same.
        most: The greatest number of nodes, the goal included; 2 or more.
        radius: The greatest distance between the two parents' cuts, in the box scaled to the unit square.
        free: Whether nodes may be off the grid.
        full_torque: Whether the level is 8 throughout.
    """

    crossovers: ClassVar[tuple[str, ...]] = ("analogous", "refining")

    def __init__(self, grid_steps: Numbers[int], most: int, radius: float, free: bool, full_torque: bool) -> None:
        self.grid_steps, self.radius = tuple(grid_steps), radius
        self.greatest = tuple((FINEST if free else steps) if steps else 0 for steps in self.grid_steps)
        self.least_level = LEVELS if full_torque else 1
        # Items hold a gene for each joint and the torque level, each with its range.
        super().__init__(1, most, [*((0, gene) for gene in self.greatest), (self.least_level, LEVELS)])

    def initialise(self) -> Operator:
        """Return the operator that makes random trajectories by the relative transition scheme (§IV, figure 1)."""
        from problems.min_time import coding_kernels

        return self._operator(coding_kernels.initialise, refining=False, rate=0.0)

    def variation(self, recipe: Recipe) -> Operator:
        """Return analogous crossover with the mutations of §IV, or with those that refine (the tuned recipe)."""
        from problems.min_time import coding_kernels

        assert recipe.mutation != ONE_BIT, "refused by check"
        return self._operator(coding_kernels.variation, recipe.crossover == "refining", float(recipe.mutation))

    def _operator(self, function: object, refining: bool, rate: float) -> Operator:
        from genetics.operators import Operator

        return Operator.of(
            function,
            [len(self.grid_steps), self.most, self.least_level, refining],
            [self.greatest, self.grid_steps],
            [self.radius, rate],
        )
