"""Individuals that are sequences of synchronisation points (SPs), of variable or of fixed length (§3.1, §3.2).

A genome is a `genetics.sequence.Sequence` whose items are SPs, cells (i, j) of the diagram. Whatever makes offspring
repairs them too, so they increase in both coordinates; those that come over the wire may not, and are repaired where
they are read.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from genetics.recipe import Recipe
from genetics.sequence import Sequence

if TYPE_CHECKING:
    from genetics.operators import Operator
    from problems.coordination.diagram import Arrays

ROOM = 4
"""How many times ``points`` an individual of variable length may grow to."""


class SynchronisationPoints(Sequence):
    """SPs on a diagram: exactly ``points`` of them, or 1 to `ROOM` times as many if ``variable``.

    Crossovers are named with the mutations that go with them: ``"sp"`` those of the paper, ``"sp-tuned"`` ours. A
    recipe's ``mutation`` is the probability that what comes of a crossover is mutated, too (§3.2, evolutionary
    algorithm characteristics).
    """

    crossovers: ClassVar[tuple[str, ...]] = ("sp", "sp-tuned")

    def __init__(self, arrays: Arrays, points: int, variable: bool) -> None:
        cells = len(arrays[0]), len(arrays[1])
        least, most = (1, ROOM * points) if variable else (points, points)
        super().__init__(least, most, [(0, side - 1) for side in cells])
        self._arrays = arrays
        self._layout = [variable, *cells, points]

    def initialise(self) -> Operator:
        """Uniform draws for each coordinate, sorted; of the lengths 1 to ``points``, n with probability ∝ n (§3.2)."""
        from genetics.operators import Operator
        from problems.coordination import kernels

        return Operator.of(kernels.initialise, self._layout)

    def variation(self, recipe: Recipe) -> Operator:
        """Half of the offspring by mutation alone, the others by crossover, then perhaps mutation."""
        from genetics.operators import Operator
        from problems.coordination import kernels

        tuned = recipe.crossover == "sp-tuned"
        return Operator.of(kernels.variation, [*self._layout, tuned], float(recipe.mutation), *self._arrays)
