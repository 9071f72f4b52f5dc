"""The codings of paths: via points and last the goal; or a clew, for the paper recipe."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from genetics.recipe import ONE_BIT, Recipe
from genetics.sequence import MOST_GENE, Sequence
from problems.robot_path.clew import MOST_LANDMARKS, ROUNDS

if TYPE_CHECKING:
    from genetics.operators import Operator


class Paths(Sequence):
    """Sequences of via points {q_1, .., q_m, goal}; the start is no item.

    A via point has one gene for each joint, over the joint's limits. Of the last item only the first gene counts: the
    index of the goal.

    Args:
        joints: the number of joints.
        most: the greatest number of items, the goal included.
        task: the operator of the fitness. Its table holds the task; making and varying paths need the same one.
    """

    crossovers: ClassVar[tuple[str, ...]] = ("joining",)

    def __init__(self, joints: int, most: int, task: Operator) -> None:
        self.joints, self._task = joints, task
        super().__init__(1, most, [(0, MOST_GENE)] * joints)

    def initialise(self) -> Operator:
        """Return the operator that makes first paths: a bidirectional tree for each, as far as its budget goes."""
        from problems.robot_path import coding_kernels

        return self._task.sharing(coding_kernels.initialise)

    def variation(self, recipe: Recipe) -> Operator:
        """Return the operator that joins two paths, and then shortens the offspring or grows new trees."""
        from problems.robot_path import coding_kernels

        assert recipe.mutation != ONE_BIT, "refused by check"
        return self._task.sharing(coding_kernels.variation, float(recipe.mutation))


class Clews(Sequence):
    """Landmarks, each reached from an earlier one, and a motion of two Manhattan rounds (Ariadne's clew).

    Args:
        joints: the number of joints.
        task: the operator of the fitness.
    """

    crossovers: ClassVar[tuple[str, ...]] = ("one-point",)

    def __init__(self, joints: int, task: Operator) -> None:
        self._task = task
        super().__init__(ROUNDS, MOST_LANDMARKS + ROUNDS, [(0, MOST_LANDMARKS), *[(0, MOST_GENE)] * joints])

    def initialise(self) -> Operator:
        """Return the operator that makes random motions from the start."""
        from problems.robot_path import paper_kernels

        return self._task.sharing(paper_kernels.initialise)

    def variation(self, recipe: Recipe) -> Operator:
        """Return the operator that crosses and mutates motions, and lets clews grow."""
        from problems.robot_path import paper_kernels

        assert recipe.mutation != ONE_BIT, "refused by check"
        return self._task.sharing(paper_kernels.variation, float(recipe.mutation))
