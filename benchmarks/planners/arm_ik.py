"""Measure how often and how soon arm-ik finds the discretised optimum of random two-link worlds.

The optimum comes from the enumeration of all configurations and is each run's target. A run that does not find it ends
by the stall limit. Evaluations are counted to the end of the generation in which the optimum was born, *total* and
*distinct* (repeated genomes are not counted). Their medians are over the runs that found it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmarks.arm_worlds import arm_world
from benchmarks.planners.runs import on_all_cores, share
from genetics import Fitness, Genomes
from genetics.arrays import Evaluate
from node.plan import Plan
from node.simulation import simulate
from problems import Run
from problems.arm_ik.oracle import enumerate_best
from problems.run import DEFAULT_STALL
from problems.tables import RecipeName

WORLDS = 200
BITS = 8
CODES = 1 << 2 * BITS
_ROUNDING = 1e-9  # m, the difference between the oracle's kinematics and the fitness's


@dataclass(frozen=True)
class Entry:
    """A line of the table: a recipe, a code and a population."""

    recipe: RecipeName
    code: str
    topology: str = "torus 8x8"
    deme: int = 1


ENTRIES = (
    Entry("tuned", "gray"),
    Entry("tuned", "binary"),
    Entry("paper", "binary"),
    Entry("paper", "gray"),
    Entry("tuned", "gray", "torus 4x4"),
    Entry("tuned", "gray", "torus 1x1", 100),
    Entry("paper", "binary", "torus 1x1", 100),
)


@dataclass(frozen=True)
class Trial:
    """The outcome of a run: the evaluations until the optimum was found, if it was."""

    found: bool
    total: int = 0
    distinct: int = 0


class RecordedPlan(Plan):
    """A plan that records the evaluated genomes, one batch for each generation."""

    @cached_property
    def batches(self) -> list[Genomes]:
        """Return the recorded batches, in order."""
        return []

    @cached_property
    def evaluate(self) -> Evaluate:
        """Return the problem's fitness, which also records the genomes."""

        def evaluate(genomes: Genomes) -> Fitness:
            self.batches.append(genomes.copy())
            return self.problem.evaluate(genomes)

        return evaluate


def section(quick: bool) -> str:
    """Run all entries in all worlds; return the part of docs/results.md."""
    worlds = range(1, (4 if quick else WORLDS) + 1)
    trials = list(zip(*on_all_cores(_in_world, worlds), strict=True))  # by entry
    return "\n".join([*_head(len(worlds), trials), "", *_table(trials)])


def _in_world(number: int) -> list[Trial]:
    """Run every entry in one world."""
    optimum = enumerate_best(arm_world(number, BITS))[0] + _ROUNDING
    return [_trial(entry, number, optimum) for entry in ENTRIES]


def _trial(entry: Entry, number: int, optimum: float) -> Trial:
    problem = arm_world(number, BITS).model_copy(update={"code": entry.code})
    settings = {"topology": entry.topology, "deme": entry.deme, "recipe": entry.recipe, "stall": DEFAULT_STALL}
    plan = RecordedPlan(problem, Run(seed=number, target=optimum, **settings))
    champion = simulate(plan)[0].champion
    if champion is None or champion.fitness > optimum:
        return Trial(found=False)
    batches = _until(plan, champion.genome)
    return Trial(True, sum(map(len, batches)), len(np.unique(np.concatenate(batches), axis=0)))


def _until(plan: RecordedPlan, genome: bytes) -> list[Genomes]:
    """Return the batches up to the first that contains ``genome``."""
    wanted = np.frombuffer(genome, np.uint8)
    for number, batch in enumerate(plan.batches, start=1):
        if np.any(np.all(batch == wanted, axis=1)):
            return plan.batches[:number]
    raise ValueError("the champion was never evaluated")


def _head(worlds: int, trials: Sequence[Sequence[Trial]]) -> list[str]:
    tuned, binary, paper = (share(trial.found for trial in of_entry) for of_entry in trials[:3])
    total, distinct = _medians(trials[0])
    return [
        "## arm-ik",
        "",
        "`python -m benchmarks.planners --only arm-ik`",
        "",
        f"{worlds} random two-link worlds (`benchmarks/arm_worlds.py`, 1 to {worlds}, which are also the runs' seeds),",
        f"{BITS} bits a joint. The discretised optimum is that of all {CODES:,} configurations, by enumeration; each",
        f"run has it as its target and ends there or after {DEFAULT_STALL} generations without anything better.",
        "",
        "| asked | reached by tuned, 8 × 8 | plain binary | paper |",
        "|---|---|---|---|",
        f"| the optimum in ≥ 99 % of runs | {tuned} | {binary} | {paper} |",
        f"| median evaluations until found ≤ 10 % of all | {_of_all(total)} total, {_of_all(distinct)} distinct | | |",
    ]


def _medians(trials: Sequence[Trial]) -> tuple[float, float]:
    found = [trial for trial in trials if trial.found]
    if not found:
        return np.nan, np.nan
    return float(np.median([trial.total for trial in found])), float(np.median([trial.distinct for trial in found]))


def _table(trials: Sequence[Sequence[Trial]]) -> list[str]:
    return [
        "| torus, deme | recipe | code | optimum found | evaluations, median | 90 % | of all | distinct | of all |",
        "|---|---|---|---|---:|---:|---:|---:|---:|",
        *(_line(entry, of_entry) for entry, of_entry in zip(ENTRIES, trials, strict=True)),
    ]


def _line(entry: Entry, trials: Sequence[Trial]) -> str:
    where = f"{entry.topology.removeprefix('torus ')}, {entry.deme}"
    head = f"| {where} | {entry.recipe} | {entry.code} | {share(trial.found for trial in trials)} |"
    total, distinct = _medians(trials)
    most = np.quantile([trial.total for trial in trials if trial.found] or [np.nan], 0.9)
    return f"{head} {total:,.0f} | {most:,.0f} | {_of_all(total)} | {distinct:,.0f} | {_of_all(distinct)} |"


def _of_all(evaluations: float) -> str:
    return f"{100 * evaluations / CODES:.1f} %"
