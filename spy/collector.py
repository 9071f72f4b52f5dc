"""What the spy believes: the best solution so far, evaluated by the spy itself before it is passed on."""

import math

import numpy as np

from genetics import Genomes
from node.plan import Plan
from problems import BadInput, EvaluationFailed
from problems.guard import checked, decoded
from wire.exchange import Champion
from wire.news import Improvement

_ROUNDING = 1e-9


class Collector:
    """Keeps the best verified champion of one epoch of a job. No input or output.

    Args:
        plan: of the epoch.
        job: its number.
        best: the best answer of the epochs before, if their problem was the same. If it is said to be of one of them,
            it is kept as of there.
    """

    def __init__(self, plan: Plan, job: int, best: Improvement | None = None) -> None:
        self.plan = plan
        self.job = job
        self.best = best
        self.disagreement: str | None = None
        self._best: Champion | None = None

    def hear(self, champion: Champion | None, seconds: float) -> Improvement | None:
        """A better champion than any before, if this is one and its fitness is true."""
        if champion is None or not self._comes_before(champion):
            return None
        genome = np.frombuffer(bytearray(champion.genome), np.uint8)
        try:
            if not self._true(champion, genome):
                return None
            solution = decoded(self.plan.problem, genome)
            feasible = checked(self.plan.problem, solution).feasible
        except BadInput as error:
            self.disagreement = f"the check cannot read the solution: {error}"
            return None
        except EvaluationFailed as error:
            self.disagreement = str(error)
            return None
        improves = self.best is None or champion.fitness < self.best.fitness
        self._best = champion
        place = (self.job, self.plan.epoch, seconds, champion.generation, champion.cell)
        self.best = Improvement(*place, champion.fitness, feasible, solution)
        return self.best if improves else None

    def _comes_before(self, champion: Champion) -> bool:
        """Whether it is better than any before, or as good and older; of other epochs the age is not known."""
        if self._best is not None:
            return champion < self._best
        if self.best is None or champion.fitness < self.best.fitness:
            return True
        return self.best.epoch == self.plan.epoch and champion.fitness == self.best.fitness

    def _true(self, champion: Champion, genome: Genomes) -> bool:
        fitness = float(self.plan.evaluate(genome[None])[0])
        # A user's evaluation may round differently for a batch of another size.
        if math.isfinite(fitness) and math.isclose(fitness, champion.fitness, rel_tol=_ROUNDING, abs_tol=_ROUNDING):
            return True
        self.disagreement = f"cell {champion.cell} claims a fitness of {champion.fitness!r}, the spy finds {fitness!r}"
        return False
