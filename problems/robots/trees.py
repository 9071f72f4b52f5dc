"""Trees of bounding spheres over triangles: compiled, deterministic, conservative by construction.

The sphere of a node contains every corner of every triangle under it, and so the triangles themselves. Centres and
radii are numbers of float32, so that they travel as such; radii are rounded up.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lowlevel.compiled import kernel, subroutine

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_MOST_OF_LEAF = 4  # triangles
_ROUNDS = 24  # of moving a centre towards the farthest corner
_SLACK = 1e-9  # m, against rounding in the distance of a corner
_LEANING = 0.1  # share of the triangles below which a half is too small, so that the tree is halved by numbers


def tree_of(soup: Floats, leaf_radius: float) -> tuple[Floats, Integers, Floats]:
    """Return spheres (S, 4), children (S, 2) and triangles (T, 9) of the tree over a soup (T, 3, 3).

    The root is sphere 0. Children and triangles are in the form of `problems.robots.arm.Arm`.

    Args:
        soup: the triangles, at least one.
        leaf_radius: the radius up to which a sphere may hold several triangles, m.
    """
    triangles = np.ascontiguousarray(soup.reshape(-1, 9))
    order = np.arange(len(triangles))
    spheres, children = np.empty((2 * len(triangles), 4)), np.empty((2 * len(triangles), 2), np.int64)
    count = grow(triangles, leaf_radius, order, spheres, children)
    return spheres[:count].copy(), children[:count].copy(), triangles[order]


@subroutine
def _farthest(triangles: Any, order: Any, first: Any, last: Any, centre: Any) -> Any:
    """Return the squared distance of the farthest corner from a centre, its triangle and its place in that."""
    most, which, place = -1.0, 0, 0
    for number in range(first, last):
        triangle = triangles[order[number]]
        for corner in range(0, 9, 3):
            x, y, z = triangle[corner] - centre[0], triangle[corner + 1] - centre[1], triangle[corner + 2] - centre[2]
            squared = x * x + y * y + z * z
            if squared > most:
                most, which, place = squared, order[number], corner
    return most, which, place


@subroutine
def _enclose(triangles: Any, order: Any, first: Any, last: Any, sphere: Any, centre: Any) -> None:
    """Fill the sphere that contains the triangles: a nearly smallest one (Bădoiu and Clarkson 2003)."""
    for axis in range(3):
        low, high = np.inf, -np.inf
        for number in range(first, last):
            for corner in range(axis, 9, 3):
                low, high = min(low, triangles[order[number], corner]), max(high, triangles[order[number], corner])
        centre[axis] = (low + high) / 2
    best = np.inf
    for round_ in range(_ROUNDS):
        squared, which, place = _farthest(triangles, order, first, last, centre)
        if squared < best:
            best = squared
            for axis in range(3):
                sphere[axis] = np.float64(np.float32(centre[axis]))
        for axis in range(3):
            centre[axis] += (triangles[which, place + axis] - centre[axis]) / (round_ + 3.0)
    squared, _, _ = _farthest(triangles, order, first, last, sphere)
    radius = np.sqrt(squared) + _SLACK
    rounded = np.float64(np.float32(radius))
    if rounded < radius:
        rounded = np.float64(np.float32(radius * (1.0 + 2.0**-23)))
    sphere[3] = rounded


@subroutine
def _halve(triangles: Any, order: Any, first: Any, last: Any, keys: Any) -> Any:
    """Reorder the triangles of a node and return where its second half begins."""
    longest, axis_of, low_of, high_of = -1.0, 0, 0.0, 0.0
    for axis in range(3):
        low, high = np.inf, -np.inf
        for number in range(first, last):
            triangle = triangles[order[number]]
            key = triangle[axis] + triangle[axis + 3] + triangle[axis + 6]
            low, high = min(low, key), max(high, key)
        if high - low > longest:
            longest, axis_of, low_of, high_of = high - low, axis, low, high
    for number in range(first, last):
        triangle = triangles[order[number]]
        keys[number] = triangle[axis_of] + triangle[axis_of + 3] + triangle[axis_of + 6]
    sorted_ = np.argsort(keys[first:last], kind="mergesort")
    moved = order[first:last][sorted_]
    middle, below = (low_of + high_of) / 2, 0
    for number in range(first, last):
        below += keys[number] < middle
    order[first:last] = moved
    count = last - first
    if below < _LEANING * count or below > (1.0 - _LEANING) * count:
        below = count // 2
    return first + below


@kernel("int64(float64[:,::1], float64, int64[::1], float64[:,::1], int64[:,::1])", may_be_long=True)
def grow(triangles: Floats, leaf_radius: float, order: Integers, spheres: Floats, children: Integers) -> int:
    """Fill the spheres and children of a tree, and the order of its triangles; return the number of spheres."""
    ranges = np.empty((spheres.shape[0], 2), np.int64)
    keys, centre = np.empty(order.size), np.empty(3)
    ranges[0, 0], ranges[0, 1] = 0, order.size
    count, node = 1, 0
    while node < count:
        first, last = ranges[node, 0], ranges[node, 1]
        _enclose(triangles, order, first, last, spheres[node], centre)
        size = last - first
        if size == 1 or (size <= _MOST_OF_LEAF and spheres[node, 3] <= leaf_radius):
            children[node, 0], children[node, 1] = -first - 1, size
        else:
            middle = _halve(triangles, order, first, last, keys)
            children[node, 0], children[node, 1] = count, 2
            ranges[count, 0], ranges[count, 1] = first, middle
            ranges[count + 1, 0], ranges[count + 1, 1] = middle, last
            count += 2
        node += 1
    return count
