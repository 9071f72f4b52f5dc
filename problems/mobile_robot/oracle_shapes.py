"""The shapes that the oracle of mobile-robot reckons with: where a disc's centre or a polygon's reference may be.

Round corners become polygons twice: drawn around, so that whatever is free is surely free, and drawn within, so that
whatever is out of reach is surely so.
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
    from problems.mobile_robot.problem import MobileRobot

Floats = NDArray[np.float64]
Points = NDArray[np.float64]  # (n, 2), m

ARC = 32
"""Sides of a polygon that stand for a quarter of a circle; of shorter arcs a side may be half as long again."""

AROUND = 1.0 / np.cos(1.5 * np.pi / 4.0 / ARC)
"""By this much larger, such a polygon encloses its circle."""


def free_of_disc(problem: MobileRobot, radius: float, surely: bool) -> shapely.Geometry:
    """Where the centre of a disc may be: ``surely``, or at most."""
    x0, y0, x1, y1 = problem.bounds
    gap = radius if surely else radius - TOLERANCE
    if min(x1 - x0, y1 - y0) < 2.0 * gap:
        return shapely.Polygon()
    solids = [grown(obstacle, radius, surely) for obstacle in problem.obstacles]
    return shapely.box(x0 + gap, y0 + gap, x1 - gap, y1 - gap).difference(shapely.union_all(solids))


def grown(obstacle: Obstacle, radius: float, surely: bool) -> shapely.Geometry:
    """By at least the radius, or at most; piece by piece, since GEOS rounds what is hardly concave."""
    if isinstance(obstacle, Circle):
        pieces, radius = [shapely.Point(obstacle.center)], radius + obstacle.radius
    else:
        pieces = [shapely.Polygon(piece) for piece in convex(obstacle.polygon)]
    by = radius * AROUND if surely else radius - TOLERANCE
    return shapely.union_all([piece.buffer(by, quad_segs=ARC) for piece in pieces])


def forbidden(obstacle: Obstacle, piece: Points, surely: bool) -> Iterator[shapely.Geometry]:
    """Convex shapes where the reference point must not be, lest a convex piece of the robot be in the obstacle."""
    if isinstance(obstacle, Circle):
        places = shapely.MultiPoint(obstacle.center - piece).convex_hull
        radius = obstacle.radius * AROUND if surely else obstacle.radius - TOLERANCE
        yield places.buffer(max(radius, 0.0), quad_segs=ARC)
        return
    for corners in convex(obstacle.polygon):
        yield shapely.MultiPoint((corners[:, None] - piece).reshape(-1, 2)).convex_hull


def swept(pieces: Sequence[Points], low: float, high: float) -> list[Points]:
    """Convex pieces that cover those of the robot, given in its own frame, at all headings from ``low`` to ``high``."""
    if low == high:
        return [piece @ turned(low) for piece in pieces]
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    # A corner runs along an arc, which lies between its ends and the point where the tangents there meet.
    turns = [(low, 1.0), (high, 1.0), (middle, 1.0 / np.cos(half))]
    return [np.concatenate([scale * piece @ turned(turn) for turn, scale in turns]) for piece in pieces]


def room_for(problem: MobileRobot, corners: Points, gap: float) -> tuple[Points, Points]:
    """The lower and the upper corner of where the reference point may be, lest a corner leave the bounds."""
    return problem.bounds[:2] - corners.min(axis=0) + gap, problem.bounds[2:] - corners.max(axis=0) - gap


def turned(angle: float) -> Floats:
    """The matrix that turns rows of coordinates anticlockwise."""
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def shorter(turn: float) -> float:
    """The same angle in [-π, π)."""
    return float((turn + np.pi) % (2.0 * np.pi) - np.pi)


def convex(shape: shapely.Geometry) -> list[Points]:
    """The corners of convex pieces that make up a shape; none of an empty one."""
    pieces: list[Points] = []
    for part in parts(shape):
        whole = part.convex_hull.area <= part.area * (1.0 + 1e-12)
        solids = [part] if whole else shapely.get_parts(shapely.constrained_delaunay_triangles(part))
        pieces += [shapely.get_coordinates(solid)[:-1] for solid in solids]
    return pieces


def parts(free: shapely.Geometry) -> Iterator[shapely.Polygon]:
    """The connected parts of free places."""
    return (part for part in shapely.get_parts(free) if part.geom_type == "Polygon" and not part.is_empty)


def part_at(free: shapely.Geometry, place: tuple[float, float]) -> shapely.Geometry:
    """The connected part of the free places that ``place`` is in; an empty one if it is in none."""
    point = shapely.Point(place)
    return next((part for part in parts(free) if part.covers(point)), shapely.Polygon())
