"""Bit strings whose numbers get finer in later generations, so that the first generations need only few slices."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Genomes
from genetics.bit_string import BitString
from genetics.coding import Keys
from genetics.recipe import ONE_BIT, Recipe

if TYPE_CHECKING:
    from genetics.operators import Operator

FINER_AT = (8, 16, 64)
"""The generations at which each number gets one more bit; at the last of them it gets all bits."""


@dataclass(frozen=True)
class CoarseToFine(BitString):
    """Bit strings that at first use only the ``coarse`` leading bits of each number; the others are 0.

    All individuals then share a few, evenly spaced numbers, and so the slices of these. The code must be plain binary:
    in Gray code, masked numbers would not be evenly spaced.
    """

    coarse: int = 4

    def random(self, keys: Keys, deme: int) -> Genomes:
        """Return first demes whose leading bits are uniformly random."""
        demes: Genomes = super().random(keys, deme) & self.masks[0]
        return demes

    def recombine(self, couples: Genomes, recipe: Recipe, keys: Keys) -> Genomes:
        """Recombine as bit strings, then clear the bits that are not yet used in this generation."""
        # Mutation draws as if all bits were in use, so this agrees with the kernel bit for bit.
        offspring: Genomes = super().recombine(couples, recipe, keys) & self.masks[self.stage(keys.generation)]
        return offspring

    def variation(self, recipe: Recipe) -> "Operator":
        """Return `recombine` for one row as compiled code."""
        from genetics.operators import Operator
        from problems.arm_path import kernels

        rate = 0.0 if recipe.mutation == ONE_BIT else float(recipe.mutation)
        choices = [self.length, recipe.crossover == "uniform"]
        return Operator.of(kernels.variation, choices, rate, FINER_AT, self.masks.astype(np.int64))

    def stage(self, generation: int) -> int:
        """Return how many of the generations `FINER_AT` have been reached."""
        return sum(generation >= finer for finer in FINER_AT)

    @cached_property
    def masks(self) -> NDArray[np.uint8]:
        """The bits that are used at each stage, shape (stages, genome_bytes); a stage is a result of `stage`."""
        leading = [min(self.bits, self.coarse + stage) for stage in range(len(FINER_AT))] + [self.bits]
        used = np.arange(self.bits) < np.array(leading)[:, None]
        return np.packbits(np.tile(used, (1, self.parameters)), axis=1)
