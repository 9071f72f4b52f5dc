"""Permutations: the order of things, such as the cities of a tour."""

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Genomes
from genetics.recipe import ONE_BIT, Recipe
from genetics.sequence import MOST_GENE, Sequence

if TYPE_CHECKING:
    from genetics.operators import Operator


class Permutation(Sequence):
    """Orders of ``size`` items, numbered from 0, each of which occurs once.

    Crossover is ``"order"`` (OX, Davis 1985) or ``"edge"`` (edge recombination, Whitley, Starkweather and Fuquay 1989).
    A recipe's ``mutation`` is the probability that an offspring is changed, once: either a stretch of it is reversed
    (inversion), or two items change places (swap).

    A permutation is stored as a sequence of exactly ``size`` items of one gene each, all distinct.

    Args:
        size: the number of items.
        inversions: the share of mutations that are inversions; the others are swaps.

    Raises:
        ValueError: if there is no item, or more than 65,535, or if ``inversions`` is not between 0 and 1.
    """

    crossovers: ClassVar[tuple[str, ...]] = ("order", "edge")
    distinct: ClassVar[bool] = True

    def __init__(self, size: int, inversions: float = 0.5) -> None:
        if not 1 <= size <= MOST_GENE:
            raise ValueError(f"a permutation has 1 to {MOST_GENE} items, found {size}")
        if not 0 <= inversions <= 1:
            raise ValueError(f"expected a share of inversions from 0 to 1, found {inversions}")
        super().__init__(size, size, [(0, size - 1)])
        self.size, self.inversions = size, inversions

    def initialise(self) -> "Operator":
        """Return the operator that makes first demes: all orders with equal probability."""
        from genetics.operators import Operator
        from genetics.permutation_kernels import initialise

        return Operator.of(initialise, self.size)

    def variation(self, recipe: Recipe) -> "Operator":
        """Return the operator that crosses by order or by edges, and then mutates."""
        from genetics.operators import Operator
        from genetics.permutation_kernels import variation

        assert recipe.mutation != ONE_BIT, "refused by check"
        return Operator.of(variation, recipe.crossover == "edge", [float(recipe.mutation), float(self.inversions)])

    def orders(self, genomes: Genomes) -> NDArray[np.int64]:
        """Return the orders that genomes code: (n, genome_bytes) to (n, size)."""
        numbers = np.ascontiguousarray(genomes).view(np.uint16)
        return numbers[:, 1:].astype(np.int64)  # the first number is the size
