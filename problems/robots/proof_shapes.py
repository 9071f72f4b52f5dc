"""Geometry of the proof: coal shapes of ``<collision>`` elements, obstacles and attached things.

Nothing here is used by planners, and only the decoder of meshes is shared with them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput
from problems.robots.meshes import mesh_of

Floats = NDArray[np.float64]
Table = Mapping[str, Any]

GJK_ERROR = 2e-6
"""The most by which a distance between convex shapes, as coal computes it, may exceed the true distance, m."""

_ON_HULL = 1e-6  # m: a mesh this close to its hull everywhere is convex
_SAME_AREA = 1e-3  # the share by which the areas of a convex mesh and of its hull may differ


@dataclass(frozen=True, eq=False)
class Shape:
    """A rigid shape.

    Attributes:
        name: the name of its link, obstacle or attached thing, for messages.
        placement: its pose in the frame of the link, or of the world for obstacles, a 4×4 matrix.
        exact: the coal geometry: a primitive, a convex mesh, or a tree of triangles.
        hull: convex geometry that contains ``exact``; the same object where that is convex.
        centre: the centre of a bounding sphere in the shape's own frame, m.
        radius: the radius of that sphere, m.
        corners: points in the shape's own frame whose convex hull contains it, up to ``rounding``, m, shape (n, 3).
        rounding: how far the shape reaches beyond the hull of ``corners``, m.
        is_mesh: whether it is a mesh.
        triangles: the triangles of a closed mesh that is not convex, m, shape (n, 3, 3); None for any other shape.
            coal knows such a mesh only as a surface: what is wholly inside touches nothing.
    """

    name: str
    placement: Floats
    exact: Any
    hull: Any
    centre: Floats
    radius: float
    corners: Floats
    rounding: float = 0.0
    is_mesh: bool = False
    triangles: Floats | None = field(default=None, repr=False)

    @property
    def is_convex(self) -> bool:
        """Whether `hull` is the shape itself."""
        return self.exact is self.hull

    def contains(self, point: Floats) -> bool:
        """Return whether a point, in the shape's own frame, is inside a closed mesh that is not convex."""
        return self.triangles is not None and _is_inside(self.triangles, point)


def pose(position: Any, quaternion: Any) -> Floats:
    """Return a 4×4 matrix of a position, m, and a quaternion x, y, z, w, which need not have length 1."""
    x, y, z, w = np.asarray(quaternion, float) / np.linalg.norm(quaternion)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = position
    return matrix


def pose_of(table: Table) -> Floats:
    """Return the pose of a table of the problem file with ``position`` and ``quaternion``, a 4×4 matrix."""
    return pose(table.get("position") or (0.0, 0.0, 0.0), table.get("quaternion") or (0.0, 0.0, 0.0, 1.0))


def origin_of(element: ElementTree.Element) -> Floats:
    """Return the pose of a URDF element's ``<origin>``: rotations about fixed axes x, y and z, a 4×4 matrix."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    roll, pitch, yaw = _numbers(origin.get("rpy", "0 0 0"))
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    matrix = np.eye(4)
    matrix[:3, :3] = about_z @ about_y @ about_x
    matrix[:3, 3] = _numbers(origin.get("xyz", "0 0 0"))
    return matrix


def shapes_of_links(urdf: ElementTree.Element, meshes: dict[str, str]) -> list[tuple[str, Shape]]:
    """Return the name of the link and the shape of every ``<collision>`` element of a URDF.

    Raises:
        BadInput: if a geometry is of an unknown form, or its mesh is missing.
    """
    found = []
    for link in urdf.findall("link"):
        name = str(link.get("name"))
        for collision in link.findall("collision"):
            geometry = collision.find("geometry")
            if geometry is not None and len(geometry):
                found.append((name, _shape_of_element(name, geometry[0], origin_of(collision), meshes)))
    return found


def _shape_of_element(name: str, element: ElementTree.Element, placement: Floats, meshes: dict[str, str]) -> Shape:
    match element.tag:
        case "box":
            return box(name, placement, _numbers(element.get("size", "")))
        case "cylinder" | "capsule":
            lengths = float(element.get("radius", "nan")), float(element.get("length", "nan"))
            return (cylinder if element.tag == "cylinder" else capsule)(name, placement, *lengths)
        case "sphere":
            return sphere(name, placement, float(element.get("radius", "nan")))
        case "mesh":
            x, y, z = _numbers(element.get("scale", "1 1 1"))
            return mesh(name, placement, *mesh_of(meshes, str(element.get("filename")), (x, y, z)))
    raise BadInput(f"robot.urdf: link {name}: expected a box, cylinder, sphere, capsule or mesh, found {element.tag}")


def shape_of_table(name: str, table: Table, meshes: dict[str, str]) -> Shape:
    """Return the shape of an obstacle or of an attached thing, placed as its table says.

    Raises:
        BadInput: if its shape is unknown, or its mesh is missing.
    """
    placement = pose_of(table)
    match table["shape"]:
        case "box":
            return box(name, placement, table["size"])
        case "cylinder":
            return cylinder(name, placement, table["radius"], table["length"])
        case "sphere":
            return sphere(name, placement, table["radius"])
        case "mesh":
            x, y, z = table.get("scale") or (1.0, 1.0, 1.0)
            return mesh(name, placement, *mesh_of(meshes, table["file"], (x, y, z)))
    raise BadInput(f"{name}: expected a box, cylinder, sphere or mesh, found {table['shape']}")


def box(name: str, placement: Floats, size: Any) -> Shape:
    """Return a box with edges of the lengths ``size``, m, about its centre."""
    import coal

    half = np.asarray(size, float) / 2.0
    corners = half * (np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T)
    solid = coal.Box(*(2.0 * half))
    return Shape(name, placement, solid, solid, np.zeros(3), float(np.linalg.norm(half)), corners)


def cylinder(name: str, placement: Floats, radius: float, length: float) -> Shape:
    """Return a cylinder about the z axis, from -length / 2 to length / 2, m."""
    import coal

    solid = coal.Cylinder(radius, length)
    # The cylinder lies within its axis rounded by the radius.
    ends = np.array([[0.0, 0.0, -length / 2.0], [0.0, 0.0, length / 2.0]])
    return Shape(name, placement, solid, solid, np.zeros(3), float(np.hypot(radius, length / 2.0)), ends, radius)


def capsule(name: str, placement: Floats, radius: float, length: float) -> Shape:
    """Return a capsule about the z axis; the centres of its ends are ``length`` apart, m."""
    import coal

    solid = coal.Capsule(radius, length)
    ends = np.array([[0.0, 0.0, -length / 2.0], [0.0, 0.0, length / 2.0]])
    return Shape(name, placement, solid, solid, np.zeros(3), length / 2.0 + radius, ends, radius)


def sphere(name: str, placement: Floats, radius: float) -> Shape:
    """Return a sphere about the origin."""
    import coal

    solid = coal.Sphere(radius)
    return Shape(name, placement, solid, solid, np.zeros(3), radius, np.zeros((1, 3)), radius)


def mesh(name: str, placement: Floats, vertices: Floats, triangles: NDArray[np.int64]) -> Shape:
    """Return a mesh: a solid if it is convex, else the surface of its triangles.

    Args:
        name: the name of its link or obstacle.
        placement: its pose, a 4×4 matrix.
        vertices: m, shape (n, 3).
        triangles: three indices of vertices each, shape (n, 3).
    """
    import coal

    tree = coal.BVHModelOBBRSS()
    tree.beginModel(len(triangles), len(vertices))
    tree.addVertices(vertices)
    tree.addTriangles(triangles)
    tree.endModel()
    tree.computeLocalAABB()
    used = vertices[np.unique(triangles)]
    hull, corners, is_convex = _hull_of(used, vertices[triangles])
    if hull is None:  # flat: coal makes no hull of it, and the triangles are tested themselves
        hull = tree
    centre = (used.min(axis=0) + used.max(axis=0)) / 2.0
    radius = float(np.linalg.norm(used - centre, axis=1).max())
    closed = None if is_convex or not _is_closed(vertices, triangles) else vertices[triangles]
    return Shape(name, placement, hull if is_convex else tree, hull, centre, radius, corners, 0.0, True, closed)


def _hull_of(points: Floats, triangles: Floats) -> tuple[Any, Floats, bool]:
    """Return the convex hull of points as coal geometry, its corners, and whether the triangles are its whole surface.

    The hull is None where the points lie in a plane.
    """
    import coal
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:
        return None, points, False
    corners = points[hull.vertices]
    several = coal.StdVec_Vec3s()
    for corner in corners:
        several.append(corner)
    solid = coal.Convex.convexHull(several, True, None)
    middles = triangles.mean(axis=1)
    depth = np.full(len(middles), np.inf)
    for first in range(0, len(hull.equations), 256):  # in parts: a mesh of 20,000 triangles would take gigabytes
        plane = hull.equations[first : first + 256]
        depth = np.minimum(depth, -(middles @ plane[:, :3].T + plane[:, 3]).max(axis=1))
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1).sum()
    is_whole = abs(area / 2.0 - hull.area) <= _SAME_AREA * hull.area
    return solid, corners, bool(is_whole and depth.max() <= _ON_HULL)


def _is_closed(vertices: Floats, triangles: NDArray[np.int64]) -> bool:
    """Return whether every edge belongs to two triangles, once vertices at the same place count as one."""
    _, place = np.unique(vertices, axis=0, return_inverse=True)
    corners = place.reshape(-1)[triangles]
    edges = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return bool(np.all(counts == 2))


def _is_inside(triangles: Floats, point: Floats) -> bool:
    """Return whether a ray from the point crosses an odd number of triangles (Möller and Trumbore 1997)."""
    direction = np.array([0.5773, 0.5151, 0.6337])  # along no axis or diagonal, so that it hits no edge of a CAD model
    one, other, begin = (
        triangles[:, 1] - triangles[:, 0],
        triangles[:, 2] - triangles[:, 0],
        point - triangles[:, 0],
    )
    normal = np.cross(direction, other)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / np.einsum("ij,ij->i", one, normal)
        u = np.einsum("ij,ij->i", begin, normal) * scale
        across = np.cross(begin, one)
        v = across @ direction * scale
        along = np.einsum("ij,ij->i", other, across) * scale
        hits = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (along > 0.0)
    return bool(np.count_nonzero(hits) % 2)


def _numbers(text: str) -> list[float]:
    return [float(each) for each in text.split()]
