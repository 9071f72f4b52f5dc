"""Random worlds of two-link arms: instances that nobody tuned to, the same for the same number."""

from __future__ import annotations

from typing import Any

import numpy as np

from problems import BadInput, ProblemFile, Run
from problems.arm_ik import ArmIk

LEAST_FREE = 0.15  # of the configurations, else a world is drawn anew


def arm_world(number: int, run: Run | None = None, bits: int = 8) -> ProblemFile:
    """World ``number``: 3 to 8 obstacles within reach, and a target that some free configuration reaches exactly."""
    generator = np.random.default_rng([1992, number])
    while True:
        fields = _world(generator, bits)
        try:
            problem = ArmIk.model_validate(fields)
        except BadInput:
            continue
        except ValueError:  # the base stands in an obstacle
            continue
        angles = generator.uniform(0.0, 2.0 * np.pi, (1000, 2))
        free = np.isfinite(problem.distances(angles))
        if free.mean() < LEAST_FREE:
            continue
        headings = np.cumsum(angles[free][0])
        links = np.array(fields["arm"]["links"])
        fields["target"] = [float(links @ np.cos(headings)), float(links @ np.sin(headings))]
        return ProblemFile(f"world {number}", fields, run or Run(), None)  # type: ignore[arg-type]


def _world(generator: np.random.Generator, bits: int) -> dict[str, Any]:
    links = generator.uniform(0.5, 1.0, 2)
    radius = float(generator.choice([0.0, 0.03, 0.06]))
    obstacles = [_obstacle(generator, float(links.sum())) for _ in range(generator.integers(3, 9))]
    arm = {"links": links.tolist(), "radius": radius}
    return {"kind": "arm-ik", "target": [0.0, 0.0], "bits": bits, "arm": arm, "obstacles": obstacles}


def _obstacle(generator: np.random.Generator, reach: float) -> dict[str, Any]:
    away, bearing = reach * generator.uniform(0.3, 1.0), generator.uniform(0.0, 2.0 * np.pi)
    center = away * np.array([np.cos(bearing), np.sin(bearing)])
    size = reach * generator.uniform(0.05, 0.2)
    shape = generator.choice(["circle", "box", "polygon"])
    if shape == "circle":
        return {"shape": "circle", "center": center.tolist(), "radius": size}
    if shape == "box":
        sides = size * generator.uniform(0.5, 2.0, 2)
        angle = generator.uniform(0.0, np.pi)
        return {"shape": "box", "center": center.tolist(), "size": sides.tolist(), "angle": angle}
    bearings = np.sort(generator.uniform(0.0, 2.0 * np.pi, generator.integers(3, 8)))
    corners = center + size * generator.uniform(0.5, 1.5, (len(bearings), 1)) * np.column_stack(
        [np.cos(bearings), np.sin(bearings)]
    )
    return {"shape": "polygon", "vertices": corners.tolist()}
