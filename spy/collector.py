"""The collector of the spy: the best champion so far, which the spy evaluates itself before it passes it on."""

import math

import numpy as np

from genetics import Genomes
from node.plan import Plan
from problems import BadInput, EvaluationFailed
from problems.guard import checked, decoded
from wire.champion import Champion
from wire.news import Improvement

_ROUNDING = 1e-9  # tolerance, relative and absolute, between a cell's fitness and the spy's


class Collector:
    """Keeps the best verified champion of one epoch of a job. It has no input or output.

    Args:
        plan: the plan of the epoch.
        job: the job's number.
        best: the best answer of earlier epochs, if their problem was the same. It stays of the epoch that it names.

    Attributes:
        best: the best verified answer; None if there is none.
        disagreement: why the latest champion that was refused is not believed; None if all were confirmed. One refusal
            makes the run fail, since a node that computes wrong results cannot be trusted.
    """

    def __init__(self, plan: Plan, job: int, best: Improvement | None = None) -> None:
        self.plan = plan
        self.job = job
        self.best = best
        self.disagreement: str | None = None
        self._best: Champion | None = None

    def hear(self, champion: Champion | None, seconds: float) -> Improvement | None:
        """Verify a champion and keep it if it precedes all before.

        Returns:
            The champion as an improvement if it is fitter than all before, else None: also if it is only older than an
            equally fit one, or if its fitness is refused (see `disagreement`).
        """
        if champion is None or not self._comes_before(champion):
            return None
        # A copy that may be written to, since a problem's own code gets it.
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
        """Return whether the champion is better than any before, or as good and older.

        Ages count in this epoch only: an equally fit answer of an earlier epoch stays.
        """
        if self._best is not None:
            return champion < self._best
        if self.best is None or champion.fitness < self.best.fitness:
            return True
        return self.best.epoch == self.plan.epoch and champion.fitness == self.best.fitness

    def _true(self, champion: Champion, genome: Genomes) -> bool:
        """Return whether the spy's own evaluation confirms the champion's fitness; note the disagreement if not."""
        fitness = float(self.plan.evaluate(genome[None])[0])
        # A user's evaluation may round differently for a batch of another size.
        if math.isfinite(fitness) and math.isclose(fitness, champion.fitness, rel_tol=_ROUNDING, abs_tol=_ROUNDING):
            return True
        self.disagreement = f"cell {champion.cell} claims a fitness of {champion.fitness!r}, the spy finds {fitness!r}"
        return False
