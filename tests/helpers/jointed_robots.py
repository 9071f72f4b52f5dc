"""A small robot from a URDF text for tests of robot-path, and problems and paths of it."""

from pathlib import Path

import numpy as np

from genetics import Keys
from problems import ProblemFile, Run
from problems.robot_path import RobotPath


def chain(links=3, length=0.4, thickness=0.06, limit=3.0, speed=2.0):
    """The URDF of a chain of bars on a post that bends in the plane, and turns about the post."""
    parts = [f'<link name="post"><collision><origin xyz="0 0 -0.2"/>{_box(0.1, 0.1, 0.3)}</collision></link>']
    for number in range(links):
        above = "post" if number == 0 else f"bar_{number}"
        axis = "0 0 1" if number == 0 else "0 1 0"
        at = "0 0 0" if number == 0 else f"{length} 0 0"
        middle = f'<origin xyz="{length / 2} 0 0"/>'
        shape = _box(length - 0.02, thickness, thickness)
        parts.append(f'<link name="bar_{number + 1}"><collision>{middle}{shape}</collision></link>')
        parts.append(
            f'<joint name="joint_{number + 1}" type="revolute"><parent link="{above}"/><child link="bar_{number + 1}"/>'
            f'<origin xyz="{at}"/><axis xyz="{axis}"/>'
            f'<limit lower="{-limit}" upper="{limit}" velocity="{speed}" effort="10"/></joint>'
        )
    return f'<robot name="chain">{"".join(parts)}</robot>'


def _box(x, y, z):
    return f'<geometry><box size="{x} {y} {z}"/></geometry>'


WALL = {"id": "wall", "shape": "box", "size": [0.6, 0.05, 0.5], "position": [0.87, 0.0, 0.0]}
"""A wall between start and goal, which the chain can pass above."""
FIELDS = {
    "kind": "robot-path",
    "start": [-0.9, 0.0, 0.3],
    "goal": [0.9, 0.2, 0.0],
    "robot": {"urdf": chain()},
    "obstacles": [WALL],
}


def file_of(run=None, **fields):
    """The problem of `FIELDS`, with some of them changed; None leaves one out."""
    given = {name: value for name, value in (FIELDS | fields).items() if value is not None}
    filled = RobotPath.derive_fields(RobotPath.gather(given, Path()))
    return ProblemFile("chain.toml", filled, run or Run(topology="torus 1x2", stall=4), Path())


def problem_of(**fields):
    return file_of(**fields).problem()


def genomes_of(problem, count, seed=1, generation=0):
    return problem.coding.random(Keys(np.arange(1), np.uint64(seed), generation), count)[0]


def offspring_of(problem, parents, seed=1, generation=1):
    """The offspring of parents, shape (n, genome_bytes), each with the next one."""
    couples = np.stack([parents, np.roll(parents, 1, axis=0)], axis=1)[None].copy()
    recipe = problem.recipe("tuned", 1)
    return problem.coding.recombine(couples, recipe, Keys(np.arange(1), np.uint64(seed), generation))[0]
