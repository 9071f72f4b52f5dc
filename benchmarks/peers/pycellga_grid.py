"""pycellga: a cellular genetic algorithm on a grid in one process, as in its own example_alpha_cga.py.

measure.py runs this script in pycellga's own environment, so that pycellga is no dependency of the project. Of its
algorithms and operators this combination reached 1e-2 first. pycellga has no islands, no migration and no batch
evaluation. A fitness of plain `math` is faster than its own, which calls numpy for each number.
"""

import json
import math
import sys
import time

from pycellga.common import GeneType
from pycellga.mutation.float_uniform_mutation import FloatUniformMutation
from pycellga.optimizer import alpha_cga
from pycellga.problems.abstract_problem import AbstractProblem
from pycellga.recombination.blxalpha_crossover import BlxalphaCrossover
from pycellga.selection.tournament_selection import TournamentSelection

LIMIT = 5.12
MOVED = 1.2345  # the optimum of the variant “moved”, because pycellga's operators favour zeros
CROSSOVER, MUTATION = 0.9, 0.2


class LimitReached(Exception):  # noqa: N818
    """Raised to end the run, because pycellga has no limit except the number of generations."""


class Rastrigin(AbstractProblem):
    """The problem, which counts its evaluations."""

    def __init__(self, setting: dict) -> None:
        super().__init__(gen_type=GeneType.REAL, n_var=setting["dimension"], xl=-LIMIT, xu=LIMIT)
        self.target = -math.inf if setting["target"] is None else setting["target"]
        self.deadline = math.inf if setting["seconds"] is None else time.monotonic() + setting["seconds"]
        self.optimum = MOVED if setting["variant"] == "moved" else 0.0
        self.evaluations, self.best = 0, math.inf

    def f(self, x: list[float]) -> float:
        """Return the fitness of one individual."""
        offsets = x if self.optimum == 0.0 else [v - self.optimum for v in x]
        fitness = 10.0 * self.n_var + sum([v * v - 10.0 * math.cos(2.0 * math.pi * v) for v in offsets])
        self.evaluations += 1
        self.best = min(self.best, fitness)
        if self.best <= self.target or (self.evaluations % 64 == 0 and time.monotonic() > self.deadline):
            raise LimitReached
        return fitness


def main() -> None:
    """Print a JSON line when ready, then one with the outcome."""
    setting = json.loads(sys.argv[1])
    individuals = setting["islands"] * setting["deme"]
    side = math.isqrt(individuals)
    print(json.dumps({"spawn": None, "workers": []}), flush=True)
    began = time.monotonic()
    problem = Rastrigin(setting)
    generations = 1 << 30 if setting["generations"] is None else setting["generations"]
    try:
        alpha_cga(
            n_cols=side,
            n_rows=side,
            n_gen=generations,
            ch_size=setting["dimension"],
            p_crossover=CROSSOVER,
            p_mutation=MUTATION,
            problem=problem,
            selection=TournamentSelection,
            recombination=BlxalphaCrossover,
            mutation=FloatUniformMutation,
            seed_par=setting["seed"],
        )
    except LimitReached:
        # The expected number, because pycellga does not report how many it ran.
        generations = problem.evaluations / individuals / (2 * CROSSOVER + 2 * MUTATION)
    seconds = time.monotonic() - began
    ended = {"seconds": seconds, "generations": generations, "evaluations": problem.evaluations}
    print(json.dumps(ended | {"best": problem.best}), flush=True)


if __name__ == "__main__":
    main()
