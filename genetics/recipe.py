"""The choices that make up a breeding rule."""

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
        mutation: the probability that one bit (or real gene) of an offspring changes; or ``"one-bit"``, the rule of
            Ahuactzin et al. 1992, §3.1 step 5: one random bit of one random individual a generation.
        replacement: ``"offspring"``, the paper's rule (§6: the best of the offspring replaces the local individual; in
            an island, §3.1 step 4: the best of parents and offspring); ``"elitist"`` also never loses the best to worse
            offspring (on an island the one-bit mutation may still hit it).
        pairing: who the parents are on an island: drawn by ``"rank"`` (§3.1 step 3), or anyone of the
            ``"better-half"``.
        renewal: on an island, None: as many couples as individuals, each leaves the best of itself and its offspring.
            Otherwise the share of the deme, the worst of it, whose place offspring take, whatever they are worth; all
            of it is a generation that replaces the one before.
        most_selections: how often one individual may be a parent in a generation of an island, by rank; 0 for any
            number of times.

    Raises:
        ValueError: if the renewal is no share.
    """

    crossover: str = "one-point"
    mutation: float | Literal["one-bit"] = 0.0
    replacement: Replacement = "offspring"
    pairing: Pairing = "rank"
    renewal: float | None = None
    most_selections: int = 0

    def __post_init__(self) -> None:
        if self.renewal is not None and not 0 < self.renewal <= 1:
            raise ValueError(f"expected a renewal above 0, at most 1, found {self.renewal}")

    def couples(self, deme: int) -> int:
        """How many couples an island has in a generation."""
        return deme if self.renewal is None else max(1, round(deme * self.renewal) // 2)


def evaluations_per_generation(deme: int, slots: int, recipe: Recipe) -> int:
    """The number of fitness calls that one cell makes in one generation."""
    if deme == 1:
        return 2 * slots
    return 2 * recipe.couples(deme) + (1 if recipe.mutation == ONE_BIT else 0)
