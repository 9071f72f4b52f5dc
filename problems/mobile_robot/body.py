"""The outline of a mobile robot."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
import shapely
from pydantic import Field, field_validator, model_validator

from problems.mobile_robot.arrays import SLIMMEST, is_wide
from problems.plane import Point, simple_polygon
from problems.tables import Table, quantity

Metres = Annotated[float, Field(ge=-1e4, le=1e4)]


class Body(Table):
    """The robot's outline, in its own frame: the reference point, about which it turns, is the origin; ahead is +x."""

    vertices: list[tuple[Metres, Metres]] | None = quantity(
        "m", "corners of a polygon, convex or not, in order, either way round", default=None
    )
    radius: float | None = quantity("m", "radius of a disc, instead of vertices", default=None, ge=1e-6, le=1e4)

    @field_validator("vertices")
    @classmethod
    def _simple(cls, vertices: list[Point] | None) -> list[Point] | None:
        if vertices is None:
            return None
        vertices = simple_polygon(vertices)
        if not is_wide(vertices):
            raise ValueError(f"expected a polygon at least {SLIMMEST:g} m wide everywhere, found {vertices}")
        return vertices

    @model_validator(mode="after")
    def _polygon_or_disc(self) -> Self:
        if (self.vertices is None) == (self.radius is None):
            found = "neither" if self.radius is None else "both"
            raise ValueError(f"expected either vertices or radius, found {found}")
        return self

    @property
    def circumscribed_radius(self) -> float:
        """The farthest corner's distance from the reference point, m; 0 for a disc, whose heading does not matter."""
        return 0.0 if self.vertices is None else float(np.linalg.norm(self.vertices, axis=1).max())

    @property
    def covered_radius(self) -> float:
        """The radius of the largest disc about the reference point that the robot covers, m; 0 if it covers none."""
        if self.vertices is None:
            return self.radius or 0.0
        # The disc must lie within the outline, so the reference point must; then the nearest edge bounds it.
        outline, reference = shapely.Polygon(self.vertices), shapely.Point(0.0, 0.0)
        return float(outline.exterior.distance(reference)) if outline.contains(reference) else 0.0
