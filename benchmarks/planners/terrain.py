"""Measure terrain beside Dijkstra's algorithm.

Usage: python -m benchmarks.planners --only terrain
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import Any

import numpy as np

from benchmarks.planners.runs import on_all_cores, run, share
from benchmarks.terrain_worlds import terrain_world, with_obstacles_on
from genetics import Genomes
from node.plan import Plan
from node.simulation import simulate
from problems import RecipeName, Run
from problems.terrain import Terrain
from problems.terrain.replanning import led_on
from spy.past import best_known

FIRST, INSTANCES, QUICK = 1001, 100, 4
MARGINS = {16: 0.01, 256: 0.05}  # allowed distance from the optimum, by side of the map
SETTINGS: dict[RecipeName, dict[str, Any]] = {
    "tuned": {"topology": "torus 4x4", "stall": 50},
    "paper": {"topology": "torus 1x1", "deme": 40, "stall": 200},
}
REPLANNING_SIDE, MANY_TIMES = 256, 5.0


@dataclass(frozen=True)
class Result:
    """The outcome of one run: how far above the optimum it ended, its cost, and the oracle's seconds."""

    excess: float
    feasible: bool
    evaluations: int
    seconds: float
    oracle_seconds: float


@dataclass(frozen=True)
class Replanned:
    """The cost of coming within the margin of the new optimum: (evaluations, seconds), +inf if that failed."""

    live: tuple[float, float]
    scratch: tuple[float, float]
    oracle_seconds: float


def solve_one(side: int, recipe: RecipeName, number: int) -> Result:
    """Solve world ``number`` by a recipe."""
    problem = terrain_world(number, side)
    started = time.process_time()
    optimum = problem.oracle().fitness
    oracle_seconds = time.process_time() - started
    outcome = run(problem, recipe=recipe, seed=number, **SETTINGS[recipe])
    excess = np.inf if outcome.fitness is None else outcome.fitness / optimum - 1.0
    return Result(excess, outcome.feasible, outcome.evaluations, outcome.seconds, oracle_seconds)


def replan_one(side: int, number: int) -> Replanned | None:
    """Solve a changed world from the living population and from scratch; None if no way exists any more."""
    old = terrain_world(number, side).for_recipe("tuned", 1)
    run_settings = Run(recipe="tuned", seed=number, **SETTINGS["tuned"])
    reports = simulate(Plan(old, run_settings))
    best = best_known(reports, "champion")
    assert best is not None
    path = old.decode(np.frombuffer(best.genome, np.uint8))["path"]
    new = Terrain.model_validate(with_obstacles_on(old, path, np.random.default_rng([35, number])))
    started = time.process_time()
    optimum = new.oracle().fitness
    oracle_seconds = time.process_time() - started
    if not np.isfinite(optimum):
        return None
    target = optimum * (1.0 + MARGINS[side])
    plan = Plan(new, run_settings.model_copy(update={"target": target, "seed": number + 10_000}))
    started = time.process_time()
    demes = led_on(old, new, np.stack([np.frombuffer(each.deme, np.uint8) for each in reports])[:, None])
    led = time.process_time() - started
    (live, live_seconds), scratch = (_until_target(plan, demes), _until_target(plan, None))
    return Replanned((live, live_seconds + led), scratch, oracle_seconds)


def _until_target(plan: Plan, demes: Genomes | None) -> tuple[float, float]:
    """Return evaluations and CPU seconds until any cell reaches the target, without the stop that follows."""
    reached: list[tuple[float, float]] = []
    cells, each = plan.topology.cells, plan.evaluations_per_generation
    started = time.process_time()

    def look(generation: int, _: object, fitness: np.ndarray) -> None:
        if not reached and fitness.min() <= plan.target:
            reached.append((cells * (1 + generation * each), time.process_time() - started))

    simulate(plan, snapshot=look, demes=demes)
    return reached[0] if reached else (np.inf, np.inf)


# The section ----------------------------------------------------------------------------------------------------------
def section(quick: bool) -> str:
    """Measure; return the part of docs/results.md."""
    numbers = range(FIRST, FIRST + (QUICK if quick else INSTANCES))
    rows = [_row(side, recipe, numbers) for side in MARGINS for recipe in SETTINGS]
    replanned = list(on_all_cores(partial(replan_one, REPLANNING_SIDE), numbers))
    return "\n".join([_HEAD.format(first=numbers[0], last=numbers[-1]), *rows, "", _replanning(replanned)])


_HEAD = """\
## terrain

Fuzzy terrain (Fries), worlds {first} to {last} of `benchmarks/terrain_worlds.py`: by turns rooms with doors, clutter
and caves, half of the passable cells easy, moderate or difficult; in half of the worlds corners may be cut. The
world's number is the seed of its run. tuned: `--torus 4x4 --stall 50`; paper: `--recipe paper --torus 1x1
--deme 40 --stall 200`. The optimum is the oracle's, Dijkstra's algorithm by scipy. Times are of one core, medians.

`python -m benchmarks.planners --only terrain`

| cells | recipe | asked for | reached | feasible | excess, median | evaluations, median | time | the oracle's |
|---|---|---|---|---|---|---|---|---|"""


def _row(side: int, recipe: RecipeName, numbers: Sequence[int]) -> str:
    results = list(on_all_cores(partial(solve_one, side, recipe), numbers))
    margin = MARGINS[side]
    asked = f"within {margin:.0%} in {0.95 if side == 16 else 0.9:.0%}" if recipe == "tuned" else ""
    excess = median(each.excess for each in results)
    cells = [
        f"{side} × {side}",
        recipe,
        asked,
        f"within {margin:.0%}: {share(each.excess <= margin for each in results)}",
        share(each.feasible for each in results),
        f"{excess:.2%}" if excess < 1.0 else "no way found",
        f"{median(each.evaluations for each in results):,.0f}",
        f"{median(each.seconds for each in results):.2g} s",
        f"{median(each.oracle_seconds for each in results):.2g} s",
    ]
    return f"| {' | '.join(cells)} |"


def _replanning(replanned: list[Replanned | None]) -> str:
    found = [each for each in replanned if each is not None]
    evaluations = [_times(each.scratch[0], each.live[0]) for each in found]
    seconds = [_times(each.scratch[1], each.live[1]) for each in found]
    return (
        f"Replanning on {REPLANNING_SIDE} × {REPLANNING_SIDE} cells ({len(found)} worlds where a way is left): the"
        " robot has gone a tenth to a third of its path when one to three blocks appear on the rest of it. From the"
        " living population (`problems.terrain.replanning.led_on`, its time included) and from scratch, until within"
        f" {MARGINS[REPLANNING_SIDE]:.0%} of the new optimum; asked for: at least {MANY_TIMES:g} times faster.\n\n"
        "| | from the living population | from scratch | times faster, median | at least"
        f" {MANY_TIMES:g} times faster |\n|---|---|---|---|---|\n"
        f"| reached | {share(np.isfinite(each.live[0]) for each in found)} |"
        f" {share(np.isfinite(each.scratch[0]) for each in found)} | | |\n"
        f"| evaluations, median | {median(each.live[0] for each in found):,.0f} |"
        f" {median(each.scratch[0] for each in found):,.0f} | {median(evaluations):.1f} |"
        f" {share(each >= MANY_TIMES for each in evaluations)} |\n"
        f"| time, median | {median(each.live[1] for each in found):.3f} s |"
        f" {median(each.scratch[1] for each in found):.3f} s | {median(seconds):.1f} |"
        f" {share(each >= MANY_TIMES for each in seconds)} |\n\n"
        f"The oracle took {median(each.oracle_seconds for each in found):.2g} s on the changed worlds."
    )


def _times(scratch: float, live: float) -> float:
    """Return how many times faster the living population was; 0 if it never reached the margin."""
    return scratch / live if np.isfinite(live) else 0.0
