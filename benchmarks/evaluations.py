"""Measure evaluations a second on one core, for every kind of problem, its examples and its template.

Usage: python -m benchmarks.evaluations [--seconds 1]

The compiled fitness evaluates random individuals, drawn as for the first deme of a cell: 8 at a time, which is a
generation of a cell of one individual, and 1024 at a time. The best of three measurements counts, so that other load on
the machine has little influence. Individuals of later generations are better and may take longer or shorter.
"""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import problems
from genetics.arrays import Evaluate, Genomes
from node.plan import Plan
from problems import ProblemFile, registry
from problems.file import parse

_EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
_TOGETHER = (8, 1024)
_REPEATS = 3


def main() -> None:
    """Print a table with one line for each file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=1.0, help="of each measurement, or a little more")
    options = parser.parse_args()
    print("| kind | file | " + " | ".join(f"evaluations/s, {size} at a time" for size in _TOGETHER) + " |")
    print("|---|---|" + "---:|" * len(_TOGETHER))
    for file in files():
        plan = Plan.of(file)
        rates = (f"{rate(plan, size, options.seconds):,.0f}" for size in _TOGETHER)
        print(f"| {file.kind} | {file.name} | " + " | ".join(rates) + " |", flush=True)


def files() -> Iterator[ProblemFile]:
    """Yield the template and the examples of every built-in kind, kind by kind."""
    loaded = [problems.load(path) for path in sorted(_EXAMPLES.glob("*.toml"))]
    for kind in registry.kinds():
        yield parse(registry.find(kind).template, "template", Path())
        for file in loaded:
            if file.kind == kind:
                yield ProblemFile(Path(file.name).name, file.fields, file.run, file.folder)


def rate(plan: Plan, size: int, seconds: float) -> float:
    """Return evaluations a second for batches of ``size`` individuals."""
    genomes = plan.coding.random(plan.keys(np.arange(max(_TOGETHER)), 0), 1)[:, 0]
    evaluate = plan.evaluate if plan.problem.fitness_kernel is None else plan.problem.fitness_kernel.fitness
    batches = [np.ascontiguousarray(genomes[start : start + size]) for start in range(0, len(genomes), size)]
    judge_all(evaluate, batches)  # warm-up: fills what evaluations cache
    return max(_rate(evaluate, batches, seconds / _REPEATS) for _ in range(_REPEATS))


def judge_all(evaluate: Evaluate, batches: list[Genomes]) -> None:
    """Evaluate each batch once."""
    for batch in batches:
        evaluate(batch)


def _rate(evaluate: Evaluate, batches: list[Genomes], seconds: float) -> float:
    began, count = time.perf_counter(), 0
    while (spent := time.perf_counter() - began) < seconds:
        judge_all(evaluate, batches)
        count += sum(map(len, batches))
    return count / spent


if __name__ == "__main__":
    main()
