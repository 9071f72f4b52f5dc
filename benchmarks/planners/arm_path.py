"""Measure how many Manhattan motions are found in random worlds, and the share of configuration space evaluated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.arm_path_worlds import FEWEST_MOVES, ROUNDS, arm_path_world, many_links_world, unsolvable_world
from benchmarks.planners import ompl_joints, ompl_run
from benchmarks.planners.runs import Outcome, on_all_cores, run, share
from problems import Answer

WORLDS = 120
UNSOLVABLE = 20
MANY_LINKS = 40
TOPOLOGY = "torus 4x4"
RECIPES = ("tuned", "paper")


class World(NamedTuple):
    """The outcome of a two-joint world: each recipe's run, and the oracle's answer."""

    outcomes: list[Outcome]
    answer: Answer


class Reach(NamedTuple):
    """The outcome of a world of more joints: links, this planner's run, and the ways, its own before the rivals'."""

    links: int
    outcome: Outcome
    ways: list[ompl_run.Way]


def section(quick: bool) -> str:
    """Run everything in all worlds; return the part of docs/results.md."""
    worlds, hopeless, many = (range(1, 1 + (4 if quick else each)) for each in (WORLDS, UNSOLVABLE, MANY_LINKS))
    return "\n".join(
        [
            *_flat(list(on_all_cores(_in_world, worlds)), list(on_all_cores(_in_unsolvable_world, hopeless))),
            "",
            *_rivals(list(on_all_cores(_with_many_links, many))),
        ]
    )


def _in_world(number: int) -> World:
    file = arm_path_world(number)
    outcomes = [run(file, seed=number, recipe=recipe, topology=TOPOLOGY) for recipe in RECIPES]
    return World(outcomes, file.problem().oracle())


def _in_unsolvable_world(number: int) -> Outcome:
    return run(unsolvable_world(number), seed=number, topology=TOPOLOGY)


def _with_many_links(number: int) -> Reach:
    problem = many_links_world(number)
    outcome = run(problem, seed=number, topology=TOPOLOGY)
    length = None
    if _is_solved(outcome) and outcome.solution is not None:
        length = float(np.abs(np.diff(outcome.solution["path"], axis=0)).sum())
    ours = ompl_run.Way(outcome.seconds if _is_solved(outcome) else None, length)
    ways = [ours, *(ompl_joints.plan(problem, planner, number) for planner in ompl_run.PLANNERS)]
    return Reach(len(problem.arm.links), outcome, ways)


def _is_solved(outcome: Outcome) -> bool:
    return outcome.status == "solved" and outcome.feasible


def _evaluated(outcomes: Sequence[Outcome]) -> list[float]:
    return [each.solution["cspace_evaluated"] for each in outcomes if each.solution is not None]


def _flat(worlds: Sequence[World], hopeless: Sequence[Outcome]) -> list[str]:
    by_recipe = [[world.outcomes[place] for world in worlds] for place in range(len(RECIPES))]
    solved = [share(map(_is_solved, outcomes)) for outcomes in by_recipe]
    medians = [f"{np.median(_evaluated(outcomes)):.3f}" for outcomes in by_recipe]
    stalled = share(each.status == "stalled" and not each.feasible for each in hopeless)
    return [
        "## arm-path",
        "",
        "`python -m benchmarks.planners --only arm-path` (needs `pip install -e .[ompl]`)",
        "",
        f"{len(worlds)} random worlds of two links (`benchmarks/arm_path_worlds.py`, 1 to {len(worlds)}, also the",
        f"seeds), surely solvable, but by the oracle not in fewer than {FEWEST_MOVES} moves; `rounds = {ROUNDS}`,",
        f"8 bits, 4 × 4 nodes, stall 200. {len(hopeless)} more are surely unsolvable.",
        "",
        "| asked | reached by tuned | paper |",
        "|---|---|---|",
        f"| ≥ 95 % solved | {solved[0]} | {solved[1]} |",
        f"| median `cspace_evaluated` ≤ 1/10 | {medians[0]} | {medians[1]} |",
        f"| unsolvable ones end as `stalled` | {stalled} | |",
        "",
        *_by_moves(worlds),
    ]


def _by_moves(worlds: Sequence[World]) -> list[str]:
    lines = [
        "| fewest moves | worlds | solved, tuned | paper | `cspace_evaluated`, tuned, median | evaluations, median |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for least, most in ((4, 4), (5, 5), (6, 7), (8, 99)):
        some = [world for world in worlds if least <= world.answer.figures["fewest_moves_at_most"] <= most]
        if not some:
            continue
        tuned, paper = ([world.outcomes[place] for world in some] for place in (0, 1))
        found = [each.found_after for each in tuned if _is_solved(each) and each.found_after is not None]
        name = str(least) if least == most else f"{least} to {most}" if most < 99 else f"{least} and more"
        lines.append(
            f"| {name} | {len(some)} | {sum(map(_is_solved, tuned))} | {sum(map(_is_solved, paper))} "
            f"| {np.median(_evaluated(tuned)):.3f} | {np.median(found) if found else np.nan:,.0f} |"
        )
    return lines


def _rivals(reaches: Sequence[Reach]) -> list[str]:
    names = ["arm-path, tuned", *(f"OMPL {planner}" for planner in ompl_run.PLANNERS)]
    limits = ompl_joints.LIMITS
    reachable = sum(any(way.seconds is not None for way in reach.ways) for reach in reaches)
    return [
        f"{len(reaches)} worlds of 3 to 6 links with limits, whose straight motion is not free; in {reachable} of them",
        "any planner finds a path. One run each on one core, ours with all 16 cells in it and `stretch = true`. OMPL's",
        f"collision test is our compiled one, called from Python; it has {limits.finding:g} s to find a path, which",
        f"is then simplified; BIT* goes on for {limits.improving:g} s. The length is the sum of all turns.",
        "",
        "| planner | solved | 3 links | 4 | 5 | 6 | seconds until solved, median | 90 % | turns, median (rad) |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|",
        *(_rival(name, place, reaches) for place, name in enumerate(names)),
    ]


def _rival(name: str, place: int, reaches: Sequence[Reach]) -> str:
    ways = [reach.ways[place] for reach in reaches]
    seconds = [way.seconds for way in ways if way.seconds is not None] or [np.nan]
    lengths = [way.length for way in ways if way.length is not None] or [np.nan]
    by_links = [
        sum(reach.ways[place].seconds is not None for reach in reaches if reach.links == links)
        for links in (3, 4, 5, 6)
    ]
    return (
        f"| {name} | {share(way.seconds is not None for way in ways)} | {' | '.join(map(str, by_links))} "
        f"| {np.median(seconds):.2f} | {np.quantile(seconds, 0.9):.2f} | {np.median(lengths):.1f} |"
    )
