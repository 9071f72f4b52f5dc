"""The coding of paths: a sequence of blocks, each a direction and a length (Fries, §3.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Literal

from numpy.typing import NDArray

from genetics.recipe import Recipe
from genetics.sequence import Sequence

if TYPE_CHECKING:
    from genetics.operators import Operator

CROSSOVER_RATE = 0.8  # §3.3
# A window reaches from its middle this many cells at least, on larger maps the side divided by the second number.
_NARROWEST, _WINDOWS_ACROSS = 3, 16


class Moves(Sequence):
    """Sequences of one to ``most`` blocks of 2 + ⌈log2 n⌉ bits, where n is the longer ``side`` of the map.

    The low three bits of the first block are the heading. In every other block the high two bits are the turn and the
    others the length.

    Args:
        world: The arrays of `problems.terrain.walking.World`.
        side: The longer side of the map, in cells.
        most: The greatest number of blocks.
        founders: How first paths are made.
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
        """How far a window of the tuned recipe reaches from its middle cell, in cells."""
        return max(_NARROWEST, self.side // _WINDOWS_ACROSS)

    def initialise(self) -> Operator:
        """Return the operator of first paths: random blocks (§3.2), or straight lines through random cells."""
        from genetics.operators import Operator
        from problems.terrain import kernels

        return Operator.of(kernels.found_lines if self.founders == "lines" else kernels.found_random, *self.world)

    def variation(self, recipe: Recipe) -> Operator:
        """Return the operator of offspring: §3.3, or the best path over both parents' cells and a small window."""
        from genetics.operators import Operator
        from problems.terrain import kernels

        if recipe.crossover == "one-point":
            return Operator.of(kernels.one_point, *self.world, [CROSSOVER_RATE, float(recipe.mutation)])
        return Operator.of(kernels.merge, *self.world, float(recipe.mutation), self.reach)
