"""Spheres within bounding spheres, coarse to fine: whole groups are skipped by one comparison.

In the order of a walk that goes from a bounding sphere to what it holds before it goes on: ``following`` says where to go
on from a sphere that is not near. A sphere that holds nothing is an obstacle; the next one follows it.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Cells
from genetics.compiled import kernel, subroutine

Floats = NDArray[np.float64]

_MARGIN = 1e-9  # by which a bounding sphere is larger than it must be, as a share: more than rounding


class Hierarchy(NamedTuple):
    """A binary tree of bounding spheres above ``n`` obstacles: 2 n − 1 spheres in all.

    Attributes:
        spheres: centre and radius, shape (spheres, axes + 1).
        following: what comes after all that a sphere holds, shape (spheres,).
    """

    spheres: Floats
    following: Cells


@subroutine
def _bound(spheres: Any, group: Any, bounding: Any) -> Any:
    """Fill in a sphere that holds a group; returns the axis along which the group's centres are farthest apart."""
    axes = bounding.size - 1
    widest, width = 0, -1.0
    for axis in range(axes):
        low, high, least, most = np.inf, -np.inf, np.inf, -np.inf
        for member in group:
            place, radius = spheres[member, axis], spheres[member, axes]
            low, high = min(low, place - radius), max(high, place + radius)
            least, most = min(least, place), max(most, place)
        bounding[axis] = 0.5 * (low + high)
        if most - least > width:
            widest, width = axis, most - least
    farthest = 0.0
    for member in group:
        squared = 0.0
        for axis in range(axes):
            squared += (spheres[member, axis] - bounding[axis]) ** 2
        farthest = max(farthest, np.sqrt(squared) + spheres[member, axes])
    bounding[axes] = farthest * (1.0 + _MARGIN)
    return widest


@kernel("int64[::1](float64[:,::1], float64[:,::1])")
def _fill(obstacles: Floats, spheres: Floats) -> Cells:
    """Fill in the tree's ``spheres``, halving each group along its widest axis; returns what follows each of them."""
    following = np.empty(spheres.shape[0], np.int64)
    order = np.arange(obstacles.shape[0])
    left = [(0, 0, obstacles.shape[0])]  # a place in the tree, and the group that belongs there
    while len(left) > 0:
        place, first, last = left.pop()
        following[place] = place + 2 * (last - first) - 1
        if last - first == 1:
            spheres[place] = obstacles[order[first]]
            continue
        group = order[first:last]
        axis = _bound(obstacles, group, spheres[place])
        order[first:last] = group[np.argsort(obstacles[group, axis], kind="mergesort")]
        middle = (first + last) // 2
        left.append((place + 1, first, middle))
        left.append((place + 2 * (middle - first), middle, last))
    return following


def hierarchy_of(obstacles: Floats) -> Hierarchy:
    """The tree above some spheres: centre and radius, shape (n, axes + 1)."""
    count = len(obstacles)
    spheres = np.empty((max(0, 2 * count - 1), obstacles.shape[1]))
    if count == 0:
        return Hierarchy(spheres, np.empty(0, np.int64))
    return Hierarchy(spheres, _fill(np.ascontiguousarray(obstacles, np.float64), spheres))
