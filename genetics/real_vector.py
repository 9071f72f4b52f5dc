"""Real-valued vectors within bounds, with blend crossover and Gaussian mutation."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Cells, Fitness, Genomes
from genetics.coding import Alphabet, Keys
from genetics.recipe import ONE_BIT, Recipe

if TYPE_CHECKING:
    from genetics.operators import Operator


@dataclass(frozen=True)
class RealVector:
    """``dimension`` float64 genes between ``low`` and ``high``.

    Raises:
        ValueError: if there is no gene, or the bounds are not in order, or not finitely far apart.
    """

    dimension: int
    low: float
    high: float

    def __post_init__(self) -> None:
        if self.dimension < 1:
            raise ValueError(f"a real vector needs at least 1 gene, found {self.dimension}")
        if not (self.low < self.high and math.isfinite(float(self.high) - float(self.low))):
            raise ValueError(f"expected finite bounds low < high with a finite range, found {self.low}, {self.high}")

    @cached_property
    def genome_bytes(self) -> int:
        """The size of a genome: eight bytes for each gene."""
        return 8 * self.dimension

    def check(self, recipe: Recipe) -> None:
        """Refuse a recipe whose crossover or mutation is not for real vectors.

        Raises:
            ValueError: if one of them is not.
        """
        if recipe.crossover not in ("blend", "uniform"):
            raise ValueError(f"real vectors cross by 'blend' or 'uniform', found {recipe.crossover!r}")
        if recipe.mutation == ONE_BIT:
            raise ValueError("real vectors have no bits: 'mutation' is a probability, found 'one-bit'")

    def random(self, keys: Keys, deme: int) -> Genomes:
        """Return demes of genes uniform within the bounds, shape (rows, deme, genome_bytes)."""
        genes: Fitness = self._kernels.random(keys.seed, keys.cells, deme, self.dimension, self.low, self.high)
        return genes.view(np.uint8)

    def recombine(self, couples: Genomes, recipe: Recipe, keys: Keys) -> Genomes:
        """Cross couples by blend (BLX-0.5) or uniform crossover, then mutate genes; see `Coding.recombine`."""
        assert recipe.mutation != ONE_BIT, "refused by check"
        offspring: Fitness = self._kernels.recombine(
            couples.view(np.float64),
            keys.seed,
            keys.cells,
            keys.generation,
            self.low,
            self.high,
            recipe.crossover == "uniform",
            recipe.mutation,
        )
        return offspring.view(np.uint8)

    def variation(self, recipe: Recipe) -> "Operator":
        """Return `recombine` for one row as a compiled operator."""
        from genetics.operators import Operator

        assert recipe.mutation != ONE_BIT, "refused by check"
        numbers = [float(self.low), float(self.high), float(recipe.mutation)]
        return Operator.of(self._kernels.variation, recipe.crossover == "uniform", numbers)

    def mutate_one(self, individuals: Genomes, keys: Keys) -> Cells:
        """Raise ValueError: real vectors have no bits. `check` refuses recipes that ask for this."""
        raise ValueError("real vectors have no bits to flip")

    def mutate_one_bit(self) -> "Operator":
        """Raise ValueError, like `mutate_one`."""
        raise ValueError("real vectors have no bits to flip")

    @cached_property
    def alphabet(self) -> Alphabet:
        """All vectors of numbers within the bounds."""
        return Alphabet.of_reals(np.full(self.dimension, float(self.low)), np.full(self.dimension, float(self.high)))

    @cached_property
    def _kernels(self) -> Any:
        """The kernels' module. It is imported at first use and cached, since every generation asks for it."""
        from genetics import real_kernels

        return real_kernels

    def genes(self, genomes: Genomes) -> NDArray[np.float64]:
        """Return the numbers that genomes code: (n, genome_bytes) to (n, dimension)."""
        return np.ascontiguousarray(genomes).view(np.float64)
