"""Arms of two rods for tests of min-time, and trajectories of theirs."""

from pathlib import Path

import numpy as np

from genetics import Keys
from problems import ProblemFile, Run
from problems.min_time.levels import LEVELS

RODS = {"masses": [1.0, 1.0], "lengths": [1.0, 1.0], "tip_mass": 1.0, "torque": [64.5, 64.5]}


def problem_of(recipe="tuned", arm=None, **fields):
    base = {"kind": "min-time", "start": [-0.5, -1.0], "goal": [0.5, 1.0], "arm": RODS | (arm or {})}
    return ProblemFile("arm.toml", base | fields, Run(recipe=recipe), Path()).problem()


def genomes_of(problem, count, seed=1):
    return problem.coding.random(Keys(np.arange(1), np.uint64(seed), 0), count)[0]


def genome_of(problem, nodes, level=LEVELS):
    """Of nodes in grid steps, the goal included."""
    genes = np.array(nodes) * problem.coding.greatest[0] // (problem.grid - 1)
    return problem.coding.encode(np.column_stack([genes, np.full(len(nodes), level)]))


def time_of(problem, nodes, **options):
    return problem.evaluate(genome_of(problem, nodes, **options)[None])[0]


DIAGONAL = [[step, step] for step in range(1, 10)]


def spoiled(solution, **changes):
    return solution | {"trajectory": solution["trajectory"] | changes}
