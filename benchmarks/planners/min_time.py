"""Measure min-time on the paper's 10 x 10 problem, beside both rivals and TOPP-RA."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, ClassVar

import numpy as np

from benchmarks.planners.runs import Outcome, on_all_cores, run, share
from genetics.arrays import Fitness, Genomes
from problems import ProblemFile, load
from problems.min_time import MinTime, checker, oracle

_EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
_RUNS = 50
_SETTINGS: dict[str, Any] = {"topology": "torus 4x4", "stall": 30}
_PAPER: dict[str, Any] = {"topology": "torus 1x1", "deme": 100, "recipe": "paper", "generations": 300}
_ANYWHERE = 1.0  # a radius that always contains a node of the other parent
_TREE = 4_000_000  # evaluations of the inverse dynamics that the tree search may use
_GRID_TARGET, _FREE_TARGET = 0.840, 0.806  # s


def section(quick: bool) -> str:
    """Return the part of docs/results.md."""
    file = load(_EXAMPLES / "min-time.toml")
    grid = _with(file, free=False)
    free = _with(file, free=True)
    coded = _with(file, profile="coded")
    problem = _problem(grid)
    program, tree = oracle.dynamic_program(problem), oracle.tree_search(problem, _TREE // (20 if quick else 1))
    tree_cost = tree.inverse_dynamics / tree.searched
    seeds = range(1, 1 + (4 if quick else _RUNS))
    of_grid, of_free = _runs(grid, seeds, _SETTINGS), _runs(free, seeds, _SETTINGS)
    quicker = _runs(grid, seeds, _SETTINGS | {"target": program.time})
    of_coded = _runs(coded, seeds, _SETTINGS)
    few = list(seeds)[: 2 if quick else 10]
    of_paper, of_far = _runs(_with(file), few, _PAPER), _runs(_with(file, radius=_ANYWHERE), few, _PAPER)
    costs = [each.weighed for each in quicker]
    best = min(each.time for each in of_grid)
    all_runs = [*of_grid, *of_free, *of_coded, *of_paper, *of_far]
    return "\n".join(
        [
            "## min-time",
            "",
            "The motion of the paper, (−0.5, −1.0) → (0.5, 1.0) rad on 10 × 10 (`examples/min-time.toml` without its",
            f"target), seeds 1 to {len(seeds)}, torus 4x4, stall {_SETTINGS['stall']}; `paper`: a deme of"
            f" {_PAPER['deme']}, {_PAPER['generations']} generations, seeds 1 to {len(of_paper)}.",
            "`python -m benchmarks.planners --only min-time`",
            "",
            "| figure | reached |",
            "|---|---|",
            f"| on the grid: within 1 % of the grid oracle ({program.time:.4f} s) in ≥ 90 % |"
            f" {share(_within(of_grid, 1.01 * program.time))} |",
            f"| below {_GRID_TARGET:.3f} s | {share(_within(of_grid, _GRID_TARGET))} |",
            f"| within 1 % of the best that any run found on the grid ({best:.4f} s) |"
            f" {share(_within(of_grid, 1.01 * best))} |",
            f"| free: ≤ {_FREE_TARGET:.3f} s in ≥ 90 % | {share(_within(of_free, _FREE_TARGET))} |",
            f"| ≥ 20 times fewer inverse-dynamics evaluations than the tree search ({tree_cost:,.0f}), until as quick"
            f" as the grid oracle | median {median(costs):,.0f}: {tree_cost / median(costs):.0f} times fewer |",
            "",
            "| method | time: median, worst, best / s | evaluations, median | inverse dynamics, median |",
            "|---|---|---|---|",
            _row("tuned, on the grid", of_grid),
            _row("tuned, until as quick as the oracle", quicker),
            _row("tuned, free", of_free),
            _row("tuned, levels coded", of_coded),
            _row("paper, levels coded", of_paper),
            _row("paper, levels coded, radius 1", of_far),
            f"| rival (i): tree search of neighbours, {100 * tree.searched:.1f} % of it searched | {tree.time:.4f} | |"
            f" {tree_cost:,.0f} (extrapolated) |",
            f"| rival (ii): dynamic program over neighbours | {program.time:.4f} | | {program.inverse_dynamics:,} |",
            "",
            f"All {len(all_runs)} solutions are accepted by `check`:"
            f" {share(each.outcome.feasible for each in all_runs)}; greatest torque between grid points"
            f" {max(_worst_torque(problem, each) for each in all_runs):.4f} of its limit.",
            "",
            "TOPP-RA on the best path found, with its discretisation at two sizes:",
            "",
            "| nodes | ours / s | TOPP-RA / s, 200 grid points | 2000 grid points |",
            "|---|---|---|---|",
            *(_beside_toppra(_problem(each), runs) for each, runs in ((grid, of_grid), (free, of_free))),
        ]
    )


def _with(file: ProblemFile, **fields: Any) -> ProblemFile:
    run_settings = file.run.model_copy(update={"target": None})
    return replace(file, fields=file.fields | fields, run=type(file.run)(**run_settings.model_dump(exclude_none=True)))


def _problem(file: ProblemFile) -> MinTime:
    problem = file.problem()
    assert isinstance(problem, MinTime)
    return problem


class _Counted(MinTime):
    """The same planner with an evaluation in Python, so that it can be counted."""

    weighed: ClassVar[int] = 0

    def evaluate(self, genomes: Genomes) -> Fitness:
        _Counted.weighed += self.inverse_dynamics(genomes)
        return super().evaluate(genomes)


@dataclass(frozen=True)
class _Counts:
    """The outcome of a run, and its evaluations of the inverse dynamics."""

    outcome: Outcome
    weighed: int

    @property
    def time(self) -> float:
        fitness = self.outcome.fitness
        return np.inf if fitness is None else fitness


def _run(file: ProblemFile, settings: dict[str, Any], seed: int) -> _Counts:
    _Counted.weighed = 0
    outcome = run(_Counted.model_validate(file.fields), seed=seed, **settings)
    return _Counts(outcome, _Counted.weighed)


def _runs(file: ProblemFile, seeds: Any, settings: dict[str, Any]) -> list[_Counts]:
    return list(on_all_cores(partial(_run, file, settings), seeds))


def _within(runs: list[_Counts], limit: float) -> Iterator[bool]:
    return (each.outcome.feasible and each.time <= limit for each in runs)


def _row(name: str, runs: list[_Counts]) -> str:
    times = sorted(each.time for each in runs)
    evaluations = median(each.outcome.evaluations for each in runs)
    weighed = median(each.weighed for each in runs)
    return f"| {name} | {median(times):.4f}, {times[-1]:.4f}, {times[0]:.4f} | {evaluations:,.0f} | {weighed:,.0f} |"


def _worst_torque(problem: MinTime, each: _Counts) -> float:
    if each.outcome.solution is None:
        return np.inf
    return float(checker.greatest_shares(problem, each.outcome.solution)["torque"].max())


def _beside_toppra(problem: MinTime, runs: list[_Counts]) -> str:
    best = min(runs, key=lambda each: each.time)
    nodes = np.array(best.outcome.solution["nodes"]) if best.outcome.solution else np.empty((0, 2))
    times = [toppra_time(problem, nodes, points) for points in (200, 2000)]
    name = "free" if problem.free else "on the grid"
    return f"| {name} | {best.time:.4f} | {times[0]:.4f} | {times[1]:.4f} |"


def toppra_time(problem: MinTime, nodes: Any, points: int) -> float:
    """Return the time of TOPP-RA (PyPI toppra) along the curve through some nodes, within all limits except jerk, s."""
    import toppra
    from scipy.interpolate import BSpline
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    controls = np.concatenate([[2 * nodes[0] - nodes[1]], nodes, [2 * nodes[-1] - nodes[-2]]])
    stretches = len(nodes) - 1
    spline = BSpline(np.arange(-3, stretches + 4), controls, 3)

    class Curve(toppra.interpolator.AbstractGeometricPath):
        dof = nodes.shape[1]
        path_interval = np.array([0.0, stretches])

        def __call__(self, places: Any, order: int = 0) -> Any:
            return spline(places, order)

    def torque(q: Any, qd: Any, qdd: Any) -> Any:
        return checker.torques(problem.arm, q[None], qd[None], qdd[None])[0]

    def both_ways(name: str) -> Any:
        return np.column_stack([-problem.arm.limit_of(name), problem.arm.limit_of(name)])

    scheme = constraint.DiscretizationType.Interpolation
    limits = [
        constraint.JointTorqueConstraint(torque, both_ways("torque"), np.zeros(Curve.dof), discretization_scheme=scheme)
    ]
    if problem.arm.velocity is not None:
        limits.append(constraint.JointVelocityConstraint(both_ways("velocity")))
    if problem.arm.acceleration is not None:
        limits.append(constraint.JointAccelerationConstraint(both_ways("acceleration"), discretization_scheme=scheme))
    solver = algorithm.TOPPRA(limits, Curve(), gridpoints=np.linspace(0, stretches, points + 1))
    _, speed, _ = solver.compute_parameterization(0, 0)
    return float(np.sum(2 * stretches / points / (speed[1:] + speed[:-1]))) if speed is not None else np.inf
