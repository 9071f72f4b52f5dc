"""Inverse kinematics: how surely, and how soon, the discretised optimum of random two-link worlds is found.

Usage: python -m benchmarks.arm_ik [--worlds 200] [--torus 8x8] [--bits 8]

The optimum comes from the enumeration of all 2^(2q) configurations and is each run's target; a run that does not find
it ends by the stall limit. Evaluations are counted to the end of the generation in which the optimum was born, *total*
and *distinct* (the same genome again is not counted); their medians are over the runs that found it.
"""

import argparse
import multiprocessing
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from benchmarks.arm_worlds import arm_world
from genetics import Fitness, Genomes
from genetics.arrays import Evaluate
from node import Plan, simulate
from problems import Run
from problems.arm_ik.oracle import enumerate_best
from problems.run import DEFAULT_STALL

SEQUENTIAL_DEME = 100


@dataclass(frozen=True)
class Entry:
    """A line of the table: which recipe, code and topology."""

    recipe: Literal["tuned", "paper"]
    code: Literal["gray", "binary"]
    sequential: bool


ENTRIES = (
    Entry("tuned", "gray", False),
    Entry("tuned", "binary", False),
    Entry("paper", "binary", False),
    Entry("paper", "gray", False),
    Entry("tuned", "gray", True),
    Entry("paper", "binary", True),
    Entry("paper", "gray", True),
)


@dataclass(frozen=True)
class Trial:
    """One entry in one world."""

    entry: Entry
    world: int
    torus: str
    bits: int


@dataclass(frozen=True)
class Outcome:
    """What came of a trial: whether the optimum was found, and after how many evaluations."""

    found: bool
    total: int
    distinct: int


class RecordedPlan(Plan):
    """A plan that keeps what is evaluated, one batch for each generation."""

    @cached_property
    def batches(self) -> list[Genomes]:
        """The genomes, in order."""
        return []

    @cached_property
    def evaluate(self) -> Evaluate:
        """The problem's fitness, kept note of."""

        def evaluate(genomes: Genomes) -> Fitness:
            self.batches.append(genomes.copy())
            return self.problem.evaluate(genomes)

        return evaluate


def outcome(trial: Trial) -> Outcome:
    """Run one trial."""
    entry = trial.entry
    problem = arm_world(trial.world, trial.bits).model_copy(update={"code": entry.code})
    optimum, _ = enumerate_best(problem)
    run = Run(
        topology="torus 1x1" if entry.sequential else f"torus {trial.torus}",
        deme=SEQUENTIAL_DEME if entry.sequential else 1,
        recipe=entry.recipe,
        seed=trial.world + 1,
        target=optimum,
        stall=DEFAULT_STALL,
    )
    plan = RecordedPlan(problem, run)
    champion = simulate(plan)[0].champion
    if champion is None or champion.fitness > optimum:
        return Outcome(False, 0, 0)
    batches = _until(plan, champion.genome)
    return Outcome(True, sum(map(len, batches)), len(np.unique(np.concatenate(batches), axis=0)))


def _until(plan: RecordedPlan, genome: bytes) -> list[Genomes]:
    """The batches up to the first that holds ``genome``."""
    wanted = np.frombuffer(genome, np.uint8)
    for number, batch in enumerate(plan.batches, start=1):
        if np.any(np.all(batch == wanted, axis=1)):
            return plan.batches[:number]
    raise ValueError("the champion was never evaluated")


def line(entry: Entry, outcomes: list[Outcome], torus: str, bits: int) -> str:
    """A line of the table."""
    found = [each for each in outcomes if each.found]
    where = f"1x1, deme {SEQUENTIAL_DEME}" if entry.sequential else f"{torus}, deme 1"
    head = f"| {where} | {entry.recipe} | {entry.code} | {len(found) / len(outcomes):.1%} |"
    if not found:
        return f"{head} | | | |"
    total = np.array([each.total for each in found])
    distinct = np.median([each.distinct for each in found])
    codes = 1 << 2 * bits
    return (
        f"{head} {np.median(total):,.0f} | {np.quantile(total, 0.9):,.0f} | {np.median(total) / codes:.1%} |"
        f" {distinct:,.0f} | {distinct / codes:.1%} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=200, help="how many")
    parser.add_argument("--torus", default="8x8", help="rows and columns")
    parser.add_argument("--bits", type=int, default=8, help="of each joint angle")
    options = parser.parse_args()
    print(f"{options.worlds} random worlds, {1 << 2 * options.bits:,} configurations each\n")
    print("| torus | recipe | code | optimum found | evaluations | 90 % within | of all | distinct | of all |")
    print("|---|---|---|---|---|---|---|---|---|")
    with multiprocessing.get_context("spawn").Pool() as pool:
        for entry in ENTRIES:
            trials = [Trial(entry, world, options.torus, options.bits) for world in range(options.worlds)]
            outcomes = pool.map(outcome, trials, chunksize=8)
            print(line(entry, outcomes, options.torus, options.bits), flush=True)


if __name__ == "__main__":
    main()
