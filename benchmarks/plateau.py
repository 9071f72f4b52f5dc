"""Measure search where most individuals are equally fit: single cells, islands by families, islands by renewal.

Usage: python -m benchmarks.plateau [--seeds 20]

*New* is measured where all fitness is equal: the share of individuals after 100 generations that the first generation
did not contain. *Found* is the share of seeds that find a feasible individual before the run stalls after 200
generations. In that problem the fitness is infinite unless 27 of 32 bits are ones, which holds for 1 of 17,700
individuals. *Evaluations* is the median number that the successful runs needed.

All runs are on a torus of 4 × 4 with the default recipe of a user's own problem. Only the renewal is changed.
"""

import argparse
import statistics
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from genetics import BitString, Fitness, Genomes, Recipe
from node.plan import Plan
from node.simulation import simulate
from problems import Problem, Run
from problems.tables import RecipeName

GENERATIONS = 100
_BITS, _ONES = 32, 27
_RULES = ((1, None), (16, None), (20, None), (16, 1.0))  # deme, renewal


class Flat(Problem):
    """A problem in which all individuals are equally fit."""

    is_batch_invariant = True
    kind: str = "flat"
    renewal: float | None = None

    @cached_property
    def coding(self) -> BitString:
        """Return the coding: bits."""
        return BitString(_BITS, 1)

    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return the same fitness for all individuals."""
        return np.zeros(len(genomes))

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """Return the default recipe, with this problem's renewal."""
        return replace(super().recipe(name, deme), renewal=self.renewal)


class Constrained(Flat):
    """A problem with few feasible individuals, which are all equally fit."""

    kind: str = "constrained"

    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return 0 for individuals with enough ones, else infinity."""
        return np.where(self.coding.integers(genomes).sum(axis=1) >= _ONES, 0.0, np.inf)


class Row(NamedTuple):
    """The figures of a rule: shares of all individuals and of all seeds, and median evaluations."""

    new: float
    found: float
    evaluations: float


def main() -> None:
    """Print a table with one line for each rule."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, help="runs of each rule")
    options = parser.parse_args()
    print("| deme | renewal | new | found | evaluations |\n|---:|---|---:|---:|---:|")
    for deme, renewal in _RULES:
        row = measured(deme, renewal, range(1, options.seeds + 1))
        rule = "families" if renewal is None else f"{renewal:g}"
        print(
            f"| {deme} | {'' if deme == 1 else rule} | {row.new:.0%} | {row.found:.0%} | {row.evaluations:,.0f} |",
            flush=True,
        )


def measured(deme: int, renewal: float | None, seeds: Sequence[int]) -> Row:
    """Measure one rule."""
    found = [until_feasible(deme, renewal, seed) for seed in seeds]
    spent = [each for each in found if each is not None]
    new = statistics.fmean(share_of_new(deme, renewal, seed) for seed in seeds)
    return Row(new, len(spent) / len(found), statistics.median(spent) if spent else float("nan"))


def share_of_new(deme: int, renewal: float | None, seed: int) -> float:
    """Return the share of individuals on the flat problem, after 100 generations, that the first did not contain."""
    run = Run(deme=deme, seed=seed, generations=GENERATIONS)
    plan = Plan(Flat(renewal=renewal), run)
    first = plan.coding.random(plan.keys(np.arange(plan.topology.cells), 0), deme).reshape(-1, plan.coding.genome_bytes)
    known = {genome.tobytes() for genome in first}
    last = [genome for report in simulate(plan) for genome in plan.deme_of(report.deme)]
    return sum(genome.tobytes() not in known for genome in last) / len(last)


def until_feasible(deme: int, renewal: float | None, seed: int) -> int | None:
    """Return the evaluations up to the generation with the first feasible individual; None if the run stalls first."""
    plan = Plan(Constrained(renewal=renewal), Run(deme=deme, seed=seed, target=0.0))
    champion = min((report.champion for report in simulate(plan) if report.champion is not None), default=None)
    if champion is None:
        return None
    return plan.topology.cells * (deme + champion.generation * plan.evaluations_per_generation)


if __name__ == "__main__":
    main()
