"""Random worlds of two-link arms.

The same number gives the same world. No recipe was tuned on the worlds outside `TUNED_ON`.
"""

from typing import Any

import numpy as np
from pydantic import ValidationError

from problems.arm_ik import ArmIk

TUNED_ON = range(10_000, 30_000)
"""The numbers of the worlds on which the tuned recipe was chosen. Benchmarks must use others."""

_LEAST_FREE = 0.15  # share of the configurations; a world with less is drawn again
_SAMPLES = 1000


def arm_world(number: int, bits: int = 8) -> ArmIk:
    """Return world ``number``: 3 to 8 obstacles within reach; a free configuration reaches the target exactly."""
    generator = np.random.Generator(np.random.PCG64([1992, number]))
    while True:
        fields = _world(generator, bits)
        try:
            free = _free_configurations(ArmIk.model_validate(fields), generator)
        except ValidationError:  # the base is inside an obstacle
            continue
        if len(free) >= _LEAST_FREE * _SAMPLES:
            headings = np.cumsum(free[0])
            links = np.array(fields["arm"]["links"])
            target = [float(links @ np.cos(headings)), float(links @ np.sin(headings))]
            return ArmIk.model_validate(fields | {"target": target})


def _free_configurations(problem: ArmIk, generator: np.random.Generator) -> np.ndarray:
    angles = generator.uniform(0.0, 2.0 * np.pi, (_SAMPLES, 2))
    return angles[np.isfinite(problem.distances(angles))]


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
    shape = str(generator.choice(["circle", "box", "polygon"]))
    if shape == "circle":
        return {"shape": shape, "center": center.tolist(), "radius": size}
    if shape == "box":
        sides, angle = size * generator.uniform(0.5, 2.0, 2), generator.uniform(0.0, np.pi)
        return {"shape": shape, "center": center.tolist(), "size": sides.tolist(), "angle": angle}
    bearings = np.sort(generator.uniform(0.0, 2.0 * np.pi, generator.integers(3, 8)))
    outwards = np.column_stack([np.cos(bearings), np.sin(bearings)])
    corners = center + size * generator.uniform(0.5, 1.5, (len(bearings), 1)) * outwards
    return {"shape": shape, "vertices": corners.tolist()}
