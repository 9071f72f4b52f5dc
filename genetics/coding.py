"""What breeding asks of a coding, whatever a genome means."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from genetics.arrays import Cells, Genomes
from genetics.recipe import Recipe


@dataclass(frozen=True)
class Keys:
    """What random draws are keyed by: the rows' cells, the run's seed and the generation that is being bred."""

    cells: Cells
    seed: int
    generation: int

    @property
    def key(self) -> np.uint64:
        """The seed as the kernels take it."""
        return np.uint64(self.seed)


class Coding(Protocol):
    """How individuals are coded into a fixed number of bytes, and how coded individuals are made and mixed.

    ``rows`` below is the number of cells handled at once: 1 in a node, all of them in the simulator.
    """

    @property
    def genome_bytes(self) -> int:
        """The size of one genome."""
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

    def mutate_one(self, individuals: Genomes, keys: Keys) -> Cells:
        """Change one gene of one individual of each row, in place; ``individuals`` is (rows, n, genome_bytes).

        Returns the index of the changed individual in each row, shape (rows,).
        """
        ...

    def accepts(self, genome: bytes) -> bool:
        """Whether ``genome``, come over the wire, is one that this coding could have made."""
        ...
