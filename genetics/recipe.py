"""The choices that make up a breeding rule."""

from dataclasses import dataclass
from typing import Literal

Crossover = Literal["one-point", "uniform", "blend"]
Replacement = Literal["offspring", "elitist"]
ONE_BIT: Literal["one-bit"] = "one-bit"


@dataclass(frozen=True)
class Recipe:
    """How a deme breeds.

    Attributes:
        crossover: how two parents make two offspring.
        mutation: the probability that one bit (or real gene) of an offspring changes; or ``"one-bit"``, the rule of
            Ahuactzin et al. 1992, §3.1 step 5: one random bit of one random individual a generation.
        replacement: ``"offspring"``, the paper's rule (§6: the best of the offspring replaces the local individual; in
            an island, §3.1 step 4: the best of parents and offspring); ``"elitist"`` also never loses the best to worse
            offspring (on an island the one-bit mutation may still hit it).
    """

    crossover: Crossover = "one-point"
    mutation: float | Literal["one-bit"] = 0.0
    replacement: Replacement = "offspring"


def evaluations_per_generation(deme: int, slots: int, recipe: Recipe) -> int:
    """The number of fitness calls that one cell makes in one generation."""
    if deme == 1:
        return 2 * slots
    return 2 * deme + (1 if recipe.mutation == ONE_BIT else 0)
