"""A tree of bounding spheres above the obstacles, so that one comparison skips a whole group.

The tree is stored in the order of a depth-first walk. So a walk needs no stack: from a bounding sphere that is near it
goes to the next place, from one that is not it goes to ``following``, behind all that the sphere holds. The leaves are
groups of obstacles, stored axis by axis, so that a processor compares several at once.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Cells
from lowlevel.compiled import kernel, subroutine

Floats = NDArray[np.float64]

TOGETHER = 64
"""The number of obstacles of a leaf: together they cost about as much as a few bounding spheres."""

_MARGIN = 1e-9  # the share by which bounding spheres are larger than needed; rounding errors are smaller


class Hierarchy(NamedTuple):
    """A binary tree of bounding spheres above groups of obstacles.

    Attributes:
        spheres: The bounding spheres, centre and radius, shape (spheres, axes + 1).
        following: The place after all that a bounding sphere holds, shape (spheres,). At a leaf it is the next place.
        group: The number of the group of obstacles at a leaf; -1 at other places.
        obstacles: For each group a row of centres for each axis and a row of squared radii, shape
            (groups · (axes + 1), TOGETHER). Unused places have the squared radius 0, so nothing ever crosses them.
    """

    spheres: Floats
    following: Cells
    group: Cells
    obstacles: Floats


@subroutine
def _bound(obstacles: Any, members: Any, bounding: Any) -> Any:
    """Fill a sphere that holds the given obstacles; return the axis along which their centres are farthest apart."""
    axes = bounding.size - 1
    widest, width = 0, -1.0
    for axis in range(axes):
        low, high, least, most = np.inf, -np.inf, np.inf, -np.inf
        for member in members:
            place, radius = obstacles[member, axis], obstacles[member, axes]
            low, high = min(low, place - radius), max(high, place + radius)
            least, most = min(least, place), max(most, place)
        # The middle of the box around the spheres: not the least bounding sphere, but one found in a single pass.
        bounding[axis] = 0.5 * (low + high)
        if most - least > width:
            widest, width = axis, most - least
    farthest = 0.0
    for member in members:
        squared = 0.0
        for axis in range(axes):
            squared += (obstacles[member, axis] - bounding[axis]) ** 2
        farthest = max(farthest, np.sqrt(squared) + obstacles[member, axes])
    bounding[axes] = farthest * (1.0 + _MARGIN)
    return widest


@kernel("void(float64[:,::1], float64[:,::1], int64[::1], int64[::1], float64[:,::1])")
def _fill(obstacles: Floats, spheres: Floats, following: Cells, group: Cells, grouped: Floats) -> None:
    """Fill a tree, dividing the obstacles into halves along the axis on which they are farthest apart."""
    rows = spheres.shape[1]
    order = np.arange(obstacles.shape[0])
    # Subtrees still to be filled: the place of the root, the first group and the end of the groups. A subtree of n
    # groups takes 2 n - 1 places. Halves are whole groups, so that only the last group of all may be partly filled.
    left = [(0, 0, (obstacles.shape[0] + TOGETHER - 1) // TOGETHER)]
    while len(left) > 0:
        place, first, last = left.pop()
        members = order[first * TOGETHER : last * TOGETHER]
        axis = _bound(obstacles, members, spheres[place])
        following[place] = place + 2 * (last - first) - 1
        if last - first == 1:
            group[place] = first
            for lane in range(members.size):
                for row in range(rows - 1):
                    grouped[first * rows + row, lane] = obstacles[members[lane], row]
                grouped[first * rows + rows - 1, lane] = obstacles[members[lane], rows - 1] ** 2
        else:
            group[place] = -1
            members[:] = members[np.argsort(obstacles[members, axis], kind="mergesort")]
            middle = (first + last + 1) // 2
            left.append((place + 1, first, middle))
            left.append((place + 2 * (middle - first), middle, last))


def hierarchy_of(obstacles: Floats) -> Hierarchy:
    """Return the tree above some spheres: centre and radius, shape (n, axes + 1)."""
    groups, rows = -(-len(obstacles) // TOGETHER), obstacles.shape[1]
    count = max(0, 2 * groups - 1)
    tree = Hierarchy(
        np.empty((count, rows)),
        np.empty(count, np.int64),
        np.empty(count, np.int64),
        np.zeros((groups * rows, TOGETHER)),
    )
    if count:
        _fill(np.ascontiguousarray(obstacles, np.float64), *tree)
    return tree
