"""Compare the three codings of coordination, as the paper's Table I does, and with dynamic programming."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from statistics import mean, pstdev
from typing import Any

import numpy as np

from benchmarks.planners.runs import Outcome, on_all_cores, run
from genetics import Genomes
from node.plan import Plan
from node.simulation import simulate
from problems import ProblemFile, Run, load
from problems.coordination import Coordination

RUNS = 40
DIAGRAMS = 100
WITHIN = 1.02  # times the optimum
_FIRST = 101  # the first number of the many diagrams
_REPEATS = 400  # repetitions of the timed recombination
CODINGS = ("variable", "fixed", "binary")

_EXAMPLES = Path(__file__).resolve().parent.parent.parent / "examples"
_PAPER = {"topology": "torus 1x1", "deme": 100, "recipe": "paper", "generations": 300}
_ISLAND = {"topology": "torus 1x1", "deme": 100, "recipe": "tuned", "generations": 300}
_TORUS = {"topology": "torus 4x4", "recipe": "tuned"}
_SETTINGS = {"paper, 1x1, deme 100": _PAPER, "tuned, 1x1, deme 100": _ISLAND, "tuned, 4x4": _TORUS}
_FIELDS: dict[str, dict[str, Any]] = {
    "mirrored": {"random": {"seed": 1, "layout": "mirrored"}},
    "scattered": {"random": {"seed": 1, "layout": "scattered"}},
}


@dataclass(frozen=True)
class Trial:
    """The outcome of one run of one coding."""

    diagram: str
    coding: str
    settings: str
    seed: int


def section(quick: bool) -> str:
    """Return the part of docs/results.md."""
    runs, diagrams = (4, 4) if quick else (RUNS, DIAGRAMS)
    return "\n\n".join([_HEAD, *_codings(runs), _operators(), _many(diagrams)])


_HEAD = f"""\
## coordination

180 × 180 cells; 0.1 s a cell, but for arms; 0.2 s to reach that speed. *mirrored* is `examples/coordination.toml`:
sixteen images of one random region; *scattered* has sixteen random regions; *arms* is
`examples/coordination-arms.toml`, whose diagram python-fcl computes. Seeds 1 to {RUNS} for each coding.

- `paper, 1x1, deme 100` is the paper's algorithm: `--recipe paper --torus 1x1 --deme 100 --generations 300`.
- `tuned, 1x1, deme 100` is ours at the same size: `--torus 1x1 --deme 100 --generations 300`.
- `tuned, 4x4` is the default, which ends by stall.

*Optimum*: dynamic programming, any number of synchronisation points. The paper's Table I, on its own diagram (s):
binary 54.78 ± 0.56, best 53.25; fixed 42.23 ± 2.78, best 37.63; variable 41.19 ± 1.16, best 38.63."""


@cache
def _file(diagram: str) -> ProblemFile:
    if diagram == "arms":
        return load(_EXAMPLES / "coordination-arms.toml")
    return ProblemFile(diagram, {"kind": "coordination"} | _FIELDS[diagram], Run(), Path())


@cache
def _problem(diagram: str, coding: str) -> Coordination:
    file = _file(diagram)
    problem = ProblemFile(file.name, file.fields | {"coding": coding}, file.run, file.folder).problem()
    assert isinstance(problem, Coordination)
    return problem


@cache
def _optimum(diagram: str) -> float:
    return _problem(diagram, "variable").oracle().fitness


def _try(trial: Trial) -> Outcome:
    return run(_problem(trial.diagram, trial.coding), seed=trial.seed, **_SETTINGS[trial.settings])


def _codings(runs: int) -> list[str]:
    """Return a table for each diagram."""
    return [_table_1(diagram, runs) for diagram in (*_FIELDS, "arms")]


def _table_1(diagram: str, runs: int) -> str:
    problem, optimum = _problem(diagram, "variable"), _optimum(diagram)
    bound = problem.oracle().figures["time of the slower path alone"]
    lines = [
        f"**{diagram}**: optimum {optimum:.3f} s; the slower path alone takes {bound:.3f} s.",
        "",
        "| recipe | coding | mean / s | σ / s | best / s | within 2 % | feasible | evaluations, median | seconds |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    orders = []
    for settings in _SETTINGS:
        entries = [_entry(diagram, coding, settings, runs) for coding in CODINGS]
        lines += [entry.row(optimum) for entry in entries]
        orders.append(_order(settings, entries))
    return "\n".join([*lines, "", *orders])


@dataclass(frozen=True)
class Entry:
    """All runs of one coding."""

    settings: str
    coding: str
    outcomes: list[Outcome]

    @cached_property
    def times(self) -> list[float]:
        """Return the times of the feasible runs, s."""
        return [each.fitness for each in self.outcomes if each.feasible and each.fitness is not None]

    @property
    def mean(self) -> float:
        """Return the mean time; infinite if a run found nothing."""
        return mean(self.times) if len(self.times) == len(self.outcomes) else np.inf

    def row(self, optimum: float) -> str:
        """Return a line of the table; mean and σ are over the feasible runs."""
        figures = ["", "", ""]
        if self.times:
            figures = [f"{mean(self.times):.2f}", f"{pstdev(self.times):.2f}", f"{min(self.times):.2f}"]
        near = sum(time <= WITHIN * optimum for time in self.times)
        cells = [
            self.settings,
            self.coding,
            *figures,
            f"{near} of {len(self.outcomes)}",
            f"{len(self.times)} of {len(self.outcomes)}",
            f"{np.median([each.evaluations for each in self.outcomes]):,.0f}",
            f"{np.median([each.seconds for each in self.outcomes]):.2f}",
        ]
        return f"| {' | '.join(cells)} |"


def _entry(diagram: str, coding: str, settings: str, runs: int) -> Entry:
    trials = [Trial(diagram, coding, settings, seed) for seed in range(1, runs + 1)]
    return Entry(settings, coding, list(on_all_cores(_try, trials)))


def _order(settings: str, entries: list[Entry]) -> str:
    """Return the paper's claims for one recipe: the order of the means, the lesser σ, and the best coding."""
    by_mean = sorted(entries, key=lambda entry: entry.mean)
    ranked = by_mean[0].coding
    for before, entry in pairwise(by_mean):
        ranked += f" {'<' if f'{before.mean:.2f}' < f'{entry.mean:.2f}' else '='} {entry.coding}"
    lines = [f"- {settings}: means {ranked}"]
    variable, fixed = entries[:2]
    if variable.times and fixed.times:
        lower = "less" if pstdev(variable.times) < pstdev(fixed.times) else "not less"
        best = min(fixed.times) - min(variable.times)
        least = "fixed" if best < -1e-9 else "variable" if best > 1e-9 else "both"
        lines.append(f"σ of variable {lower} than of fixed; least minimum: {least}")
    return "; ".join(lines) + "."


def _operators() -> str:
    """Return the cost of an offspring, variable beside fixed."""
    costs = {coding: _cost(_problem("mirrored", coding)) for coding in ("variable", "fixed")}
    ratio = costs["variable"] / costs["fixed"]
    return (
        "Crossover and mutation of the last generation of a `paper` run, for one offspring, on one core: variable "
        f"{costs['variable']:.0f} ns, fixed {costs['fixed']:.0f} ns, ratio {ratio:.2f} (the paper: as low as 0.6)."
    )


def _cost(problem: Coordination) -> float:
    """Return nanoseconds for an offspring of parents that the recipe bred; the least of some measurements."""
    plan = Plan(problem, Run(**_PAPER))
    demes: list[Genomes] = []
    simulate(plan, snapshot=lambda _, genomes, __: demes.append(genomes.copy()))
    couples = np.tile(demes[-1][0].reshape(1, -1, 2, problem.coding.genome_bytes), (1, _REPEATS, 1, 1))
    keys = plan.keys(np.zeros(1, np.int64), 1)
    measured = []
    for _ in range(7):
        started = time.perf_counter()
        problem.coding.recombine(couples, plan.recipe, keys)
        measured.append(time.perf_counter() - started)
    return 1e9 * min(measured) / (2 * couples.shape[1])


def _many(diagrams: int) -> str:
    """Return the outcome of one run on each of many diagrams, half of them mirrored and half scattered."""
    lines = [
        f"One run of the variable coding on each of {diagrams} random diagrams, seeds {_FIRST} and up (mirrored: even, "
        "scattered: odd); the optimum of each by dynamic programming.",
        "",
        "| recipe | within 2 % of the optimum | feasible | above it, mean | above it, worst | seconds, median |",
        "|---|---|---|---|---|---|",
    ]
    numbers = range(_FIRST, _FIRST + diagrams)
    optima = list(on_all_cores(_optimum_of, numbers))
    for settings in _SETTINGS:
        outcomes = list(on_all_cores(_try_on, [(number, settings) for number in numbers]))
        ratios = [
            each.fitness / optimum
            for each, optimum in zip(outcomes, optima, strict=True)
            if each.feasible and each.fitness is not None
        ]
        lines.append(
            f"| {settings} | {sum(ratio <= WITHIN for ratio in ratios)} of {diagrams} | {len(ratios)} "
            f"| {100 * (mean(ratios) - 1):.2f} % | {100 * (max(ratios) - 1):.2f} % "
            f"| {np.median([each.seconds for each in outcomes]):.2f} |"
        )
    return "\n".join(lines)


def _random(number: int) -> Coordination:
    layout = "scattered" if number % 2 else "mirrored"
    return Coordination.model_validate({"kind": "coordination", "random": {"seed": number, "layout": layout}})


def _optimum_of(number: int) -> float:
    return _random(number).oracle().fitness


def _try_on(task: tuple[int, str]) -> Outcome:
    number, settings = task
    return run(_random(number), seed=number, **_SETTINGS[settings])
