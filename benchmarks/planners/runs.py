"""Runs of many instances on all cores, in the simulator: bit for bit what processes on a torus would find."""

import os
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any, TypeVar

from node import Plan, simulate
from problems import Problem, ProblemFile, Run
from problems.problem import Solution
from spy.collector import Collector
from spy.judge import Status, judge
from spy.past import best_known, stopped_after
from spy.result import states_of, stop_reasons

Task = TypeVar("Task")
Found = TypeVar("Found")


@dataclass(frozen=True)
class Outcome:
    """What one run came to.

    Attributes:
        status: how it ended.
        feasible: whether the planner's check accepts the solution.
        fitness: of the best; None if nothing feasible was found.
        generations: until the stop.
        evaluations: of all cells, until the stop.
        found_after: of all cells, until the best was born.
        seconds: on one core.
    """

    status: Status
    feasible: bool
    fitness: float | None
    solution: Solution | None
    generations: int
    evaluations: int
    found_after: int | None
    seconds: float


def run(problem: Problem | ProblemFile, **settings: Any) -> Outcome:
    """Simulate one run; ``settings`` are those of a ``[run]`` table."""
    if isinstance(problem, ProblemFile):
        plan = Plan.of(problem.with_run(**settings))
    else:
        chosen = Run(**settings)
        plan = Plan(problem.for_recipe(chosen.recipe, chosen.deme), chosen)
    started = time.perf_counter()
    reports = simulate(plan)
    seconds = time.perf_counter() - started
    collector = Collector(plan, job=1)
    collector.hear(best_known(reports, plan.run.spy), 0.0)
    generations = stopped_after(reports)
    judgement = judge(collector, generations, stop_reasons(reports, plan.run.mode), states=states_of(reports))
    best = judgement.best
    first, each = plan.run.deme, plan.evaluations_per_generation
    return Outcome(
        judgement.status,
        judgement.feasible,
        None if best is None else best.fitness,
        None if best is None else best.solution,
        generations,
        sum(report.evaluations for report in reports),
        None if best is None else plan.topology.cells * (first + best.generation * each),
        seconds,
    )


def on_all_cores(work: Callable[[Task], Found], tasks: Iterable[Task]) -> Iterator[Found]:
    """``work`` done for each task, in the order of the tasks, by a process for each core."""
    with ProcessPoolExecutor(len(os.sched_getaffinity(0)), mp_context=get_context("fork")) as pool:
        yield from pool.map(work, tasks)


def share(flags: Iterable[bool]) -> str:
    """How many of how many, and in per cent."""
    listed = list(flags)
    return f"{sum(listed)} of {len(listed)} ({100 * sum(listed) / max(1, len(listed)):.1f} %)"
