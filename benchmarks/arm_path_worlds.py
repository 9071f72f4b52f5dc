"""Random worlds for Manhattan motions.

The same number gives the same world. No recipe was tuned on the worlds outside `TUNED_ON`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from problems import ProblemFile, Run
from problems.arm_ik import ArmIk
from problems.arm_path import ArmPath
from problems.arm_path.oracle import Grid, fill, move_counts

Fields = dict[str, Any]

TUNED_ON = range(10_000, 30_000)
"""The numbers of the worlds on which the tuned recipe was chosen. Benchmarks must use others."""

FEWEST_MOVES = 4
ROUNDS = 48
_ROUNDS_OF_MANY_LINKS = 12
_MOST_MOVES = 32  # far fewer moves than an individual has
_STEP = 2.0 * np.pi / 256


def arm_path_world(number: int, run: Run | None = None) -> ProblemFile:
    """Return world ``number``: two links, and a goal that certainly can be reached, but not in fewer than 4 moves."""
    generator = np.random.default_rng([1992, 4, number])
    while True:
        fields, grid = _scattered(generator)
        counts = move_counts(grid)
        fewest = np.where(counts < 0, 1 << 30, counts).min(axis=0)
        goals = np.argwhere((fewest >= FEWEST_MOVES) & (fewest <= _MOST_MOVES))
        if len(goals):
            return _with_goal(f"world {number}", fields, generator.choice(goals), run)


def unsolvable_world(number: int, run: Run | None = None) -> ProblemFile:
    """Return unsolvable world ``number``: the goal is free, but certainly cannot be reached from the start."""
    generator = np.random.default_rng([1992, 40, number])
    while True:
        fields, grid = _scattered(generator)
        counts = move_counts(grid._replace(surely_free=grid.maybe_free))
        goals = np.argwhere(grid.surely_free & (counts < 0).all(axis=0))
        if len(goals):
            return _with_goal(f"unsolvable world {number}", fields, generator.choice(goals), run)


def many_links_world(number: int) -> ArmPath:
    """Return world ``number`` of arms of 3 to 6 links with limits, whose straight motion to the goal is blocked.

    The world may have no path.
    """
    generator = np.random.default_rng([1992, 400, number])
    while True:
        links = 3 + number % 4
        fields = _world(generator, links) | {"stretch": True, "rounds": _ROUNDS_OF_MANY_LINKS}
        fields["arm"]["limits"] = [[-np.pi, np.pi]] * links
        fields |= dict(zip(("start", "goal"), generator.uniform(-np.pi, np.pi, (2, links)).tolist(), strict=True))
        try:
            problem = ArmPath.model_validate(fields)
        except ValueError:  # a configuration collides
            continue
        straight = np.linspace(problem.start, problem.goal, 500)
        if np.isinf(same_arm(problem).distances(straight)).any():
            return problem


def same_arm(problem: ArmPath) -> ArmIk:
    """Return the same arm among the same obstacles; its `distances` are infinite for configurations that collide."""
    shared = problem.model_dump(include={"arm", "obstacles", "self_collision"}, exclude_unset=True)
    return ArmIk.model_validate(shared | {"kind": "arm-ik", "target": problem.arm.base})


def _with_goal(name: str, fields: Fields, goal: NDArray[np.int64], run: Run | None) -> ProblemFile:
    return ProblemFile(name, fields | {"goal": (goal * _STEP).tolist()}, run or Run(), Path())


def _scattered(generator: np.random.Generator) -> tuple[Fields, Grid]:
    """Return a world whose goal is its start, and its grid of configurations."""
    while True:
        fields = _world(generator)
        try:
            problem = ArmPath.model_validate(fields | {"goal": fields["start"]})
        except ValueError:  # a configuration collides
            continue
        return fields, fill(problem)


def _world(generator: np.random.Generator, count: int = 2) -> Fields:
    """Return a problem without a goal: links of random lengths among 4 to 10 obstacles within the arm's reach."""
    links = generator.uniform(0.5, 1.0, count)
    reach = float(links.sum())
    obstacles = [_thing(generator, reach) for _ in range(generator.integers(4, 11))]
    return {
        "kind": "arm-path",
        "start": (generator.integers(0, 256, count) * _STEP + _STEP / 3).tolist(),
        "rounds": ROUNDS,
        "arm": {"links": links.tolist(), "radius": 0.03},
        "obstacles": obstacles,
    }


def _thing(generator: np.random.Generator, reach: float) -> Fields:
    bearing, away = generator.uniform(0.0, 2.0 * np.pi), reach * generator.uniform(0.25, 1.0)
    center = away * np.array([np.cos(bearing), np.sin(bearing)])
    match generator.integers(3):
        case 0:
            return {
                "shape": "circle",
                "center": center.tolist(),
                "radius": float(reach * generator.uniform(0.03, 0.12)),
            }
        case 1:
            size = (reach * generator.uniform(0.05, 0.3, 2)).tolist()
            return {
                "shape": "box",
                "center": center.tolist(),
                "size": size,
                "angle": float(generator.uniform(0, np.pi)),
            }
        case _:
            count = int(generator.integers(3, 8))
            bearings = (np.arange(count) + generator.uniform(0.1, 0.9, count)) * 2.0 * np.pi / count
            radii = reach * generator.uniform(0.05, 0.18, count)
            corners = center + (radii * np.array([np.cos(bearings), np.sin(bearings)])).T
            return {"shape": "polygon", "vertices": corners.tolist()}
