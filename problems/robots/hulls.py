"""Replace meshes of many triangles by convex hulls of their parts, which contain them and have few triangles.

Kernels test surfaces. Something inside a hull that touches the mesh might not touch the hull, so each hull has further
shells inside, `_SHELLS` apart: no ball of that diameter fits between them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from problems.robots.shapes import cut_to_size, hull_of

Floats = NDArray[np.float64]

MOST_TRIANGLES = 1500
"""Meshes of more triangles are replaced by hulls."""
_EXCESS = 0.015  # m, by which a hull may stick out of the mesh before the part is halved
_SAMPLE = 0.01  # m, the least distance of the samples by which that is measured
_SAMPLES_ALONG = 40  # the most samples along the length of a part
_DEEPEST = 4  # halvings of a mesh: at most 16 parts
_MOST_PLANES = 80  # of one hull
_PADDING = 1e-7  # m, against rounding in the intersection of planes
_DIRECTIONS = 48
_SHELLS = 0.02  # m, the least distance between a hull and the shells inside it
_MOST_SHELLS = 6


def simplified(soup: Floats) -> Floats:
    """Return triangles that contain a soup of triangles (n, 3, 3): itself if it is small, or hulls."""
    if len(soup) <= MOST_TRIANGLES:
        return soup
    return np.concatenate(list(_parts(soup, np.empty((0, 2)), _DEEPEST)))


def _parts(soup: Floats, cuts: Floats, left: int) -> Iterator[Floats]:
    """Yield the hull of a soup, or those of its halves where the hull is much larger than the mesh.

    Args:
        soup: the triangles.
        cuts: the planes at which it has been cut so far: axis and position, shape (n, 2).
        left: how often it may still be cut.
    """
    points = np.unique(soup.reshape(-1, 3), axis=0)
    if left == 0 or len(soup) < 8 or _excess(outer_hull(points), soup, cuts) <= _EXCESS:
        yield _with_shells(points)
        return
    centres = soup.mean(axis=1)
    axis = int(np.argmax(np.ptp(centres, axis=0)))
    at = float((centres[:, axis].min() + centres[:, axis].max()) / 2)
    first = centres[:, axis] < at
    cut = np.concatenate([cuts, [[axis, at]]])
    yield from _parts(soup[first], cut, left - 1)
    yield from _parts(soup[~first], cut, left - 1)


def _excess(hull: Floats, soup: Floats, cuts: Floats) -> float:
    """Return how far the hull's surface is from the mesh at most, m, but for where the mesh has been cut open."""
    from scipy.spatial import KDTree

    sample = max(_SAMPLE, float(np.ptp(hull.reshape(-1, 3), axis=0).max()) / _SAMPLES_ALONG)
    surface = cut_to_size(hull, 2 * sample).mean(axis=1)
    for axis, at in cuts:
        surface = surface[np.abs(surface[:, int(axis)] - at) > 2 * _EXCESS]
    if not len(surface):
        return 0.0
    fine = cut_to_size(soup, 2 * sample)
    distances, _ = KDTree(np.concatenate([fine.mean(axis=1), fine.reshape(-1, 3)])).query(surface)
    return float(distances.max()) - sample / 2


def outer_hull(points: Floats) -> Floats:
    """Return triangles of a convex polyhedron that contains points (n, 3) and has few faces."""
    return _hull_and_planes(points)[0]


def _hull_and_planes(points: Floats) -> tuple[Floats, Floats]:
    """Return the polyhedron of `outer_hull` and its planes (m, 4); none for points in a plane."""
    from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

    try:
        hull = ConvexHull(points)
        planes = _planes(hull)
        if len(planes) > _MOST_PLANES:
            planes = _fewer(hull, points, planes)
            middle = points[hull.vertices].mean(axis=0)
            return hull_of(HalfspaceIntersection(planes, middle).intersections), planes
    except (QhullError, ValueError):
        return hull_of(points), np.empty((0, 4))
    soup: Floats = points[hull.simplices]
    return soup, planes


def _with_shells(points: Floats) -> Floats:
    """Return the triangles of `outer_hull`, and of shells inside it."""
    from scipy.spatial import HalfspaceIntersection, QhullError

    hull, planes = _hull_and_planes(points)
    shells = [hull]
    if len(planes):
        middle, depth = _deepest(planes)
        apart = max(_SHELLS, depth / _MOST_SHELLS)
        for number in range(1, int(depth / apart) + 1):
            moved = planes + np.array([0.0, 0.0, 0.0, number * apart])
            try:
                shells.append(hull_of(HalfspaceIntersection(moved, middle).intersections))
            except (QhullError, ValueError):  # nothing, or next to nothing, is left inside
                break
    return np.concatenate(shells)


def _deepest(planes: Floats) -> tuple[Floats, float]:
    """Return the point within planes that is farthest from all of them, and its distance, m."""
    from scipy.optimize import linprog

    answer = linprog(
        [0.0, 0.0, 0.0, -1.0],
        np.concatenate([planes[:, :3], np.ones((len(planes), 1))], axis=1),
        -planes[:, 3],
        bounds=[(None, None)] * 3 + [(0.0, None)],
    )
    return (answer.x[:3], float(answer.x[3])) if answer.success else (np.zeros(3), 0.0)


def _planes(hull: Any) -> Floats:
    """Return the different planes of a hull, each a unit normal and the negative offset, shape (n, 4)."""
    equations: Floats = hull.equations
    _, first = np.unique(np.round(equations, 6), axis=0, return_index=True)
    return equations[np.sort(first)]


def _fewer(hull: Any, points: Floats, planes: Floats) -> Floats:
    """Return `_MOST_PLANES` planes around the points: the hull's largest faces and evenly spread directions."""
    equations, simplices = hull.equations, hull.simplices
    faces = points[simplices]
    areas = np.linalg.norm(np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]), axis=1)
    _, which = np.unique(np.round(equations, 6), axis=0, return_inverse=True)
    sums = np.bincount(which.reshape(-1), areas)
    _, first = np.unique(which.reshape(-1), return_index=True)
    largest = equations[first[np.argsort(-sums, kind="stable")[: _MOST_PLANES - _DIRECTIONS]], :3]
    normals = np.concatenate([largest, _spread(_DIRECTIONS)])
    corners = points[hull.vertices]
    heights = np.einsum("ij,kj->ik", normals, corners).max(axis=1)
    return np.concatenate([normals, -(heights + _PADDING)[:, None]], axis=1)


def _spread(count: int) -> Floats:
    """Return unit vectors spread evenly over the sphere, on a Fibonacci spiral."""
    number = np.arange(count) + 0.5
    z = 1.0 - 2.0 * number / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * number
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)
