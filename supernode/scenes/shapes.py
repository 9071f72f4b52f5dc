"""Shapes of scenes as problem files have them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from problems.errors import BadInput, shorten
from supernode.scenes.scene import Mesh

KINDS = {1: "box", 2: "sphere", 3: "cylinder", 4: "cone"}
"""The numbers of shape_msgs/SolidPrimitive."""
_COUNTS = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2}
_SIDES = 48  # of a cone as a mesh: it is at most 0.3 % wider


def primitive(kind: str, sizes: Sequence[float], where: str) -> tuple[dict[str, Any], Mesh | None]:
    """Return the fields of a primitive, and its triangles for a cone, which problem files do not have.

    Args:
        kind: box, sphere, cylinder or cone.
        sizes: full lengths; a radius; radius and length.
        where: the file and the field, for messages.

    Raises:
        BadInput: if the shape is not known, or its sizes are wrong.
    """
    if kind not in _COUNTS:
        raise BadInput(f"{where}: expected box, sphere, cylinder, cone or mesh, found {kind!r}; replace or remove it")
    if len(sizes) != _COUNTS[kind] or not all(math.isfinite(each) and each > 0.0 for each in sizes):
        raise BadInput(f"{where}: expected {_COUNTS[kind]} sizes of a {kind} above 0 m, found {list(sizes)}")
    if kind == "box":
        return {"shape": "box", "size": list(sizes)}, None
    if kind == "sphere":
        return {"shape": "sphere", "radius": sizes[0]}, None
    if kind == "cylinder":
        return {"shape": "cylinder", "radius": sizes[0], "length": sizes[1]}, None
    return {"shape": "mesh"}, cone(sizes[0], sizes[1])


def cone(radius: float, length: float) -> Mesh:
    """Return a pyramid of many sides around a cone about its centre, whose tip is at +z."""
    turns = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    wide = radius / math.cos(math.pi / _SIDES)  # so that its sides are not within the cone
    ring = np.stack([wide * np.cos(turns), wide * np.sin(turns), np.full(_SIDES, -length / 2)], axis=1)
    vertices = np.concatenate([ring, [[0.0, 0.0, length / 2], [0.0, 0.0, -length / 2]]])
    one = np.arange(_SIDES)
    two = (one + 1) % _SIDES
    sides = np.stack([one, two, np.full(_SIDES, _SIDES)], axis=1)
    floor = np.stack([two, one, np.full(_SIDES, _SIDES + 1)], axis=1)
    return vertices, np.concatenate([sides, floor])


def mesh(vertices: Sequence[Sequence[float]], triangles: Sequence[Sequence[int]], where: str) -> Mesh:
    """Return a mesh.

    Raises:
        BadInput: if it has no triangles, or these name vertices that are not there.
    """
    points = np.array(vertices, np.float64).reshape(-1, 3)
    numbers = [number for triangle in triangles for number in triangle]
    if not numbers:
        raise BadInput(f"{where}: expected a mesh with triangles, found none; remove it")
    if min(numbers) < 0 or max(numbers) >= len(points):  # before they become int64, which some may be too large for
        raise BadInput(
            f"{where}: expected triangles of vertices 0 to {len(points) - 1}, found "
            f"{shorten(min(numbers))} to {shorten(max(numbers))}"
        )
    return points, np.array(triangles, np.int64).reshape(-1, 3)


def as_obj(solid: Mesh) -> str:
    """Return a mesh as the text of an OBJ file."""
    points = (f"v {x!r} {y!r} {z!r}" for x, y, z in solid[0].tolist())
    corners = (f"f {one + 1} {two + 1} {three + 1}" for one, two, three in solid[1].tolist())
    return "\n".join([*points, *corners, ""])
