"""What breeding asks of a coding, whatever a genome means."""

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from genetics.arrays import Cells, Fitness, Genomes, writable
from genetics.recipe import Recipe

if TYPE_CHECKING:
    from genetics.operators import Operator


class Keys(NamedTuple):
    """What random draws are keyed by: the rows' cells, the run's seed and the generation that is being bred."""

    cells: Cells
    seed: np.uint64
    generation: int


class Alphabet(NamedTuple):
    """What genomes of a coding are made of, so that compiled code can tell those that come over the wire from rubbish.

    Attributes:
        mask: the bits that may be set, shape (genome_bytes,).
        low: where genomes are float64 numbers the least of each, shape (genes,); else empty.
        high: and the greatest.
        items: where genomes are sequences, the limits of `genetics.sequence`; else empty.
    """

    mask: Genomes
    low: Fitness
    high: Fitness
    items: Cells

    @staticmethod
    def of_bits(mask: Genomes) -> "Alphabet":
        """Of genomes that are not numbers."""
        return Alphabet(mask, np.empty(0), np.empty(0), np.empty(0, np.int64))

    @staticmethod
    def of_reals(low: Fitness, high: Fitness) -> "Alphabet":
        """Of genomes that are float64 numbers."""
        return Alphabet(np.full(8 * low.size, 0xFF, np.uint8), low, high, np.empty(0, np.int64))

    @staticmethod
    def of_items(genome_bytes: int, items: Cells) -> "Alphabet":
        """Of genomes that are sequences."""
        return Alphabet(np.full(genome_bytes, 0xFF, np.uint8), np.empty(0), np.empty(0), items)

    def admits(self, genome: Genomes) -> bool:
        """Whether the coding could have made ``genome``, of any size."""
        if genome.size != self.mask.size or np.any(genome & ~self.mask):
            return False
        if self.items.size:
            from genetics.sequence_kernels import is_sound

            return bool(is_sound(writable(genome), self.items))
        genes = genome.view(np.float64) if self.low.size else self.low
        return bool(np.all((genes >= self.low) & (genes <= self.high)))


class Immigrants(NamedTuple):
    """Who comes to each row: of each sender that its slots name, the first ``each`` emigrants.

    Attributes:
        genomes: of all senders, shape (senders, at least each, genome_bytes).
        fitness: theirs.
        source_row: the senders, shape (rows, slots), in the order of the neighbours.
        each: how many of each sender.
    """

    genomes: Genomes
    fitness: Fitness
    source_row: Cells
    each: int


class Coding(Protocol):
    """How individuals are coded into bytes, and how coded individuals are made and mixed.

    All genomes of a job have room for the longest; a shorter one ends in zeros, which do not travel.

    ``rows`` below is the number of cells handled at once: 1 in a node, all of them in the simulator.
    """

    @property
    def genome_bytes(self) -> int:
        """The room for one genome: the size of the longest."""
        ...

    def check(self, recipe: Recipe) -> None:
        """Refuse a recipe that is not for this coding.

        Raises:
            ValueError: says what was expected and what was found.
        """
        ...

    def random(self, keys: Keys, deme: int) -> Genomes:
        """First demes, shape (rows, deme, genome_bytes)."""
        ...

    def recombine(self, couples: Genomes, recipe: Recipe, keys: Keys) -> Genomes:
        """Cross and mutate ``couples``, shape (rows, couples, 2, genome_bytes).

        Returns two offspring for each couple, in order: shape (rows, 2 * couples, genome_bytes).
        """
        ...

    def variation(self, recipe: Recipe) -> "Operator":
        """`recombine` for one row, as an operator of signature MATING."""
        ...

    def mutate_one(self, individuals: Genomes, keys: Keys) -> Cells:
        """Change one gene of one individual of each row, in place; ``individuals`` is (rows, n, genome_bytes).

        Returns the index of the changed individual in each row, shape (rows,).
        """
        ...

    def mutate_one_bit(self) -> "Operator":
        """`mutate_one` for one row, as an operator of signature STRAYING."""
        ...

    @property
    def alphabet(self) -> Alphabet:
        """What genomes are made of."""
        ...
