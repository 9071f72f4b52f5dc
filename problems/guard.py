"""A fence around a problem's evaluation: whatever it does, the node gets fitness values or one clear error."""

import numpy as np

from genetics.arrays import Evaluate, Fitness, Genomes
from problems.errors import EvaluationFailed
from problems.problem import Problem


def guarded(problem: Problem) -> Evaluate:
    """``problem.evaluate`` that raises `EvaluationFailed` if it raises or returns NaN, or not one value for each."""

    def evaluate(genomes: Genomes) -> Fitness:
        try:
            # A copy: what the problem returned may be read-only, or an array that it will use again.
            fitness = np.array(problem.evaluate(genomes), dtype=np.float64, order="C")
        except Exception as error:
            raise EvaluationFailed(f"{problem.kind}: evaluate raised {type(error).__name__}: {error}") from error
        if fitness.shape != (len(genomes),):
            raise EvaluationFailed(
                f"{problem.kind}: evaluate must return an array of shape ({len(genomes)},), got {fitness.shape}"
            )
        wrong = np.flatnonzero(np.isnan(fitness) | (fitness == -np.inf))
        if wrong.size:
            raise EvaluationFailed(
                f"{problem.kind}: evaluate must not return NaN or -inf, got {fitness[wrong[0]]}"
                f" for genome {genomes[wrong[0]].tobytes().hex()}"
            )
        return fitness

    return evaluate
