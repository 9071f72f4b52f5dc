"""The interface between breeding and a coding: what breeding needs to know of genomes, whatever they mean."""

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from genetics.arrays import Cells, Fitness, Genomes, writable
from genetics.recipe import Recipe

if TYPE_CHECKING:
    from genetics.operators import Operator


class Keys(NamedTuple):
    """The coordinates of random draws: the rows' cells, the run's seed, and the generation that is being bred."""

    cells: Cells
    seed: np.uint64
    generation: int


class Alphabet(NamedTuple):
    """The set of genomes that a coding can make, described by arrays.

    Compiled code checks by it every genome that arrives in a message. Arrays, rather than a method of the coding,
    since that code runs where no Python runs.

    Attributes:
        mask: the bits that may be set, shape (genome_bytes,).
        low: for genomes of float64 numbers, the least value of each gene, shape (genes,); else empty.
        high: the greatest value of each gene, likewise.
        items: for sequences, the limits that `genetics.sequence_kernels` defines; else empty.
    """

    mask: Genomes
    low: Fitness
    high: Fitness
    items: Cells

    @staticmethod
    def of_bits(mask: Genomes) -> "Alphabet":
        """Return the alphabet of bit strings: any genome without bits outside ``mask``."""
        return Alphabet(mask, np.empty(0), np.empty(0), np.empty(0, np.int64))

    @staticmethod
    def of_reals(low: Fitness, high: Fitness) -> "Alphabet":
        """Return the alphabet of float64 genes within bounds."""
        return Alphabet(np.full(8 * low.size, 0xFF, np.uint8), low, high, np.empty(0, np.int64))

    @staticmethod
    def of_items(genome_bytes: int, items: Cells) -> "Alphabet":
        """Return the alphabet of sequences within the limits ``items``."""
        return Alphabet(np.full(genome_bytes, 0xFF, np.uint8), np.empty(0), np.empty(0), items)

    def admits(self, genome: Genomes) -> bool:
        """Return whether the coding could have made ``genome``, which may have any size.

        `wire.exchange_reader` has the same rule, compiled.
        """
        if genome.size != self.mask.size or np.any(genome & ~self.mask):
            return False
        if self.items.size:
            from genetics.sequence_kernels import is_sound

            return bool(is_sound(writable(genome), self.items))
        genes = genome.view(np.float64) if self.low.size else self.low
        return bool(np.all((genes >= self.low) & (genes <= self.high)))


class Immigrants(NamedTuple):
    """The immigrants of each row: for each of its slots, the first ``each`` emigrants of the sender in that slot.

    Attributes:
        genomes: the emigrants of all senders, best first, shape (senders, at least each, genome_bytes).
        fitness: the emigrants' fitness, shape (senders, at least each).
        source_row: the sender in each slot, an index into ``genomes``, shape (rows, slots).
        each: the number of immigrants from each slot.
    """

    genomes: Genomes
    fitness: Fitness
    source_row: Cells
    each: int


class Coding(Protocol):
    """How individuals are coded into bytes, and how coded individuals are made, crossed and mutated.

    All genomes of a job have the size of the longest, so that demes are arrays. A shorter one ends in zeros, which
    messages leave out. Unused bits and places are zero, so that equal individuals have equal bytes.

    ``rows`` below is the number of cells handled at once: 1 in a node, all cells in the simulator.
    """

    @property
    def genome_bytes(self) -> int:
        """The size of a genome in bytes, that of the longest."""
        ...

    def check(self, recipe: Recipe) -> None:
        """Refuse a recipe that does not fit this coding.

        Raises:
            ValueError: if the coding has no such crossover or mutation.
        """
        ...

    def random(self, keys: Keys, deme: int) -> Genomes:
        """Return first demes, shape (rows, deme, genome_bytes)."""
        ...

    def recombine(self, couples: Genomes, recipe: Recipe, keys: Keys) -> Genomes:
        """Cross and mutate ``couples``, shape (rows, couples, 2, genome_bytes).

        Returns two offspring for each couple, in order: shape (rows, 2 * couples, genome_bytes).
        """
        ...

    def variation(self, recipe: Recipe) -> "Operator":
        """Return `recombine` for one row as a compiled operator of signature VARIATION, with the same bits."""
        ...

    def mutate_one(self, individuals: Genomes, keys: Keys) -> Cells:
        """Flip one bit of one individual of each row, in place; ``individuals`` has shape (rows, n, genome_bytes).

        Returns the index of the changed individual in each row, shape (rows,).

        Raises:
            ValueError: if the coding has no bits to flip.
        """
        ...

    def mutate_one_bit(self) -> "Operator":
        """Return `mutate_one` for one row as a compiled operator of signature MUTATE_ONE_BIT."""
        ...

    @property
    def alphabet(self) -> Alphabet:
        """The genomes that this coding can make."""
        ...
