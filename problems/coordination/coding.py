"""Individuals that are sequences of synchronisation points (SPs), of variable or of fixed length (§3.1, §3.2).

A genome is a `genetics.sequence.Sequence` whose items are SPs, cells (i, j) of the diagram. The operators repair their
offspring, so SPs increase in both coordinates. Genomes that arrive over the network may violate this, so they are
repaired whenever they are read.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from genetics.recipe import Recipe
from genetics.sequence import Sequence

if TYPE_CHECKING:
    from genetics.operators import Operator
    from problems.coordination.diagram import Arrays

ROOM = 4
"""The most SPs of an individual of variable length, as a multiple of ``points``."""


class SynchronisationPoints(Sequence):
    """SPs on a diagram: exactly ``points`` of them or, if ``variable``, from 1 to `ROOM` times ``points``.

    The name of a crossover also selects the mutations: ``"sp"`` those of the paper, ``"sp-tuned"`` the tuned ones. A
    recipe's ``mutation`` is the probability that the result of a crossover is also mutated (§3.2, evolutionary
    algorithm characteristics).
    """

    crossovers: ClassVar[tuple[str, ...]] = ("sp", "sp-tuned")

    def __init__(self, arrays: Arrays, points: int, variable: bool) -> None:
        cells = len(arrays[0]), len(arrays[1])  # N1 and N2: there is a move time for each number of cells
        least, most = (1, ROOM * points) if variable else (points, points)
        super().__init__(least, most, [(0, side - 1) for side in cells])
        self._arrays = arrays
        self._layout = [variable, *cells, points]

    def initialise(self) -> Operator:
        """Return the operator that makes first demes: sorted uniform draws; see `coding_kernels.initialise` (§3.2)."""
        from genetics.operators import Operator
        from problems.coordination import coding_kernels

        return Operator.of(coding_kernels.initialise, self._layout)

    def variation(self, recipe: Recipe) -> Operator:
        """Return the operator that makes offspring: half by mutation alone, half by crossover, then maybe mutation."""
        from genetics.operators import Operator
        from problems.coordination import coding_kernels

        tuned = recipe.crossover == "sp-tuned"
        return Operator.of(coding_kernels.variation, [*self._layout, tuned], float(recipe.mutation), *self._arrays)
