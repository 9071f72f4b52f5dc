"""Fixed-length bit strings: n parameters of q bits each (Ahuactzin et al. 1992, §3.1 step 1)."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Cells, Genomes, writable
from genetics.coding import Alphabet, Keys
from genetics.recipe import ONE_BIT, Recipe

if TYPE_CHECKING:
    from genetics.operators import Operator

MOST_BITS = 62


@dataclass(frozen=True)
class BitString:
    """``parameters`` integers of ``bits`` bits, concatenated, most significant bit first, packed into bytes.

    With ``gray`` each integer is read as a reflected Gray code, in which neighbouring values differ in one bit.

    Raises:
        ValueError: if there is no parameter, or a parameter has not between 1 and 62 bits.
    """

    parameters: int
    bits: int
    gray: bool = False

    def __post_init__(self) -> None:
        if self.parameters < 1:
            raise ValueError(f"a bit string needs at least 1 parameter, found {self.parameters}")
        if not 1 <= self.bits <= MOST_BITS:
            raise ValueError(f"a parameter has 1 to {MOST_BITS} bits, found {self.bits}")

    @cached_property
    def length(self) -> int:
        """The number of bits of a genome."""
        return self.parameters * self.bits

    @cached_property
    def genome_bytes(self) -> int:
        """The size of a genome: the bits, rounded up to whole bytes. Bits beyond the length are 0."""
        return (self.length + 7) // 8

    def check(self, recipe: Recipe) -> None:
        """Refuse a recipe whose crossover is not for bit strings.

        Raises:
            ValueError: if it is not.
        """
        if recipe.crossover not in ("one-point", "uniform"):
            raise ValueError(f"bit strings cross by 'one-point' or 'uniform', found {recipe.crossover!r}")

    def random(self, keys: Keys, deme: int) -> Genomes:
        """Return demes of uniformly random bits, shape (rows, deme, genome_bytes)."""
        drawn: Genomes = self._kernels.random(keys.seed, keys.cells, deme, self.length)
        return drawn

    def recombine(self, couples: Genomes, recipe: Recipe, keys: Keys) -> Genomes:
        """Cross couples by one-point (§3.1 step 4) or uniform crossover, then mutate bits; see `Coding.recombine`."""
        offspring: Genomes = self._kernels.recombine(
            couples,
            keys.seed,
            keys.cells,
            keys.generation,
            self.length,
            recipe.crossover == "uniform",
            0.0 if recipe.mutation == ONE_BIT else recipe.mutation,
        )
        return offspring

    def variation(self, recipe: Recipe) -> "Operator":
        """Return `recombine` for one row as a compiled operator."""
        from genetics.operators import Operator

        rate = 0.0 if recipe.mutation == ONE_BIT else float(recipe.mutation)
        return Operator.of(self._kernels.variation, [self.length, recipe.crossover == "uniform"], rate)

    def mutate_one_bit(self) -> "Operator":
        """Return `mutate_one` for one row as a compiled operator."""
        from genetics.operators import Operator

        return Operator.of(self._kernels.mutate_one_bit, self.length)

    def mutate_one(self, individuals: Genomes, keys: Keys) -> Cells:
        """Flip one random bit of one random individual of each row (§3.1 step 5)."""
        changed: Cells = self._kernels.mutate_one(individuals, keys.seed, keys.cells, keys.generation, self.length)
        return changed

    @cached_property
    def alphabet(self) -> Alphabet:
        """All genomes in which no bit beyond the length is set."""
        mask = np.full(self.genome_bytes, 0xFF, np.uint8)
        mask[-1] = (0xFF << (8 * self.genome_bytes - self.length)) & 0xFF
        return Alphabet.of_bits(mask)

    @cached_property
    def _kernels(self) -> Any:
        """The kernels' module. It is imported at first use and cached, since every generation asks for it."""
        from genetics import bit_kernels

        return bit_kernels

    def integers(self, genomes: Genomes) -> NDArray[np.int64]:
        """Return the integers that genomes code: (n, genome_bytes) to (n, parameters)."""
        values: Cells = self._kernels.integers(writable(genomes), self.parameters, self.bits, self.gray)
        return values

    def encode(self, integers: NDArray[np.int64]) -> Genomes:
        """Return genomes that code integers, the inverse of `integers`: (n, parameters) to (n, genome_bytes).

        Raises:
            ValueError: if a value needs more bits, or is negative.
        """
        values = np.asarray(integers, dtype=np.int64)
        if values.min(initial=0) < 0 or values.max(initial=0) >= 1 << self.bits:
            raise ValueError(f"expected integers from 0 to {(1 << self.bits) - 1}, found {values.tolist()}")
        if self.gray:
            values = values ^ (values >> 1)
        shifts = np.arange(self.bits - 1, -1, -1)
        unpacked = (values[:, :, None] >> shifts) & 1
        return np.packbits(unpacked.reshape(len(values), -1).astype(np.uint8), axis=1)
