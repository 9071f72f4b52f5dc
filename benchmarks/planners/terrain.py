"""How good terrain is, beside Dijkstra's algorithm.

Usage: python -m benchmarks.planners --only terrain
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from statistics import median

import numpy as np

from benchmarks.planners.runs import on_all_cores, run, share
from benchmarks.terrain_worlds import terrain_world, with_obstacles_on
from node import Plan, simulate
from problems import RecipeName, Run
from problems.terrain import Terrain
from problems.terrain.replanning import led_on
from spy.result import best_known

INSTANCES = 100
SIDES = {16: 0.01, 256: 0.05}  # the margin that counts as reached
REPLANNING_SIDE = 256
SETTINGS = {"tuned": {"topology": "torus 4x4", "stall": 50}, "paper": {"topology": "torus 1x1", "deme": 40}}
REPLANNING = Run(topology="torus 4x4", stall=50)


@dataclass(frozen=True)
class Result:
    """One run: how far above the optimum it ended, and what it took; the oracle's seconds beside it."""

    excess: float
    feasible: bool
    evaluations: int
    seconds: float
    oracle_seconds: float


@dataclass(frozen=True)
class Replanned:
    """What it took to come within the margin of the new optimum: (evaluations, seconds), +inf if it never did."""

    live: tuple[float, float]
    scratch: tuple[float, float]
    oracle_seconds: float


def solve_one(side: int, recipe: RecipeName, number: int) -> Result:
    """World ``number`` by a recipe."""
    problem = terrain_world(number, side)
    started = time.process_time()
    optimum = problem.oracle().fitness
    oracle_seconds = time.process_time() - started
    outcome = run(problem, recipe=recipe, seed=number, **SETTINGS[recipe])
    excess = np.inf if outcome.fitness is None else outcome.fitness / optimum - 1.0
    return Result(excess, outcome.feasible, outcome.evaluations, outcome.seconds, oracle_seconds)


def replan_one(side: int, number: int) -> Replanned | None:
    """The same changed world from the living population and from scratch; None if there is no way any more."""
    old = terrain_world(number, side).for_recipe("tuned", 1)
    run_settings = REPLANNING.model_copy(update={"seed": number})
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
    target = optimum * (1.0 + SIDES[side])
    plan = Plan(new, run_settings.model_copy(update={"target": target, "seed": number + 10_000}))
    started = time.process_time()
    demes = led_on(old, new, np.stack([np.frombuffer(each.deme, np.uint8) for each in reports])[:, None])
    led = time.process_time() - started
    (live, live_seconds), scratch = (_until_target(plan, demes), _until_target(plan, None))
    return Replanned((live, live_seconds + led), scratch, oracle_seconds)


def _until_target(plan: Plan, demes: object) -> tuple[float, float]:
    """Evaluations and seconds until the target is reached anywhere; the stop that follows is not counted."""
    reached: list[tuple[float, float]] = []
    cells, each = plan.topology.cells, plan.evaluations_per_generation
    started = time.process_time()

    def look(generation: int, _: object, fitness: np.ndarray) -> None:
        if not reached and fitness.min() <= plan.target:
            reached.append((cells * (1 + generation * each), time.process_time() - started))

    simulate(plan, snapshot=look, demes=demes)
    return reached[0] if reached else (np.inf, np.inf)
