"""The vehicle in its world as a scene of python-fcl, for `check`: does it meet anything on its way?

Nothing of configuration space is used here. In the plane outlines become walls of height 1. A disc is an upright line
with a thickness, a ball in space a point with a thickness, so both are exact. python-fcl only knows triangles, so lines
and points are triangles of negligible width.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import fcl
import numpy as np
from numpy.typing import NDArray

from problems.plane import Circle
from problems.sphere_path.pose import rotations

if TYPE_CHECKING:
    from problems.sphere_path.model import SpherePathModel

Floats = NDArray[np.float64]

TOLERANCE = 1e-6  # m: a smaller overlap of discs and balls, or lack of clearance, is no collision
_SLIMMEST = 1e-9  # m, the width of a line or a point
_SHORTEST = 1e-3  # the least step, as a share of the vehicle's reach; an obstacle grazed for less may go unseen


class World:
    """All obstacles, and the vehicle, which each query moves: use a world on one thread only."""

    def __init__(self, problem: SpherePathModel) -> None:
        vehicle, flat = problem.vehicle, problem.mesh is None
        assert vehicle is not None, "there is no world without a vehicle"
        self._dimensions = 2 if flat else 3
        self._obstacles: list[tuple[Any, float]] = []
        self._names: list[str | int] = [*range(len(problem.obstacles))]
        if problem.mesh is not None:
            self._names.append("mesh")
            self._obstacles.append((_body(problem.mesh.triangles), 0.0))
        for obstacle in problem.obstacles:
            if isinstance(obstacle, Circle):
                self._obstacles.append((_body(_line(*obstacle.center)), obstacle.radius))
            else:
                self._obstacles.append((_body(_walls(obstacle.corners)), 0.0))
        if vehicle.vertices is not None:
            shape = _walls(np.array(vehicle.vertices))
        elif vehicle.mesh is not None:
            shape = vehicle.mesh.triangles
        else:
            shape = _line(0.0, 0.0) if flat else _POINT
        self._vehicle, self._thickness = _body(shape), vehicle.radius or 0.0
        self.reach = vehicle.reach

    def clearance(self, configuration: Floats) -> float:
        """Return the gap to the nearest obstacle, m; negative in collision, -inf where surfaces intersect."""
        return min(self._gaps(configuration), default=np.inf)

    def nearest(self, configuration: Floats) -> str | int:
        """Return the nearest obstacle: its number, or ``"mesh"``.

        Raises:
            ValueError: If there are no obstacles.
        """
        return self._names[int(np.argmin(self._gaps(configuration)))]

    def _gaps(self, configuration: Floats) -> list[float]:
        """Return the gap to each obstacle, m."""
        turn, place = np.eye(3), np.zeros(3)
        dimensions = self._dimensions
        turn[:dimensions, :dimensions] = rotations(configuration[None, dimensions:], dimensions)[0]
        place[:dimensions] = configuration[:dimensions]
        self._vehicle.setTransform(fcl.Transform(turn, place))
        return [self._gap(*each) for each in self._obstacles]

    def _gap(self, body: Any, thickness: float) -> float:
        away = float(fcl.distance(self._vehicle, body, fcl.DistanceRequest(), fcl.DistanceResult()))
        # python-fcl reports 0 or less where surfaces intersect, which says nothing about the depth.
        return away - thickness - self._thickness if away > 0.0 else -np.inf

    def way(self, begin: Floats, end: Floats) -> float:
        """Return an upper bound of how far any point of the vehicle moves on a straight motion, m."""
        motion = end - begin
        # Several angles at once: each turns the farthest point by at most its own arc, so the sum of the arcs is a
        # bound.
        angles = np.abs(motion[self._dimensions :]).sum()
        return float(np.linalg.norm(motion[: self._dimensions]) + self.reach * angles)

    def contact(self, begin: Floats, end: Floats, clearance: float = 0.0) -> Floats | None:
        """Return the first configuration of a straight motion that is nearer to an obstacle than a clearance, m.

        Return None if there is none. Each step is as long as the gap that was left, so no point of the vehicle can come
        too near within it (conservative advancement). Steps have a least length, so that a motion along a surface ends.
        """
        motion, way, done = end - begin, self.way(begin, end), 0.0
        while True:
            configuration = begin + motion * (done / way if way > 0.0 else 0.0)
            gap = self.clearance(configuration) - clearance
            if gap < -TOLERANCE:
                return configuration
            if done >= way:
                return None
            done = min(way, done + max(gap, _SHORTEST * self.reach))


_POINT = _SLIMMEST * np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])


def _line(x: float, y: float) -> Floats:
    return np.array([[[x, y, 0.0], [x, y, 1.0], [x + _SLIMMEST, y, 1.0]]])


def _walls(corners: Floats) -> Floats:
    """Return two triangles above each edge of an outline, shape (2 edges, 3, 3)."""
    low = np.column_stack([corners, np.zeros(len(corners))])
    high = low + np.array([0.0, 0.0, 1.0])
    lower = np.stack([low, np.roll(low, -1, axis=0), high], axis=1)
    upper = np.stack([np.roll(low, -1, axis=0), np.roll(high, -1, axis=0), high], axis=1)
    return np.concatenate([lower, upper])


def _body(triangles: Floats) -> Any:
    corners = triangles.reshape(-1, 3)
    model = fcl.BVHModel()
    model.beginModel(len(corners), len(triangles))
    model.addSubModel(corners, np.arange(len(corners)).reshape(-1, 3))
    model.endModel()
    return fcl.CollisionObject(model)
