"""The choices that make up a breeding rule, such as the crossover and the replacement."""

from dataclasses import dataclass
from typing import Literal

Replacement = Literal["offspring", "elitist"]
Pairing = Literal["rank", "better-half"]
ONE_BIT: Literal["one-bit"] = "one-bit"


@dataclass(frozen=True)
class Recipe:
    """How a deme breeds.

    Attributes:
        crossover: how two parents make two offspring, by a name that the coding knows.
        mutation: the probability that a bit or real gene of an offspring changes (for permutations, that an offspring
            changes). Or ``"one-bit"``, the rule of Ahuactzin et al. 1992, §3.1 step 5: one random bit of one random
            individual in each generation.
        replacement: ``"offspring"`` is the paper's rule: in a deme of one the best offspring replaces the individual
            (§6); on an island each couple leaves the best of parents and offspring (§3.1 step 4). ``"elitist"`` also
            never loses the best individual to worse offspring, though on an island the one-bit mutation may change it.
        pairing: how parents are drawn on an island: by ``"rank"`` (§3.1 step 3), or from the ``"better-half"`` with
            equal probability.
        renewal: None: an island has as many couples as individuals, and each couple leaves the best of itself and its
            offspring. Otherwise the share of the deme, its worst part, that offspring replace even if they are less
            fit. With 1 each generation replaces the previous one entirely.
        most_selections: how often an individual of an island may be a parent in one generation, if parents are drawn by
            rank; 0: any number of times.

    Raises:
        ValueError: if the renewal is not above 0 and at most 1.
    """

    crossover: str = "one-point"
    mutation: float | Literal["one-bit"] = 0.0
    replacement: Replacement = "offspring"
    pairing: Pairing = "rank"
    renewal: float | None = None
    most_selections: int = 0

    def __post_init__(self) -> None:
        if self.renewal is not None and not 0 < self.renewal <= 1:
            raise ValueError(f"expected a renewal above 0 and at most 1, found {self.renewal}")

    def couples(self, deme: int) -> int:
        """Return the number of couples of an island in a generation. Each has two offspring."""
        return deme if self.renewal is None else max(1, round(deme * self.renewal) // 2)


def evaluations_per_generation(deme: int, slots: int, recipe: Recipe) -> int:
    """Return the number of fitness calls of one cell in one generation; it never depends on the draws.

    On an island the one-bit mutation changes an individual that was evaluated already, which costs one more.
    """
    if deme == 1:
        return 2 * slots
    return 2 * recipe.couples(deme) + (1 if recipe.mutation == ONE_BIT else 0)
