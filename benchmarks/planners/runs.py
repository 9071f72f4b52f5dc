"""Run many instances on all cores, in the simulator. The results are bit for bit those of processes on a torus."""

import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any, TypeVar

from node.plan import Plan
from node.replay import epochs_of
from node.simulation import simulate
from problems import Problem, ProblemFile, Run
from problems.problem import Solution
from spy.collector import Collector
from spy.judgement import Status
from spy.past import best_known, stopped_after
from spy.result import states_of, stop_reasons
from spy.verification import verify
from supernode.runs.simulation import Simulation

Task = TypeVar("Task")
Found = TypeVar("Found")


@dataclass(frozen=True)
class Outcome:
    """The outcome of one run.

    Attributes:
        status: how it ended.
        feasible: whether the planner's check accepts the solution.
        fitness: the best fitness; None if nothing feasible was found.
        generations: generations until the stop.
        evaluations: evaluations of all cells until the stop.
        found_after: evaluations of all cells until the birth of the best.
        seconds: duration on one core.
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
    """Simulate one run; ``settings`` are those of a ``[run]`` table. A problem without a file gets one attempt."""
    if isinstance(problem, ProblemFile):
        return _run_of(problem.with_run(**settings))
    chosen = Run(**{"restarts": 0} | settings)
    plan = Plan(problem.for_recipe(chosen.recipe, chosen.deme), chosen)
    started = time.perf_counter()
    reports = simulate(plan)
    seconds = time.perf_counter() - started
    collector = Collector(plan, job=1)
    collector.hear(best_known(reports, plan.run.spy), 0.0)
    generations = stopped_after(reports)
    judgement = verify(collector, generations, stop_reasons(reports, plan.run.mode), states=states_of(reports))
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


def _run_of(file: ProblemFile) -> Outcome:
    (epoch,) = epochs_of(file.with_run(oracle=False))  # without the oracle, so that the search alone is measured
    result = Simulation([epoch]).run()
    found = result.found_at
    epochs, cells = 0 if found is None else found.get("epoch", 0), epoch.plan.topology.cells
    return Outcome(
        result.status,
        result.feasible,
        None if found is None else result.fitness,
        result.solution if result.feasible else result.best_attempt,
        result.generations,
        result.evaluations,
        None if found is None else cells * _evaluations(epoch.plan, epochs, found["generation"], result.directives),
        result.seconds,
    )


def _evaluations(plan: Plan, epochs: int, generation: int, directives: Sequence[Mapping[str, Any]]) -> int:
    """Return the evaluations of one cell up to ``generation`` of the epoch that follows ``epochs`` others."""
    lived = generation + sum(directive["generation"] for directive in directives[:epochs])
    return (epochs + 1) * plan.run.deme + lived * plan.evaluations_per_generation


def on_all_cores(work: Callable[[Task], Found], tasks: Iterable[Task]) -> Iterator[Found]:
    """Yield the result of ``work`` for each task, in the order of the tasks, by one process for each core."""
    with ProcessPoolExecutor(len(os.sched_getaffinity(0)), mp_context=get_context("fork")) as pool:
        yield from pool.map(work, tasks)


def share(flags: Iterable[bool]) -> str:
    """Return how many flags are set, of how many, and in per cent."""
    listed = list(flags)
    return f"{sum(listed)} of {len(listed)} ({100 * sum(listed) / max(1, len(listed)):.1f} %)"
