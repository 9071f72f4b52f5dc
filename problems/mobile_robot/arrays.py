"""Convert robots and floors into the arrays that the compiled scan takes."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from problems.plane import CONTACT, Obstacle, Point, Shapes, anticlockwise

Floats = NDArray[np.float64]

SLIMMEST = 1e-6
"""The least width of a robot (m), far more than `CONTACT`, so that a robot smaller by that is still a polygon."""

_MARGIN = 1e-9  # m: boxes and discs around shapes are larger by this, so that rounding never leaves out a shape


def _offset(vertices: Sequence[Point], by: float) -> Floats:
    """Return the outline of a simple polygon, anticlockwise, with each edge moved inwards by ``by``; (corners, 2)."""
    corners = _without_repeats(anticlockwise(vertices))
    along = np.roll(corners, -1, axis=0) - corners
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    outwards = np.column_stack([along[:, 1], -along[:, 0]])
    before = np.roll(outwards, 1, axis=0)
    # A corner moves along the bisector of its edges' normals, so far that both edges move by the same distance.
    bend = 1.0 + np.sum(outwards * before, axis=1, keepdims=True)
    return np.ascontiguousarray(corners - by * (outwards + before) / bend)


def is_wide(vertices: Sequence[Point]) -> bool:
    """Return whether a simple polygon stays one when each edge moves inwards by half of `SLIMMEST`."""
    outline = _offset(vertices, SLIMMEST / 2.0)
    inner = shapely.Polygon(outline)
    return bool(inner.is_valid and inner.exterior.is_ccw)


def _without_repeats(corners: Floats) -> Floats:
    steps = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
    kept: Floats = corners[steps > 0.0]
    return kept


def robot_arrays(
    vertices: Sequence[Point] | None, radius: float | None, clearance: float = 0.0
) -> tuple[Floats, float]:
    """Return the outline and thickness of `problems.mobile_robot.contact.Robot`, thicker by a clearance (m)."""
    if vertices is not None:
        return _offset(vertices, CONTACT), clearance
    assert radius is not None, "a robot is a polygon or a disc"
    # A disc is a single corner at the reference point, thickened by its radius.
    return np.zeros((1, 2)), radius - CONTACT + clearance


def floor_arrays(bounds: Sequence[float], obstacles: Sequence[Obstacle]) -> tuple[NDArray[np.generic], ...]:
    """Return the fields of `problems.mobile_robot.contact.Floor`."""
    shapes = Shapes.of(obstacles)
    parts = np.split(shapes.corners, shapes.starts[1:-1]) if obstacles else []
    boxes, middles = np.empty((len(parts), 4)), np.empty((len(parts), 3))
    for shape, (corners, thickness) in enumerate(zip(parts, shapes.thickness, strict=True)):
        low, high = corners.min(axis=0), corners.max(axis=0)
        middle = (low + high) / 2.0
        farthest = np.linalg.norm(corners - middle, axis=1).max()
        boxes[shape] = [*(low - thickness - _MARGIN), *(high + thickness + _MARGIN)]
        middles[shape] = [*middle, farthest + thickness + _MARGIN]
    return np.array(bounds), shapes.corners, shapes.starts, shapes.thickness, boxes, middles
