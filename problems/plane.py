"""Obstacles in the plane: their tables in problem files, and their forms for kernels, shapely and matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import Field, field_validator

from problems.angles import Angle
from problems.motion import loop
from problems.tables import Table, quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# A finite number may still overflow when it is squared, so all numbers have bounds beyond which no plan makes sense.
Metres = Annotated[float, Field(ge=-1e6, le=1e6)]
Size = Annotated[float, Field(ge=1e-6, le=1e6)]  # m
Point = tuple[Metres, Metres]

CONTACT = 1e-9
"""Shapes that overlap by no more than this, m, only touch, which counts as free."""


class Circle(Table):
    """A solid disc."""

    shape: Literal["circle"]
    center: Point = quantity("m", "its centre")
    radius: Size = quantity("m", "its radius")

    @property
    def corners(self) -> NDArray[np.float64]:
        """The centre, shape (1, 2): a disc is a thickened point."""
        return np.array([self.center])

    @property
    def thickness(self) -> float:
        """The distance by which the corners are thickened, m."""
        return self.radius

    def covers(self, point: Point) -> bool:
        """Return whether ``point`` lies inside, deeper than `CONTACT`."""
        return bool(np.hypot(point[0] - self.center[0], point[1] - self.center[1]) < self.radius - CONTACT)

    def is_nearer(self, other: shapely.Geometry, limit: float) -> bool:
        """Return whether ``other`` is nearer than ``limit``, m."""
        return bool(other.distance(shapely.Point(self.center)) < self.radius + limit)


class _Solid(Table):
    """The common base of polygons and boxes, which have corners and no thickness."""

    @property
    def outline(self) -> Sequence[Point]:
        raise TypeError("a solid has an outline")

    @cached_property
    def polygon(self) -> shapely.Polygon:
        return shapely.Polygon(self.outline)

    @cached_property
    def corners(self) -> NDArray[np.float64]:
        """The corners in anticlockwise order, m, shape (n, 2)."""
        return anticlockwise(self.outline)

    @property
    def thickness(self) -> float:
        return 0.0

    def covers(self, point: Point) -> bool:
        """Return whether ``point`` lies inside, deeper than `CONTACT`."""
        place = shapely.Point(point)
        # Contact is free, so the point must also be away from the outline.
        return bool(self.polygon.contains(place) and self.polygon.exterior.distance(place) > CONTACT)

    def is_nearer(self, other: shapely.Geometry, limit: float) -> bool:
        """Return whether ``other`` is nearer than ``limit``, m."""
        return bool(other.distance(self.polygon) < limit)


class Polygon(_Solid):
    """A solid simple polygon, convex or not."""

    shape: Literal["polygon"]
    vertices: list[Point] = quantity("m", "its corners in order, clockwise or anticlockwise; at least 3")

    @field_validator("vertices")
    @classmethod
    def _simple(cls, vertices: list[Point]) -> list[Point]:
        return simple_polygon(vertices)

    @property
    def outline(self) -> Sequence[Point]:
        """The corners in the order of the file."""
        return self.vertices


class Box(_Solid):
    """A solid rectangle."""

    shape: Literal["box"]
    center: Point = quantity("m", "its centre")
    size: tuple[Size, Size] = quantity("m", "its width and height")
    angle: Angle = quantity("rad", "by which it is turned, anticlockwise", default=0.0)

    @property
    def outline(self) -> Sequence[Point]:
        """The corners in anticlockwise order."""
        half = np.array(self.size) / 2
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        turned = corners @ np.array([[cosine, sine], [-sine, cosine]]) + self.center
        return [(float(x), float(y)) for x, y in turned]


Obstacle = Annotated[Circle | Polygon | Box, Field(discriminator="shape")]


@dataclass(frozen=True)
class Shapes:
    """Obstacles as arrays, for compiled code.

    Shape i has the corners ``corners[starts[i]:starts[i + 1]]``, thickened by ``thickness[i]``. A disc is one thickened
    corner; a polygon has anticlockwise corners and thickness 0.
    """

    corners: NDArray[np.float64]  # (all corners, 2), m
    starts: NDArray[np.int64]  # (shapes + 1,)
    thickness: NDArray[np.float64]  # (shapes,), m

    @staticmethod
    def of(obstacles: Sequence[Circle | Polygon | Box]) -> Shapes:
        """Return the arrays of some obstacles, in the same order."""
        corners = [obstacle.corners for obstacle in obstacles]
        return Shapes(
            np.concatenate([np.empty((0, 2)), *corners]),
            np.cumsum([0, *(len(part) for part in corners)], dtype=np.int64),
            np.array([obstacle.thickness for obstacle in obstacles], dtype=np.float64),
        )


def outlines(obstacles: Sequence[Circle | Polygon | Box]) -> tuple[NDArray[np.float64], ...]:
    """Return closed lines around obstacles in the plane z = 0, each of shape (corners, 3)."""
    return tuple(loop(obstacle.corners, obstacle.thickness) for obstacle in obstacles)


def simple_polygon(vertices: list[Point]) -> list[Point]:
    """Return ``vertices`` without a last one that repeats the first.

    Raises:
        ValueError: if they are no simple polygon with an area; the message says what was found.
    """
    if len(vertices) > 3 and vertices[0] == vertices[-1]:  # many formats close a polygon so
        vertices = vertices[:-1]
    if len(vertices) < 3:
        raise ValueError(f"expected at least 3 vertices, found {len(vertices)}")
    polygon = shapely.Polygon(vertices)
    if not polygon.is_valid or polygon.area <= CONTACT:
        raise ValueError(
            f"expected a simple polygon with an area, found {shapely.is_valid_reason(polygon)}, area {polygon.area:g}"
        )
    return vertices


def anticlockwise(vertices: Sequence[Point]) -> NDArray[np.float64]:
    """Return the corners of a simple polygon in anticlockwise order, shape (n, 2)."""
    corners = np.array(vertices, dtype=np.float64)
    x, y = corners[:, 0], corners[:, 1]
    doubled_area = np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)  # positive if anticlockwise
    return corners if doubled_area > 0 else corners[::-1].copy()


def draw_obstacles(axes: Axes, obstacles: Sequence[Circle | Polygon | Box]) -> None:
    """Add obstacles to a picture as dark, filled patches."""
    from matplotlib import patches

    for obstacle in obstacles:
        patch: patches.Patch
        if isinstance(obstacle, Circle):
            patch = patches.Circle(obstacle.center, obstacle.radius)
        else:
            patch = patches.Polygon(obstacle.corners, closed=True)
        patch.set(facecolor="0.35", edgecolor="0.2", linewidth=0.8, zorder=2)
        axes.add_patch(patch)
