"""The shapes of mobile-robot's oracle: where a disc's centre or a polygon's reference point may be.

Round corners become polygons in two ways. With ``surely`` the polygon is drawn around the circle: what is free of the
shapes is surely free, which proves that there is a way. Otherwise it is drawn within the circle, and smaller by the
checker's tolerance: what is out of reach is surely so, which proves that there is none.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray

from problems.mobile_robot.checker import TOLERANCE
from problems.plane import Circle, Obstacle

if TYPE_CHECKING:
    from problems.mobile_robot.model import MobileRobotModel

Floats = NDArray[np.float64]
Points = NDArray[np.float64]  # (n, 2), m

ARC = 32
"""The number of sides that stand for a quarter of a circle; on shorter arcs a side may be half as long again."""

AROUND = 1.0 / np.cos(1.5 * np.pi / 4.0 / ARC)
"""The factor of the radius with which such a polygon encloses its circle, even with its longest sides."""


def free_of_disc(problem: MobileRobotModel, radius: float, surely: bool) -> shapely.Geometry:
    """Return where the centre of a disc may be: a subset of it if ``surely``, else a superset."""
    x0, y0, x1, y1 = problem.bounds
    # Walls are straight, so here the radius itself is exact; only the checker's tolerance counts.
    gap = radius if surely else radius - TOLERANCE
    if min(x1 - x0, y1 - y0) < 2.0 * gap:
        return shapely.Polygon()
    solids = [grown(obstacle, radius, surely) for obstacle in problem.obstacles]
    return shapely.box(x0 + gap, y0 + gap, x1 - gap, y1 - gap).difference(shapely.union_all(solids))


def grown(obstacle: Obstacle, radius: float, surely: bool) -> shapely.Geometry:
    """Return an obstacle grown by at least the radius if ``surely``, else by at most the radius.

    It grows convex pieces one by one, since GEOS rounds off corners that are hardly concave.
    """
    if isinstance(obstacle, Circle):
        pieces, radius = [shapely.Point(obstacle.center)], radius + obstacle.radius
    else:
        pieces = [shapely.Polygon(piece) for piece in convex(obstacle.polygon)]
    # A buffer's corners lie on the true circle, so its sides lie within: grown by AROUND it encloses the circle.
    by = radius * AROUND if surely else radius - TOLERANCE
    return shapely.union_all([piece.buffer(by, quad_segs=ARC) for piece in pieces])


def forbidden(obstacle: Obstacle, piece: Points, surely: bool) -> Iterator[shapely.Geometry]:
    """Yield convex shapes where the reference point must not be, or a convex piece of the robot is in the obstacle.

    They are Minkowski sums of the obstacle's convex pieces and the mirrored piece of the robot: hulls of the
    differences of corners, which are exact for polygons. Only circles are approximated.
    """
    if isinstance(obstacle, Circle):
        # The reference points at which a corner of the piece is at the circle's centre; the hull covers all other
        # points.
        places = shapely.MultiPoint(obstacle.center - piece).convex_hull
        radius = obstacle.radius * AROUND if surely else obstacle.radius - TOLERANCE
        yield places.buffer(max(radius, 0.0), quad_segs=ARC)
        return
    for corners in convex(obstacle.polygon):
        yield shapely.MultiPoint((corners[:, None] - piece).reshape(-1, 2)).convex_hull


def swept(pieces: Sequence[Points], low: float, high: float) -> list[Points]:
    """Return corners of convex pieces that cover those of the robot at all headings from ``low`` to ``high``.

    ``pieces`` are in the robot's frame. The hull of a result's corners is meant, and it may cover more.
    """
    if low == high:
        return [piece @ turned(low) for piece in pieces]
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    # A corner runs along an arc, which lies between its ends and the point where the tangents there meet.
    turns = [(low, 1.0), (high, 1.0), (middle, 1.0 / np.cos(half))]
    return [np.concatenate([scale * piece @ turned(turn) for turn, scale in turns]) for piece in pieces]


def room_for(problem: MobileRobotModel, corners: Points, gap: float) -> tuple[Points, Points]:
    """Return the lower and the upper corner of where the reference point may be with all corners within the bounds."""
    return problem.bounds[:2] - corners.min(axis=0) + gap, problem.bounds[2:] - corners.max(axis=0) - gap


def turned(angle: float) -> Floats:
    """Return the matrix that turns rows of coordinates anticlockwise, if multiplied from the right."""
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def shorter(turn: float) -> float:
    """Return the same angle in [-π, π)."""
    return float((turn + np.pi) % (2.0 * np.pi) - np.pi)


def convex(shape: shapely.Geometry) -> list[Points]:
    """Return the corners of convex pieces that make up a shape, one array each; none for an empty shape."""
    pieces: list[Points] = []
    for part in parts(shape):
        # A part as large as its hull is convex.
        whole = part.convex_hull.area <= part.area * (1.0 + 1e-12)
        solids = [part] if whole else shapely.get_parts(shapely.constrained_delaunay_triangles(part))
        pieces += [shapely.get_coordinates(solid)[:-1] for solid in solids]
    return pieces


def parts(free: shapely.Geometry) -> Iterator[shapely.Polygon]:
    """Return the connected parts of free places; points and lines among them are left out."""
    return (part for part in shapely.get_parts(free) if part.geom_type == "Polygon" and not part.is_empty)


def part_at(free: shapely.Geometry, place: tuple[float, float]) -> shapely.Geometry:
    """Return the connected part of the free places that ``place`` is in; an empty polygon if it is in none."""
    point = shapely.Point(place)
    return next((part for part in parts(free) if part.covers(point)), shapely.Polygon())
