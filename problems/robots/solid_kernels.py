"""The compiled, exact distance of a point from a box, a cylinder or a sphere.

A solid is described in its own frame: its centre is the origin; a cylinder's axis is z. Its half sizes are those of the
columns of `problems.robots.arm.Scene.solids`. Distances are signed: minus the depth for a point within.
"""

from typing import Any

import numpy as np

from lowlevel.compiled import inlined
from problems.robots.arm import BOX, CYLINDER


@inlined
def distance_from_box(x: Any, y: Any, z: Any, a: Any, b: Any, c: Any) -> Any:
    """Return the signed distance of a point from a box with the half sizes a, b, c."""
    dx, dy, dz = abs(x) - a, abs(y) - b, abs(z) - c
    inner = max(dx, dy, dz)
    if inner <= 0.0:
        return inner
    dx, dy, dz = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@inlined
def distance_from_cylinder(x: Any, y: Any, z: Any, radius: Any, half: Any) -> Any:
    """Return the signed distance of a point from a cylinder of a radius and half a length."""
    across, along = np.sqrt(x * x + y * y) - radius, abs(z) - half
    inner = max(across, along)
    if inner <= 0.0:
        return inner
    across, along = max(across, 0.0), max(along, 0.0)
    return np.sqrt(across * across + along * along)


@inlined
def distance_from_solid(kind: Any, x: Any, y: Any, z: Any, a: Any, b: Any, c: Any) -> Any:
    """Return the signed distance of a point from a solid of a kind (`problems.robots.arm`), half sizes a, b, c."""
    if kind == BOX:
        return distance_from_box(x, y, z, a, b, c)
    if kind == CYLINDER:
        return distance_from_cylinder(x, y, z, a, c)
    return np.sqrt(x * x + y * y + z * z) - a
