"""Bit strings whose numbers grow finer from generation to generation, so that few slices are computed at first."""

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
"""The generations from which on each number has one more bit; from the last of them on it has all."""


@dataclass(frozen=True)
class CoarseToFine(BitString):
    """Bit strings of which only the ``coarse`` leading bits of each number are used at first; the others are 0.

    Few numbers are in use then, evenly spaced, and all individuals share them. It is for the plain binary code.
    """

    coarse: int = 4

    def random(self, keys: Keys, deme: int) -> Genomes:
        """Uniformly random leading bits."""
        demes: Genomes = super().random(keys, deme) & self.masks[0]
        return demes

    def recombine(self, couples: Genomes, recipe: Recipe, keys: Keys) -> Genomes:
        """As bit strings are recombined, but for the bits that are not yet used."""
        offspring: Genomes = super().recombine(couples, recipe, keys) & self.masks[self.stage(keys.generation)]
        return offspring

    def variation(self, recipe: Recipe) -> "Operator":
        """`recombine` for one row, compiled."""
        from genetics.operators import Operator
        from problems.arm_path import kernels

        rate = 0.0 if recipe.mutation == ONE_BIT else float(recipe.mutation)
        choices = [self.length, recipe.crossover == "uniform"]
        return Operator.of(kernels.variation, choices, rate, FINER_AT, self.masks.astype(np.int64))

    def stage(self, generation: int) -> int:
        """How often numbers have become finer."""
        return sum(generation >= finer for finer in FINER_AT)

    @cached_property
    def masks(self) -> NDArray[np.uint8]:
        """The bits that are used at each stage, shape (stages, genome_bytes)."""
        leading = [min(self.bits, self.coarse + stage) for stage in range(len(FINER_AT))] + [self.bits]
        used = np.arange(self.bits) < np.array(leading)[:, None]
        return np.packbits(np.tile(used, (1, self.parameters)), axis=1)
