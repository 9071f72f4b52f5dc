"""Measure sphere-path on random feasible worlds of 3 to 7 dimensions, beside OMPL on the same worlds."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.planners.runs import on_all_cores, run, share
from benchmarks.sphere_worlds import CLEARANCE, CORRIDOR, CROWDS, NODES, sphere_world
from genetics import Keys
from problems.sphere_path import SpherePath
from problems.sphere_path.checker import crossed_by
from problems.sphere_path.space import length_of

Floats = NDArray[np.float64]

WORLDS = 100
QUICK = 5  # one of each dimension
AXES = (3, 4, 5, 6, 7)
RANDOM_PATHS = 10_000
PATIENCE = 5.0  # s of processor time, for each of OMPL's planners


class Case(NamedTuple):
    """A way to solve a world: a name for the table, and the settings of the run or the planner of OMPL."""

    name: str
    settings: dict[str, object]
    planner: str = ""


OURS = (
    Case("**tuned, 8×8**", {"topology": "torus 8x8"}),
    Case("tuned, 4×4", {"topology": "torus 4x4"}),
    Case("tuned, 1×1, deme 100", {"topology": "torus 1x1", "deme": 100}),
    Case("paper, 1×1, deme 100", {"topology": "torus 1x1", "deme": 100, "recipe": "paper"}),
    Case("paper, 8×8", {"topology": "torus 8x8", "recipe": "paper"}),
)
RIVALS = (Case("OMPL RRTConnect", {}, "RRTConnect"), Case("OMPL BIT*", {}, "BITstar"))


class Tried(NamedTuple):
    """The outcome of a world."""

    axes: int
    solved: bool
    seconds: float
    evaluations: int
    length: float


def section(quick: bool) -> str:
    """Return the part of docs/results.md."""
    numbers = range(1, 1 + (QUICK if quick else WORLDS))
    cases = [*OURS, *(RIVALS if _has_ompl() else ())]
    tried = {case.name: list(on_all_cores(_try, [(case, number) for number in numbers])) for case in cases}
    return "\n".join([*_head(len(numbers)), *_hardness(numbers), "", *_table(tried), "", *_foot(tried)])


def _head(count: int) -> Iterator[str]:
    crowds = ", ".join(
        f"{axes} axes: {crowd[0]:,} of {crowd[1][0]:g} to {crowd[1][1]:g}" for axes, crowd in CROWDS.items()
    )
    yield "## sphere-path\n"
    yield "`python -m benchmarks.planners --only sphere-path`; OMPL needs the extra `ompl`.\n"
    yield (
        f"{count} worlds (`benchmarks/sphere_worlds.py`, numbers 1 to {count}), as many of each dimension: boxes"
        f" of side 10 full of random spheres ({crowds}), which leave a hidden corridor of {CORRIDOR} places free by"
        f" {CLEARANCE:g}: so all are feasible. Paths have {NODES} nodes of 8 bits. Seed 1, stall 200."
    )


def _hardness(numbers: Iterable[int]) -> Iterator[str]:
    found = list(on_all_cores(_hard, numbers))
    random = sum(free for _, free in found)
    yield (
        f"\nA straight line is free in {share(straight for straight, _ in found)}, of {RANDOM_PATHS:,} random paths in"
        f" each world {random} of {RANDOM_PATHS * len(found):,}."
    )


def _hard(number: int) -> tuple[bool, int]:
    """Return whether the straight way is free, and how many random paths are free."""
    problem = sphere_world(number).problem()
    genomes = problem.coding.random(Keys(np.arange(1), np.uint64(1), 0), RANDOM_PATHS)[0]
    return crossed_by(problem, problem.straight) == 0, int(np.count_nonzero(problem.evaluate(genomes) == 0.0))


def _try(task: tuple[Case, int]) -> Tried:
    case, number = task
    file = sphere_world(number)
    if case.planner:
        return _by_ompl(file.problem(), case.planner)
    began = time.process_time()
    outcome = run(file, seed=1, stall=200, **case.settings)
    seconds = time.process_time() - began
    solved = outcome.status == "solved" and outcome.feasible
    length = outcome.solution["length"] if outcome.solution else np.inf
    return Tried(len(file.fields["start"]), solved, seconds, outcome.evaluations, length)


# OMPL -----------------------------------------------------------------------------------------------------------------
def _has_ompl() -> bool:
    try:
        import ompl  # noqa: F401
    except ImportError:
        return False
    return True


def _by_ompl(problem: SpherePath, planner: str) -> Tried:
    """Run OMPL until its first solution. States and motions are tested exactly, against all spheres at once."""
    from ompl import base

    setup, axes = _setup(problem, planner), len(problem.start)
    began = time.process_time()
    setup.solve(base.PlannerTerminationCondition(lambda: time.process_time() - began > PATIENCE))
    seconds = time.process_time() - began
    if not setup.haveExactSolutionPath():
        return Tried(axes, False, seconds, 0, np.inf)
    path = np.array([_place(state, axes) for state in setup.getSolutionPath().getStates()])
    return Tried(axes, crossed_by(problem, path) == 0, seconds, 0, length_of(path))


def _setup(problem: SpherePath, planner: str) -> Any:
    from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_ERROR)
    axes = len(problem.start)
    space, bounds = base.RealVectorStateSpace(axes), base.RealVectorBounds(axes)
    for axis, (low, high) in enumerate(problem.bounds):
        bounds.setLow(axis, low)
        bounds.setHigh(axis, high)
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()

    class Exact(base.MotionValidator):  # type: ignore[misc]
        def checkMotion(self, begin: Any, end: Any, *_: Any) -> bool:  # noqa: N802
            return _is_free(problem.obstacle_spheres, _place(begin, axes), _place(end, axes))

    exact = Exact(information)
    setup.setStateValidityChecker(lambda state: exact.checkMotion(state, state))
    information.setMotionValidator(exact)
    start, goal = space.allocState(), space.allocState()
    for axis in range(axes):
        start[axis], goal[axis] = problem.start[axis], problem.goal[axis]
    setup.setStartAndGoalStates(start, goal)
    objective = base.PathLengthOptimizationObjective(information)
    objective.setCostThreshold(objective.infiniteCost())  # the first solution is good enough
    setup.setOptimizationObjective(objective)
    setup.setPlanner(getattr(geometric, planner)(information))
    return setup


def _place(state: Any, axes: int) -> Floats:
    return np.array([state[axis] for axis in range(axes)])


def _is_free(spheres: Floats, begin: Floats, end: Floats) -> bool:
    """Return whether a segment enters no sphere."""
    offsets, along = spheres[:, :-1] - begin, end - begin
    squared = along @ along
    shares = np.clip(offsets @ along / squared, 0.0, 1.0) if squared > 0.0 else np.zeros(len(spheres))
    away = offsets - shares[:, None] * along
    return bool(np.all(np.einsum("ij,ij->i", away, away) >= spheres[:, -1] ** 2))


# The table ------------------------------------------------------------------------------------------------------------
def _table(tried: dict[str, list[Tried]]) -> Iterator[str]:
    by_axes = " | ".join(f"{axes} axes" for axes in AXES)
    yield f"| planner | solved | {by_axes} | evaluations | CPU s, median, greatest | length |"
    yield "|---" * (len(AXES) + 5) + "|"
    both = [all(each.solved for each in world) for world in zip(*tried.values(), strict=True)]
    for name, worlds in tried.items():
        solved = [sum(each.solved for each in worlds if each.axes == axes) for axes in AXES]
        seconds = [each.seconds for each in worlds]
        evaluations = [each.evaluations for each in worlds if each.evaluations]
        lengths = [each.length for each, counts in zip(worlds, both, strict=True) if counts]
        yield (
            f"| {name} | {share(each.solved for each in worlds)} | {' | '.join(map(str, solved))} | "
            f"{f'{statistics.median(evaluations):,.0f}' if evaluations else ''} | "
            f"{statistics.median(seconds):.2f}, {max(seconds):.1f} | "
            f"{f'{statistics.mean(lengths):.1f}' if lengths else ''} |"
        )


def _foot(tried: dict[str, list[Tried]]) -> Iterator[str]:
    best = tried[OURS[0].name]
    solved = sum(each.solved for each in best) / len(best)
    reached = "reached" if solved >= 0.95 else "not reached"
    yield f"To reach: ≥ 95 % of feasible worlds. Tuned, 8×8: {100 * solved:.1f} %, {reached}."
    yield (
        f"\nEvaluations are medians; lengths are means over the worlds that all solved. OMPL stops at its first"
        f" solution or after {PATIENCE:g} s; it tests states and motions exactly, all spheres at once, in numpy from"
        " Python, which costs it most of its time. All stop at their first solution."
    )
