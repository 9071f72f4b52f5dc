"""The gaps between a vehicle in the plane and its obstacles, for many poses at once, by shapely.

All shapes are filled: a vehicle inside an obstacle, or an obstacle inside a vehicle, has no gap.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from problems.plane import Circle, Obstacle
from problems.sphere_path.cells import Clearance
from problems.sphere_path.pose import rotations
from problems.sphere_path.vehicle import Vehicle

Floats = NDArray[np.float64]


class _Floor:
    """Planar obstacles: circles as centres and radii, which is exact, all others united in one shape."""

    def __init__(self, obstacles: Sequence[Obstacle]) -> None:
        circles = [each for each in obstacles if isinstance(each, Circle)]
        self.solids = shapely.union_all([each.polygon for each in obstacles if not isinstance(each, Circle)])
        self.centres = shapely.points(np.array([each.center for each in circles]).reshape(-1, 2))
        self.radii = np.array([each.radius for each in circles])

    def gaps(self, shapes: NDArray[Any]) -> Floats:
        """Return the gap between each shape, (n,), and the nearest obstacle; 0 if they meet."""
        to_solids = np.nan_to_num(shapely.distance(shapes, self.solids), nan=np.inf)  # nan: there are no solids
        to_circles = shapely.distance(shapes[:, None], self.centres) - self.radii
        gaps: Floats = np.maximum(0.0, np.minimum(to_solids, to_circles.min(axis=1, initial=np.inf)))
        return gaps


def in_the_plane(vehicle: Vehicle, obstacles: Sequence[Obstacle]) -> Clearance:
    """Return the gaps of a disc at [x, y], or of a polygon at [x, y] or [x, y, heading]."""
    floor = _Floor(obstacles)
    if vehicle.radius is not None:
        return lambda configurations: _disc(floor, vehicle.radius or 0.0, configurations)
    corners = np.array(vehicle.vertices)
    return lambda configurations: _polygon(floor, corners, configurations)


def _disc(floor: _Floor, radius: float, configurations: Floats) -> Floats:
    return np.maximum(0.0, floor.gaps(shapely.points(configurations)) - radius)


def _polygon(floor: _Floor, corners: Floats, configurations: Floats) -> Floats:
    # Each pose turns and moves all corners at once: (poses, corners, 2).
    turned = np.einsum("nij,cj->nci", rotations(configurations[:, 2:], 2), corners) + configurations[:, None, :2]
    return floor.gaps(shapely.polygons(turned))
