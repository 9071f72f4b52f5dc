"""The compiled distance of the convex hull of a whole branch of a tree from a solid, or from that of another branch.

Two links that lie side by side have many pairs of triangles near to each other. One plane between their hulls settles
all of them. GJK (`problems.robots.gjk_kernels`) needs no hull, only the corner that is farthest in a direction; the
tree of spheres finds it.
"""

from typing import Any

import numpy as np

from lowlevel.compiled import subroutine
from problems.robots.gjk_kernels import CONVERGED, farthest, keep_corners, nearest_of_simplex

_MOST_STEPS = 8  # hulls that are apart are found to be so after one or two; others are not worth more
BRANCH = 4
"""The kind of the second set that is a branch of a tree."""


@subroutine
def _corner(
    spheres: Any, children: Any, triangles: Any, node: Any, x: Any, y: Any, z: Any, best: Any, stack: Any, base: Any
) -> Any:
    """Return the corner under a sphere that is farthest in a direction of length 1, and how far, if beyond ``best``.

    Entries of the stack from ``base`` on are overwritten.
    """
    bx, by, bz = 0.0, 0.0, 0.0
    stack[base], top = node, base + 1
    while top > base:
        top -= 1
        node = stack[top]
        reach = x * spheres[node, 0] + y * spheres[node, 1] + z * spheres[node, 2] + spheres[node, 3]
        if reach <= best:
            continue
        first, count = children[node, 0], children[node, 1]
        if first < 0:
            for number in range(-first - 1, -first - 1 + count):
                for corner in range(0, 9, 3):
                    cx, cy, cz = triangles[number, corner], triangles[number, corner + 1], triangles[number, corner + 2]
                    along = x * cx + y * cy + z * cz
                    if along > best:
                        best, bx, by, bz = along, cx, cy, cz
            continue
        if top + count > stack.size:
            return 0.0, 0.0, 0.0, np.inf
        farthest_, last = -np.inf, top
        for child in range(first, first + count):
            reach = x * spheres[child, 0] + y * spheres[child, 1] + z * spheres[child, 2] + spheres[child, 3]
            if reach > best:
                stack[top] = child
                if reach > farthest_:
                    farthest_, last = reach, top
                top += 1
        if last < top - 1:  # the most promising child is searched first
            stack[last], stack[top - 1] = stack[top - 1], stack[last]
    return bx, by, bz, best


@subroutine
def hull_separation(
    spheres: Any, children: Any, triangles: Any, node: Any, kind: Any, a: Any, b: Any, c: Any, other: Any,
    most: Any, room: Any, base: Any,
) -> Any:  # fmt: skip
    """Return whether a plane shows that a branch is farther than ``most`` from a convex set.

    Args:
        spheres: of the scene.
        children: of the scene.
        triangles: of the scene.
        node: the sphere above the branch. ``room.pose`` is its body in the frame of the set.
        kind: of the set: as in `separation`, or `BRANCH`.
        a: half a size of the set, as the next two, if it is a solid.
        b: see above.
        c: see above.
        other: the sphere above the other branch.
        most: m.
        room: of `problems.robots.tree_kernels`.
        base: the first free entry of the stack.
    """  # fmt: skip
    p, simplex, stack = room.pose, room.gjk, room.stack
    p0, p1, p2, p3, p4, p5 = p[0], p[1], p[2], p[3], p[4], p[5]
    p6, p7, p8, p9, p10, p11 = p[6], p[7], p[8], p[9], p[10], p[11]
    # The first direction leads from the set to the centre of the branch.
    sx, sy, sz = spheres[node, 0], spheres[node, 1], spheres[node, 2]
    x, y, z = p0 * sx + p1 * sy + p2 * sz + p3, p4 * sx + p5 * sy + p6 * sz + p7, p8 * sx + p9 * sy + p10 * sz + p11
    if kind == BRANCH:
        x, y, z = x - spheres[other, 0], y - spheres[other, 1], z - spheres[other, 2]
    elif kind == 0:
        x, y, z = x - min(a, max(-a, x)), y - min(b, max(-b, y)), z - min(c, max(-c, z))
    length = np.sqrt(x * x + y * y + z * z)
    if length <= 0.0:
        return False
    size, known = 0, False
    for _ in range(_MOST_STEPS):
        x, y, z = x / length, y / length, z / length
        # The corner of the branch that is least far along v.
        tx, ty, tz, _ = _corner(
            spheres,
            children,
            triangles,
            node,
            -(p0 * x + p4 * y + p8 * z),
            -(p1 * x + p5 * y + p9 * z),
            -(p2 * x + p6 * y + p10 * z),
            -np.inf,
            stack,
            base,
        )
        wx, wy, wz = (
            p0 * tx + p1 * ty + p2 * tz + p3,
            p4 * tx + p5 * ty + p6 * tz + p7,
            p8 * tx + p9 * ty + p10 * tz + p11,
        )
        if kind == BRANCH:
            fx, fy, fz, _ = _corner(spheres, children, triangles, other, x, y, z, -np.inf, stack, base)
        else:
            fx, fy, fz = farthest(kind, a, b, c, simplex, x, y, z)
        wx, wy, wz = wx - fx, wy - fy, wz - fz
        bound = wx * x + wy * y + wz * z
        if bound > most:
            return True
        if known and length - bound <= CONVERGED * length:
            return False
        simplex[size, 0], simplex[size, 1], simplex[size, 2] = wx, wy, wz
        size += 1
        x, y, z, mask = nearest_of_simplex(simplex, size)
        following = np.sqrt(x * x + y * y + z * z)
        if mask == 15 or following <= most or following <= 0.0 or (known and following >= length):
            return False
        size = keep_corners(simplex, size, mask)
        length, known = following, True
    return False
