"""The gaps between a vehicle in space and an obstacle of triangles, for many poses at once.

A ball uses the nearest point of all triangles, a solid uses python-fcl. Solids are filled: a vehicle inside an
obstacle, or an obstacle inside a vehicle, has no gap.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lowlevel.compiled import kernel, subroutine
from problems.sphere_path.cells import Clearance
from problems.sphere_path.pose import rotations
from problems.sphere_path.vehicle import Vehicle
from problems.vectors import cross, difference, dot

Floats = NDArray[np.float64]


@subroutine
def _squared_to_edge(begin: Any, end: Any) -> Any:
    """Return the squared distance of the origin to a segment."""
    edge = difference(begin, end)
    squared = dot(edge, edge)
    share = min(1.0, max(0.0, -dot(begin, edge) / squared)) if squared > 0.0 else 0.0
    away = begin[0] + share * edge[0], begin[1] + share * edge[1], begin[2] + share * edge[2]
    return dot(away, away)


@subroutine
def _squared_to_triangle(a: Any, b: Any, c: Any) -> Any:
    """Return the squared distance of the origin to the triangle of three corners."""
    # The nearest point is on an edge, or it is the foot of the perpendicular on the triangle's plane.
    edges = min(_squared_to_edge(a, b), _squared_to_edge(b, c), _squared_to_edge(c, a))
    normal = cross(difference(a, b), difference(a, c))
    size = dot(normal, normal)
    # The origin lies above or below a triangle if it is on the inner side of each edge.
    if size > 0.0 and min(dot(cross(a, b), normal), dot(cross(b, c), normal), dot(cross(c, a), normal)) >= 0.0:
        return min(edges, dot(a, normal) ** 2 / size)
    return edges


@kernel("float64[::1](float64[:,::1], float64[:,:,::1])", may_be_long=True)
def signed_distances(points: Floats, triangles: Floats) -> Floats:
    """Return the distances of points, (n, 3), to the surface of a solid, (triangles, 3, 3); negative inside, (n,) m.

    A point is inside if the surface winds around it: the solid angles of its triangles, seen from the point (van
    Oosterom and Strackee 1983), add up to more than half of a sphere. The sum is 4π or 0 for a closed surface, so the
    threshold also bears small holes. Triangles may be oriented inwards or outwards.
    """
    distances = np.empty(points.shape[0])
    for row in range(points.shape[0]):
        point, squared, angle = points[row], np.inf, 0.0
        for number in range(triangles.shape[0]):
            triangle = triangles[number]
            a, b, c = difference(point, triangle[0]), difference(point, triangle[1]), difference(point, triangle[2])
            squared = min(squared, _squared_to_triangle(a, b, c))
            la, lb, lc = np.sqrt(dot(a, a)), np.sqrt(dot(b, b)), np.sqrt(dot(c, c))
            across = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
            angle += 2.0 * np.arctan2(dot(a, cross(b, c)), across)
        away = np.sqrt(squared)
        distances[row] = -away if abs(angle) > 2.0 * np.pi else away
    return distances


def in_space(vehicle: Vehicle, obstacle: Floats) -> Clearance:
    """Return the gaps of a ball at [x, y, z], or of a solid, which may turn, to an obstacle of triangles (n, 3, 3)."""
    if vehicle.radius is not None:
        return lambda configurations: _ball(obstacle, vehicle.radius or 0.0, configurations)
    assert vehicle.mesh is not None, "in space a vehicle is a ball or a mesh"
    return _Solid(vehicle.mesh.triangles, obstacle).clearance


def _ball(obstacle: Floats, radius: float, configurations: Floats) -> Floats:
    return np.maximum(0.0, signed_distances(np.ascontiguousarray(configurations), obstacle) - radius)


class _Solid:
    """A vehicle of triangles beside an obstacle of triangles."""

    def __init__(self, vehicle: Floats, obstacle: Floats) -> None:
        import fcl

        self.vehicle, self.obstacle = vehicle, obstacle
        self._moving = fcl.CollisionObject(surface(vehicle))
        self._still = fcl.CollisionObject(surface(obstacle))
        # python-fcl knows only surfaces. If no surfaces meet, each connected part lies inside the other solid entirely
        # or not at all, so one point of each part decides.
        self._own_parts, self._parts = parts(vehicle), parts(obstacle)

    def clearance(self, configurations: Floats) -> Floats:
        """Return the gaps at configurations, see `problems.sphere_path.cells.Clearance`."""
        turns = rotations(configurations[:, 3:], 3)
        places = configurations[:, :3]
        gaps = np.array([self._gap(turn, place) for turn, place in zip(turns, places, strict=True)])
        within = np.einsum("nij,pj->npi", turns, self._own_parts) + places[:, None]
        # The obstacle's points in the vehicle's frame, by the transposed rotations.
        around = np.einsum("nji,npj->npi", turns, self._parts - places[:, None])
        gaps[_any_in(within, self.obstacle) | _any_in(around, self.vehicle)] = 0.0
        return gaps

    def _gap(self, turn: Floats, place: Floats) -> float:
        import fcl

        self._moving.setTransform(fcl.Transform(turn, place))
        return max(0.0, float(fcl.distance(self._moving, self._still, fcl.DistanceRequest(), fcl.DistanceResult())))


def _any_in(points: Floats, solid: Floats) -> NDArray[np.bool_]:
    """Return for each group of points, (n, points, 3), whether any of them lies in a solid, (n,)."""
    distances = signed_distances(np.ascontiguousarray(points.reshape(-1, 3)), solid)
    found: NDArray[np.bool_] = np.any(distances.reshape(points.shape[:2]) < 0.0, axis=1)
    return found


def surface(triangles: Floats) -> Any:
    """Return triangles as a model of python-fcl."""
    import fcl

    corners, faces = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    model = fcl.BVHModel()
    model.beginModel(len(corners), len(triangles))
    model.addSubModel(corners, faces.reshape(-1, 3))
    model.endModel()
    return model


def parts(triangles: Floats) -> Floats:
    """Return one corner of each connected part of a surface, shape (parts, 3)."""
    # Each corner's label falls to the least label of its triangles, round by round, until nothing changes.
    corners, faces = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    faces = faces.reshape(-1, 3)
    label = np.arange(len(corners))
    while True:
        least = label[faces].min(axis=1)
        following = label.copy()
        np.minimum.at(following, faces.ravel(), np.repeat(least, 3))
        following = following[following]  # a label's own label: halves the length of chains in each round
        if np.array_equal(following, label):
            return corners[np.unique(label)]
        label = following
