"""Random sphere worlds of three to seven dimensions.

The same number gives the same world. docs/sphere-path.md says which numbers the benchmark uses.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from problems import ProblemFile, Run
from problems.sphere_path import SpherePath
from problems.sphere_path.checker import crossed_by

SIDE = 10.0
NODES = 6
CORRIDOR = 3
CLEARANCE = 0.2
CROWDS = {
    3: (120, (0.8, 2.2)),
    4: (400, (1.0, 2.6)),
    5: (900, (1.4, 3.2)),
    6: (1600, (2.0, 4.0)),
    7: (2500, (2.5, 4.5)),
}
"""Number of spheres and range of their radii, by number of axes.

The worlds are so crowded that at most about one in ten thousand random paths is free.
"""


def sphere_world(number: int, run: Run | None = None) -> ProblemFile:
    """Return world ``number``, of 3 to 7 axes in turn: a hidden corridor is free, the straight way is not."""
    axes = 3 + number % 5
    generator = np.random.default_rng([1998, 5, number])
    count, radius = CROWDS[axes]
    while True:
        fields = {
            "kind": "sphere-path",
            "start": generator.uniform(0.0, 0.25 * SIDE, axes).tolist(),
            "goal": generator.uniform(0.75 * SIDE, SIDE, axes).tolist(),
            "bounds": [[0.0, SIDE]] * axes,
            "nodes": NODES,
            "random": {
                "seed": int(generator.integers(1 << 32)),
                "count": count,
                "radius": list(radius),
                "corridor": CORRIDOR,
                "clearance": CLEARANCE,
            },
        }
        problem = SpherePath.model_validate(fields)
        if crossed_by(problem, problem.straight):
            return ProblemFile(f"world {number}", fields, run or Run(), Path())
