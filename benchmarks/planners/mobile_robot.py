"""Measure how many random floors mobile-robot solves and how soon, beside OMPL's sampling planners in SE(2)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import compress
from typing import Any, NamedTuple

import numpy as np

import supernode
from benchmarks.planners import ompl_run, ompl_se2
from benchmarks.planners.runs import Outcome, on_all_cores, run, share
from benchmarks.robot_worlds import robot_world
from node.plan import Plan
from problems import Answer, ProblemFile

WORLDS = 200
NODES = 16
GUESSES = 1000
ENTRIES = (("tuned", "torus 4x4"), ("paper", "torus 4x4"), ("tuned", "torus 8x16"), ("paper", "torus 8x16"))


class Floor(NamedTuple):
    """The outcome of one floor.

    Attributes:
        file: the floor.
        outcomes: each entry's run.
        answer: the oracle's answer.
        rivals: what each rival found.
        hard: whether none of many random individuals solves the floor.
    """

    file: ProblemFile
    outcomes: list[Outcome]
    answer: Answer
    rivals: list[ompl_run.Way]
    hard: bool


class Timed(NamedTuple):
    """The times of a run on processes that were already up."""

    solved: bool
    run: float  # s, from the start to the last stop
    asked: float  # s, from submitting the job to its checked result


def section(quick: bool) -> str:
    """Run everything on all floors; return the part of docs/results.md."""
    numbers = range(1, (4 if quick else WORLDS) + 1)
    floors = list(on_all_cores(_on_floor, numbers))
    timed = _on_a_cluster([floor.file for floor in floors])
    return "\n".join([*_head(floors, timed), "", *_recipes(floors), "", *_rivals(floors, timed)])


def _on_floor(number: int) -> Floor:
    file = robot_world(number)
    outcomes = [run(file, seed=number, recipe=recipe, topology=topology) for recipe, topology in ENTRIES]
    problem: Any = file.problem()
    rivals = [ompl_se2.plan(problem, planner, number) for planner in ompl_run.PLANNERS]
    return Floor(file, outcomes, problem.oracle(), rivals, _is_hard(file))


def _is_hard(file: ProblemFile) -> bool:
    plan = Plan.of(file)
    guesses = plan.coding.random(plan.keys(np.arange(GUESSES), 0), 1)[:, 0]
    return bool(np.all(plan.evaluate(guesses) > 0.0))


def _on_a_cluster(files: Sequence[ProblemFile]) -> list[Timed]:
    """Run one job after the other on one cluster, which is up before the first submit."""
    with supernode.LocalCluster(topology="torus 4x4") as cluster:
        cluster.submit(files[0], generations=2).result()
        return [_timed(cluster, file, seed) for seed, file in enumerate(files, start=1)]


def _timed(cluster: supernode.LocalCluster, file: ProblemFile, seed: int) -> Timed:
    began = time.perf_counter()
    result = cluster.submit(file, seed=seed).result()
    return Timed(result.solved and result.feasible, result.seconds, time.perf_counter() - began)


def _solved(outcomes: Sequence[Outcome]) -> list[bool]:
    return [outcome.status == "solved" and outcome.feasible for outcome in outcomes]


def _head(floors: Sequence[Floor], timed: Sequence[Timed]) -> list[str]:
    tuned, paper, many, many_paper = (share(_solved(each)) for each in zip(*(f.outcomes for f in floors), strict=True))
    run_median, asked_median = (float(np.median([getattr(each, name) for each in timed])) for name in ("run", "asked"))
    sure = sum(floor.answer.meaning == "optimum" for floor in floors)
    return [
        "## mobile-robot",
        "",
        "`python -m benchmarks.planners --only mobile-robot` (needs `pip install -e .[ompl]`)",
        "",
        f"{len(floors)} random floors (`benchmarks/robot_worlds.py`, 1 to {len(floors)}, also the seeds): rooms with",
        "doors and clutter, half of the robots discs. The goal is not visible from the start. The oracle confirms that",
        f"{sure} have a way. *Hard* are the {sum(floor.hard for floor in floors)} that none of {GUESSES:,} random"
        " individuals solves.",
        "",
        "| asked | reached by tuned | paper |",
        "|---|---|---|",
        f"| ≥ 95 % solved on 4 × 4 | {tuned} | {paper} |",
        f"| and on 8 × 16, the paper's 128 processors | {many} | {many_paper} |",
        f"| median under 1 s on {NODES} nodes already up "
        f"| {run_median:.3f} s; {asked_median:.3f} s with handing in and check | |",
    ]


def _recipes(floors: Sequence[Floor]) -> list[str]:
    lines = [
        "| torus | recipe | solved | hard ones | evaluations until solved, median | 90 % | of hard ones, median |",
        "|---|---|---|---|---:|---:|---:|",
    ]
    hard = [floor.hard for floor in floors]
    for (recipe, topology), outcomes in zip(ENTRIES, zip(*(f.outcomes for f in floors), strict=True), strict=True):
        solved = _solved(outcomes)
        spent = [
            (each.found_after, of_hard) for each, good, of_hard in zip(outcomes, solved, hard, strict=True) if good
        ]
        all_spent, hard_spent = [each for each, _ in spent], [each for each, of_hard in spent if of_hard]
        lines.append(
            f"| {topology.removeprefix('torus ')} | {recipe} | {share(solved)} | {share(compress(solved, hard))} "
            f"| {_within(all_spent, 0.5)} | {_within(all_spent, 0.9)} | {_within(hard_spent, 0.5)} |"
        )
    return lines


def _within(values: Sequence[float], share_of_all: float, digits: int = 0) -> str:
    """Return the quantile of the values at ``share_of_all``; empty if there are none."""
    return f"{np.quantile(values, share_of_all):,.{digits}f}" if values else ""


def _rivals(floors: Sequence[Floor], timed: Sequence[Timed]) -> list[str]:
    limits = ompl_se2.LIMITS
    ours = [
        ompl_run.Way(each.run if each.solved else None, floor.outcomes[0].solution["length"] if each.solved else None)
        for each, floor in zip(timed, floors, strict=True)
    ]
    rows = {"mobile-robot, 4 × 4 processes": ours}
    rows |= {
        f"OMPL {planner}": [floor.rivals[place] for floor in floors] for place, planner in enumerate(ompl_run.PLANNERS)
    }
    return [
        f"Beside OMPL in SE(2), one run each on one core, {limits.finding:g} s at most; its collision test is shapely,",
        f"called from Python, as in `check`. BIT* goes on for {limits.improving:g} s. OMPL's ways are simplified,",
        "ours shortened by the tuned recipe. Lengths are over the oracle's lower bound.",
        "",
        "| planner | solved | hard ones | seconds until solved, median | 90 % | length / shortest, median | 90 % |",
        "|---|---|---|---:|---:|---:|---:|",
        *(_rival(name, ways, floors) for name, ways in rows.items()),
    ]


def _rival(name: str, ways: Sequence[ompl_run.Way], floors: Sequence[Floor]) -> str:
    seconds = [way.seconds for way in ways if way.seconds is not None]
    over = [
        way.length / floor.answer.figures["shortest_length_at_least"]
        for way, floor in zip(ways, floors, strict=True)
        if way.length is not None
    ]
    figures = (_within(each, q, digits) for each, digits in ((seconds, 3), (over, 2)) for q in (0.5, 0.9))
    solved = [way.seconds is not None for way in ways]
    hard = compress(solved, (floor.hard for floor in floors))
    return f"| {name} | {share(solved)} | {share(hard)} | " + " | ".join(figures) + " |"
