"""Measure the generations and evaluations that tori of growing size need to solve a problem, and the speed-up.

Usage: python -m benchmarks.speedup [--seeds 100] [--nodes 16,64,128,256,1024] [--deme 1] [--sequential 16,64,256]

Lockstep runs are the same, bit for bit, simulated or on processes, so the simulator makes them here. The program prints
two kinds of speed-up:

- *strong speed-up, in evaluations* (Alba 2002, "Parallel evolutionary algorithms can achieve super-linear performance",
  Information Processing Letters 82:7-13): the median evaluations of the best sequential algorithm (one deme on 1x1, the
  deme of ``--sequential`` that needs fewest), over the median evaluations of one of the n nodes. It is super-linear
  where the efficiency, speed-up / n, is above 1. Its interval holds for all sizes of a table at once, and allows for
  the choice of the best sequential algorithm by the same runs: see `coordinator.experiments.comparison`.
- *relative, in generations*: the median generations of the smallest torus over those of n nodes, beside n over the
  smallest size. The population grows with the nodes, so this is no strong speed-up.

A null model is printed for comparison: n independent runs of the best sequential algorithm, of which the first to end
counts. Both sides have the same recipe. But a node with one individual has no mates on it, so its rules of selection
differ (``--deme 4`` compares islands with islands).

Generations are counted to the answer's birth; evaluations are those of all cells up to then. The last column of strong
speed-ups counts them up to the agreed stop, diameter + 1 generations later, on 1x1 too. A run without an answer
after ``--evaluations`` of all cells counts as more expensive than any other.
"""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import problems
from coordinator.experiments.comparison import Comparison, compare, first_of, merit, with_restarts
from coordinator.experiments.statistics import median
from node.plan import Plan
from node.simulation import simulate
from problems import ProblemFile
from problems.file import parse
from spy.past import best_known
from topologies import torus_of

_PARTITION = 'kind = "function"\nname = "graph-partition"\n[graph]\nvertices = 64\nparts = 2\n'


class Solved(NamedTuple):
    """The cost of one run; infinite if it found nothing."""

    generations: float
    evaluations: float
    stopped: float  # evaluations up to the agreed stop


def main() -> None:
    """Print one table for each problem."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=100, help="runs of each size")
    parser.add_argument("--nodes", type=_numbers, default=(16, 64, 128, 256, 1024), help="sizes")
    parser.add_argument("--deme", type=int, default=1, help="individuals on a node")
    parser.add_argument("--sequential", type=_numbers, default=(16, 64, 256), help="demes of the sequential algorithm")
    parser.add_argument("--evaluations", type=int, default=300_000, help="of all cells, at most")
    options = parser.parse_args()
    office = problems.load(Path(__file__).resolve().parent.parent / "examples" / "mobile-robot.toml")
    for name, file in (("mobile-robot.toml", office), ("graph-partition", parse(_PARTITION, "partition", Path()))):
        print(f"\n{name}, {options.seeds} seeds\n")
        for line in table(file.with_run(evaluations=options.evaluations, restarts=0), options):
            print(line, flush=True)


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(int(each) for each in text.split(","))


def table(file: ProblemFile, options: argparse.Namespace) -> list[str]:
    """Return the lines of a table: the sequential algorithm, then one line for each size."""
    alone = {deme: _runs(file, "torus 1x1", deme, options.seeds) for deme in options.sequential}
    deme, reference = min(alone.items(), key=lambda each: merit(_evaluations(each[1])))
    sequential = _evaluations(reference)
    lines = [
        f"Sequential: a deme of {deme}, solved {_share(reference)}, median {_median(sequential):,.0f} evaluations.",
        "",
        f"{_restarted(sequential)}",
        "",
        "| nodes | solved | generations | evaluations of all | of a node | strong speed-up | efficiency, 95 % "
        "| super-linear | n independent runs | strong speed-up to the stop "
        "| fewer generations than the smallest, times | nodes, times |",
        "|---:|---:|---:|---:|---:|---:|---:|---|---:|---:|---:|---:|",
    ]
    first = None
    runs = {nodes: _runs(file, torus_of(nodes), options.deme, options.seeds) for nodes in options.nodes}
    judged = compare([_evaluations(each) for each in alone.values()], [_evaluations(each) for each in runs.values()])
    for (nodes, found), comparison in zip(runs.items(), judged, strict=True):
        generations, evaluations = _median([each.generations for each in found]), _evaluations(found)
        first = first or (nodes, generations)
        speed_up = _median(sequential) / _median(evaluations) * nodes
        independent = _median(sequential) / first_of(sequential, nodes)
        to_the_stop = _median(_stopped(reference)) / _median(_stopped(found)) * nodes
        lines.append(
            f"| {nodes} | {_share(found)} | {generations:,.0f} | {_median(evaluations):,.0f} "
            f"| {_median(evaluations) / nodes:,.0f} | {speed_up:,.1f} | {_efficiency(comparison)} "
            f"| {_verdict(comparison)} | {independent:,.1f} | {to_the_stop:,.1f} "
            f"| {first[1] / generations:.1f} | {nodes / first[0]:g} |"
        )
    return lines


def _runs(file: ProblemFile, topology: str, deme: int, seeds: int) -> list[Solved]:
    return [_run(Plan.of(file.with_run(topology=topology, deme=deme, seed=seed))) for seed in range(1, seeds + 1)]


def _run(plan: Plan) -> Solved:
    reports = simulate(plan)
    champion = best_known(reports, plan.run.spy)
    if champion is None or plan.target is None or champion.fitness > plan.target:
        return Solved(math.inf, math.inf, math.inf)
    each = plan.run.deme + champion.generation * plan.evaluations_per_generation
    stopped = sum(report.evaluations for report in reports)
    return Solved(champion.generation, each * plan.topology.cells, stopped)


def _evaluations(runs: Sequence[Solved]) -> list[float]:
    return [run.evaluations for run in runs]


def _stopped(runs: Sequence[Solved]) -> list[float]:
    return [run.stopped for run in runs]


def _share(runs: Sequence[Solved]) -> str:
    return f"{sum(run.generations < math.inf for run in runs)} of {len(runs)}"


def _median(values: Sequence[float]) -> float:
    estimate = median(values)
    assert estimate is not None, "there are runs"
    return estimate.value


def _efficiency(found: Comparison) -> str:
    """Return the efficiency with its interval; empty if there is none."""
    its = found.efficiency
    if its is None:
        return ""
    return f"{its.value:.2f}" if its.low is None else f"{its.value:.2f} ({its.low:.2f} to {its.high:.2f})"


def _verdict(found: Comparison) -> str:
    return found.verdict if found.seeds is None else f"{found.verdict}; {found.seeds:,} seeds might decide"


def _restarted(sequential: Sequence[float]) -> str:
    """Return a sentence about the cost of the sequential algorithm with restarts at the best cutoff."""
    mean, cutoff = with_restarts(sequential)
    solved = [cost for cost in sequential if math.isfinite(cost)]
    return (
        f"With a restart after {cutoff:,.0f} evaluations, the best cutoff, it needs {mean:,.0f} on average; without, "
        f"{sum(solved) / max(1, len(solved)):,.0f}."
    )


if __name__ == "__main__":
    main()
