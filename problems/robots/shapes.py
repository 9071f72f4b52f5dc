"""Triangles that contain a primitive shape, and the cutting of triangles to a size. All functions are pure.

A soup of triangles has shape (n, 3, 3): corner by corner, in metres.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_EXCESS = 1e-3  # m, by which the corners of a triangulated round shape may stick out
_FEWEST, _MOST = 12, 64  # sides of a triangulated circle


def placed(placement: Floats, points: Floats) -> Floats:
    """Return points (.., 3) moved by a row-major 3×4 placement, shape (12,)."""
    matrix = placement.reshape(3, 4)
    # Written out, as a product by BLAS may differ in its last bits from one processor to another.
    moved: Floats = np.einsum("ij,...j->...i", matrix[:, :3], points) + matrix[:, 3]
    return moved


def chained(one: Floats, other: Floats) -> Floats:
    """Return the placement ``one`` followed by ``other`` (in its frame), shape (12,)."""
    first, second = one.reshape(3, 4), other.reshape(3, 4)
    turn = np.einsum("ij,jk->ik", first[:, :3], second[:, :3])
    place = np.einsum("ij,j->i", first[:, :3], second[:, 3]) + first[:, 3]
    product: Floats = np.concatenate([turn, place[:, None]], axis=1).reshape(12)
    return product


def primitive(shape: str, size: tuple[float, ...]) -> Floats:
    """Return triangles that contain a box, cylinder, sphere or capsule about its centre; see `Geometry.size`."""
    if shape == "box":
        return box(size)
    if shape == "cylinder":
        return cylinder(*size)
    if shape == "sphere":
        return sphere(*size)
    radius, length = size
    round_end = sphere(radius).reshape(-1, 3)
    shift = np.array([0.0, 0.0, length / 2])
    # The hull of two shapes that contain the spheres contains the hull of the spheres, which is the capsule.
    return hull_of(np.concatenate([round_end + shift, round_end - shift]))


def box(size: tuple[float, ...]) -> Floats:
    """Return the twelve triangles of a box with these full lengths."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * np.array(size)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triple for a, b, c, d in sides for triple in ((a, b, c), (a, c, d))]
    soup: Floats = corners[np.array(faces)]
    return soup


def cylinder(radius: float, length: float) -> Floats:
    """Return the triangles of a prism around a cylinder along z."""
    sides = int(np.clip(math.ceil(math.pi / math.acos(radius / (radius + _EXCESS))), _FEWEST, _MOST))
    angles = 2.0 * np.pi * np.arange(sides) / sides
    outer = radius / math.cos(math.pi / sides)
    ring = np.stack([outer * np.cos(angles), outer * np.sin(angles), np.full(sides, length / 2)], axis=1)
    top, bottom = ring, ring * [1.0, 1.0, -1.0]
    after = np.roll(np.arange(sides), -1)
    fan = np.arange(1, sides - 1)
    return np.concatenate(
        [
            np.stack([bottom, bottom[after], top], axis=1),
            np.stack([top, bottom[after], top[after]], axis=1),
            np.stack([np.broadcast_to(top[0], (sides - 2, 3)), top[fan], top[fan + 1]], axis=1),
            np.stack([np.broadcast_to(bottom[0], (sides - 2, 3)), bottom[fan + 1], bottom[fan]], axis=1),
        ]
    )


def sphere(radius: float) -> Floats:
    """Return the triangles of a polyhedron around a sphere."""
    soup = _icosahedron()
    for _ in range(1 if radius < 0.02 else 2):
        one, two, three = soup[:, 0], soup[:, 1], soup[:, 2]
        a, b, c = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (one + two, two + three, three + one))
        soup = np.concatenate([np.stack(each, axis=1) for each in ((one, a, c), (two, b, a), (three, c, b), (a, b, c))])
    normals = np.cross(soup[:, 1] - soup[:, 0], soup[:, 2] - soup[:, 0])
    nearest = np.abs((normals * soup[:, 0]).sum(axis=1)) / np.linalg.norm(normals, axis=1)
    larger: Floats = soup * (radius / nearest.min())
    return larger


def _icosahedron() -> Floats:
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    points = [
        [point[axis], point[(axis + 1) % 3], point[(axis + 2) % 3]]
        for axis in range(3)
        for point in [(0.0, one, other * golden) for one in (-1.0, 1.0) for other in (-1.0, 1.0)]
    ]
    return hull_of(np.array(points) / math.sqrt(1.0 + golden * golden))


def hull_of(points: Floats) -> Floats:
    """Return the triangles of the convex hull of points (n, 3), or of their box where they lie in a plane."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        low, high = points.min(axis=0) - 1e-6, points.max(axis=0) + 1e-6
        soup: Floats = box(tuple(high - low)) + (low + high) / 2
        return soup
    faces: Floats = points[hull.simplices]
    return faces


def cut_to_size(soup: Floats, longest: float) -> Floats:
    """Return the same surface as triangles with no edge longer than ``longest``, m."""
    done = []
    while len(soup):
        edges = np.linalg.norm(soup - np.roll(soup, -1, axis=1), axis=2)
        side = np.argmax(edges, axis=1)
        small = edges[np.arange(len(soup)), side] <= longest
        done.append(soup[small])
        large, side = soup[~small], side[~small]
        rows = np.arange(len(large))
        # Turn each triangle so that its longest edge is the first, and halve that.
        one, two, three = (large[rows, (side + corner) % 3] for corner in range(3))
        middle = (one + two) / 2
        soup = np.concatenate([np.stack([one, middle, three], axis=1), np.stack([middle, two, three], axis=1)])
    return np.concatenate(done) if done else np.empty((0, 3, 3))
