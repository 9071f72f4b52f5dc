"""Genomes of variable length: sequences of items, each of which is a few whole numbers (its genes).

A genome is an array of uint16 numbers: the number of items, the genes of one item after another, and zeros up to the
size of the longest genome. So demes stay arrays, and sequences are stored, compared and sent like any other genome.

A planner defines what the items mean. It makes and crosses sequences with compiled functions of its own.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Cells, Genomes
from genetics.coding import Alphabet, Keys
from genetics.recipe import ONE_BIT, Recipe
from lowlevel import capabilities

if TYPE_CHECKING:
    from genetics.operators import Operator

Items = NDArray[np.int64]  # (items, genes of an item)

MOST_GENE = 0xFFFF


class Sequence(ABC):
    """Base class of codings of variable length; a `genetics.coding.Coding`.

    Args:
        least: the fewest items of a sequence.
        most: the most items of a sequence.
        genes: for each gene of an item, its least and greatest value.

    Raises:
        ValueError: if the limits are not in order, or do not fit into 16 bits.
    """

    crossovers: ClassVar[tuple[str, ...]]
    """The names of crossovers that a recipe may ask for."""
    distinct: ClassVar[bool] = False
    """Whether no two items of a sequence may have the same first gene."""

    def __init__(self, least: int, most: int, genes: Iterable[tuple[int, int]]) -> None:
        self.least, self.most, self.genes = least, most, tuple(genes)
        if not 0 <= least <= most <= MOST_GENE:
            raise ValueError(f"expected 0 to {MOST_GENE} items, found {least} to {most}")
        if not self.genes or not all(0 <= low <= high <= MOST_GENE for low, high in self.genes):
            raise ValueError(f"expected bounds of genes between 0 and {MOST_GENE}, found {self.genes}")
        self._variations: dict[Recipe, Operator] = {}

    @property
    def width(self) -> int:
        """The number of genes of an item."""
        return len(self.genes)

    @property
    def genome_bytes(self) -> int:
        """The size of a genome: two bytes for the number of items, and two for each gene of the most items."""
        return 2 * (1 + self.most * self.width)

    @abstractmethod
    def initialise(self) -> "Operator":
        """Return an operator of signature INITIALISE, which makes first demes."""

    @abstractmethod
    def variation(self, recipe: Recipe) -> "Operator":
        """Return an operator of signature VARIATION, which crosses and mutates couples."""

    def check(self, recipe: Recipe) -> None:
        """Refuse a recipe whose crossover or mutation is not for these sequences.

        Raises:
            ValueError: if one of them is not.
        """
        if recipe.crossover not in self.crossovers:
            expected = " or ".join(map(repr, self.crossovers))
            raise ValueError(f"these individuals cross by {expected}, found {recipe.crossover!r}")
        if recipe.mutation == ONE_BIT:
            raise ValueError("these individuals are not bit strings: 'mutation' is a probability, found 'one-bit'")

    def random(self, keys: Keys, deme: int) -> Genomes:
        """Return first demes, made by the operator of `initialise`; see `Coding.random`."""
        demes = np.zeros((len(keys.cells), deme, self.genome_bytes), np.uint8)
        operator = self.initialise()
        if capabilities().numba_calls:
            from genetics.calls_by_address import initialise_rows

            initialise_rows(operator.address, demes, keys.seed, keys.cells, keys.generation, operator.table)
        else:
            for row, cell in enumerate(keys.cells):
                operator.function(demes[row], keys.seed, cell, keys.generation, operator.table)
        return demes

    def recombine(self, couples: Genomes, recipe: Recipe, keys: Keys) -> Genomes:
        """Return the offspring of couples, made by the operator of `variation`; see `Coding.recombine`."""
        rows, count, _, size = couples.shape
        offspring = np.zeros((rows, 2 * count, size), np.uint8)
        if recipe not in self._variations:  # built once: this runs in every generation
            self._variations[recipe] = self.variation(recipe)
        operator = self._variations[recipe]
        if capabilities().numba_calls:
            from genetics.calls_by_address import vary_rows

            vary_rows(operator.address, couples, offspring, keys.seed, keys.cells, keys.generation, operator.table)
        else:
            for row, cell in enumerate(keys.cells):
                operator.function(couples[row], offspring[row], keys.seed, cell, keys.generation, operator.table)
        return offspring

    def mutate_one(self, individuals: Genomes, keys: Keys) -> Cells:
        """Raise ValueError: sequences have no bits. `check` refuses recipes that ask for this."""
        raise ValueError("these individuals have no bits to flip")

    def mutate_one_bit(self) -> "Operator":
        """Raise ValueError, like `mutate_one`."""
        raise ValueError("these individuals have no bits to flip")

    @cached_property
    def alphabet(self) -> Alphabet:
        """All sequences within the limits, with distinct first genes if required, and zeros after the last item."""
        limits = [self.least, self.most, *(bound for gene in self.genes for bound in gene), self.distinct]
        return Alphabet.of_items(self.genome_bytes, np.array(limits, np.int64))

    def items(self, genome: Genomes) -> Items:
        """Return the items of a genome, shape (genome_bytes,), as an array of shape (items, genes of an item)."""
        numbers = np.ascontiguousarray(genome).view(np.uint16).astype(np.int64)
        return numbers[1 : 1 + numbers[0] * self.width].reshape(-1, self.width)

    def encode(self, items: Items) -> Genomes:
        """Return the genome of a sequence of items, the inverse of `items`.

        Raises:
            ValueError: if the number of items or a gene is out of its limits, or first genes repeat but must not.
        """
        items = np.asarray(items, np.int64).reshape(-1, self.width)
        numbers = np.zeros(self.genome_bytes // 2, np.int64)
        low, high = np.array(self.genes).T
        if not self.least <= len(items) <= self.most or np.any((items < low) | (items > high)):
            raise ValueError(f"expected {self.least} to {self.most} items within {self.genes}, found {items.tolist()}")
        if self.distinct and len(np.unique(items[:, 0])) < len(items):
            raise ValueError(f"expected items that differ, found {items[:, 0].tolist()}")
        numbers[0] = len(items)
        numbers[1 : 1 + items.size] = items.ravel()
        return numbers.astype(np.uint16).view(np.uint8)
