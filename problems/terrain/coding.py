"""Paths as blocks of a direction and a length: a sequence of variable length (Fries, §3.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Literal

from numpy.typing import NDArray

from genetics.recipe import Recipe
from genetics.sequence import Sequence

if TYPE_CHECKING:
    from genetics.operators import Operator

CROSSOVER_RATE = 0.8  # §3.3
_NARROWEST, _WINDOWS_ACROSS = 3, 16  # a window reaches so far from its middle at least, or this part of the map


class Moves(Sequence):
    """One to ``most`` blocks of 2 + ⌈log2 n⌉ bits, n the longer ``side`` of the map.

    The first block says the heading by its low three bits; each other the turn by its high two, and the length.

    Args:
        world: the arrays of `problems.terrain.walking.World`.
        side: in cells.
        most: blocks.
        founders: how first paths are made.
    """

    crossovers: ClassVar[tuple[str, ...]] = ("one-point", "merge")

    def __init__(
        self, world: tuple[NDArray[Any], ...], side: int, most: int, founders: Literal["random", "lines"]
    ) -> None:
        self.bits = (side - 1).bit_length()
        super().__init__(1, most, [(0, (4 << self.bits) - 1)])
        self.world, self.side, self.founders = world, side, founders

    @property
    def reach(self) -> int:
        """How far a window of the tuned recipe reaches from its middle, in cells."""
        return max(_NARROWEST, self.side // _WINDOWS_ACROSS)

    def initialise(self) -> Operator:
        """§3.2, or straight lines through random cells."""
        from genetics.operators import Operator
        from problems.terrain import kernels

        return Operator.of(kernels.found_lines if self.founders == "lines" else kernels.found_random, *self.world)

    def variation(self, recipe: Recipe) -> Operator:
        """§3.3, or the best path within those of both parents and a small window."""
        from genetics.operators import Operator
        from problems.terrain import kernels

        if recipe.crossover == "one-point":
            return Operator.of(kernels.one_point, *self.world, [CROSSOVER_RATE, float(recipe.mutation)])
        return Operator.of(kernels.merge, *self.world, float(recipe.mutation), self.reach)
