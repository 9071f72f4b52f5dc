"""The compiled distance of a triangle from a solid or from another triangle: Gilbert, Johnson and Keerthi (1988).

The algorithm looks for the point v nearest to the origin in the difference of two convex sets A - B. For any direction
v at all, the least v · w / |v| over that difference is a lower bound of the distance: the width of the gap between two
parallel planes that separate the sets. Only this bound is ever reported. So whatever rounding or degenerate triangles
do to v, a reported distance is never too great by more than the rounding of one scalar product, about 1e-15 m.
"""

from typing import Any

import numpy as np

from lowlevel.compiled import inlined, subroutine
from problems.robots.arm import BOX, CYLINDER

POINT, TRIANGLE = 2, 3
"""Kinds of the second set beside `BOX` and `CYLINDER`: the origin (of a sphere, whose radius is subtracted later), and
a triangle."""
MOST_STEPS = 40
CONVERGED = 1e-10  # the relative difference of upper and lower bound of |v|² at which the search ends

GJK_ROOM = (8, 3)
"""The shape of the working array: rows 0 to 3 are the simplex; 4 to 6 may hold the second triangle."""


@inlined
def _on_segment(ax: Any, ay: Any, az: Any, bx: Any, by: Any, bz: Any) -> Any:
    """Return the point of a segment nearest to the origin, and which ends it lies between: bit 0 for a, 1 for b."""
    dx, dy, dz = bx - ax, by - ay, bz - az
    squared, along = dx * dx + dy * dy + dz * dz, -(ax * dx + ay * dy + az * dz)
    if along <= 0.0 or squared <= 0.0:
        return ax, ay, az, 1
    if along >= squared:
        return bx, by, bz, 2
    share = along / squared
    return ax + share * dx, ay + share * dy, az + share * dz, 3


@subroutine
def _on_triangle(ax: Any, ay: Any, az: Any, bx: Any, by: Any, bz: Any, cx: Any, cy: Any, cz: Any) -> Any:
    """Return the point of a triangle nearest to the origin, and which corners it lies between: bits 0 to 2.

    A triangle without an area is treated as its three edges.
    """
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    normal = nx * nx + ny * ny + nz * nz
    if normal > 1e-16 * (ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz):
        # Barycentric coordinates of the origin's projection, times |n|².
        of_a = nx * (by * cz - bz * cy) + ny * (bz * cx - bx * cz) + nz * (bx * cy - by * cx)
        of_b = nx * (cy * az - cz * ay) + ny * (cz * ax - cx * az) + nz * (cx * ay - cy * ax)
        of_c = nx * (ay * bz - az * by) + ny * (az * bx - ax * bz) + nz * (ax * by - ay * bx)
        if of_a > 0.0 and of_b > 0.0 and of_c > 0.0:
            height = (nx * ax + ny * ay + nz * az) / normal
            return nx * height, ny * height, nz * height, 7
    x, y, z, mask = _on_segment(ax, ay, az, bx, by, bz)
    best = x * x + y * y + z * z
    x1, y1, z1, mask1 = _on_segment(ax, ay, az, cx, cy, cz)
    squared = x1 * x1 + y1 * y1 + z1 * z1
    if squared < best:
        x, y, z, mask, best = x1, y1, z1, (mask1 & 1) | ((mask1 & 2) << 1), squared
    x1, y1, z1, mask1 = _on_segment(bx, by, bz, cx, cy, cz)
    if x1 * x1 + y1 * y1 + z1 * z1 < best:
        x, y, z, mask = x1, y1, z1, mask1 << 1
    return x, y, z, mask


@inlined
def _volume(simplex: Any, a: Any, b: Any, c: Any) -> Any:
    """Return six times the signed volume of the origin and three corners of the simplex."""
    return (
        simplex[a, 0] * (simplex[b, 1] * simplex[c, 2] - simplex[b, 2] * simplex[c, 1])
        + simplex[a, 1] * (simplex[b, 2] * simplex[c, 0] - simplex[b, 0] * simplex[c, 2])
        + simplex[a, 2] * (simplex[b, 0] * simplex[c, 1] - simplex[b, 1] * simplex[c, 0])
    )


@subroutine
def _in_tetrahedron(simplex: Any) -> Any:
    """Return whether the origin lies within the tetrahedron: all four volumes with the origin have the same sign."""
    one = _volume(simplex, 0, 1, 2)
    two = _volume(simplex, 0, 2, 3)
    three = _volume(simplex, 0, 3, 1)
    four = _volume(simplex, 1, 3, 2)
    return (one > 0.0 and two > 0.0 and three > 0.0 and four > 0.0) or (
        one < 0.0 and two < 0.0 and three < 0.0 and four < 0.0
    )


@inlined
def _on_face(simplex: Any, a: Any, b: Any, c: Any) -> Any:
    return _on_triangle(
        simplex[a, 0], simplex[a, 1], simplex[a, 2],
        simplex[b, 0], simplex[b, 1], simplex[b, 2],
        simplex[c, 0], simplex[c, 1], simplex[c, 2],
    )  # fmt: skip


@subroutine
def nearest_of_simplex(simplex: Any, size: Any) -> Any:
    """Return the point of the simplex nearest to the origin, and which corners it lies between (a bit each).

    The last corner is the newest: of a tetrahedron only the faces with this corner can be the nearest ones. A mask of
    15 means that the tetrahedron contains the origin.
    """
    if size == 1:
        return simplex[0, 0], simplex[0, 1], simplex[0, 2], 1
    if size == 2:
        return _on_segment(
            simplex[0, 0], simplex[0, 1], simplex[0, 2], simplex[1, 0], simplex[1, 1], simplex[1, 2]
        )  # fmt: skip
    if size == 3:
        return _on_face(simplex, 0, 1, 2)
    if _in_tetrahedron(simplex):
        return 0.0, 0.0, 0.0, 15
    x, y, z, mask = _on_face(simplex, 0, 1, 3)
    mask = (mask & 3) | ((mask & 4) << 1)
    best = x * x + y * y + z * z
    x1, y1, z1, mask1 = _on_face(simplex, 0, 2, 3)
    squared = x1 * x1 + y1 * y1 + z1 * z1
    if squared < best:
        x, y, z, mask, best = x1, y1, z1, (mask1 & 1) | ((mask1 & 6) << 1), squared
    x1, y1, z1, mask1 = _on_face(simplex, 1, 2, 3)
    if x1 * x1 + y1 * y1 + z1 * z1 < best:
        x, y, z, mask = x1, y1, z1, mask1 << 1
    return x, y, z, mask


@inlined
def keep_corners(simplex: Any, size: Any, mask: Any) -> Any:
    """Drop the corners that are not in the mask; return the number of those that remain."""
    count = 0
    for corner in range(size):
        if mask & (1 << corner):
            if count < corner:
                simplex[count, 0] = simplex[corner, 0]
                simplex[count, 1] = simplex[corner, 1]
                simplex[count, 2] = simplex[corner, 2]
            count += 1
    return count


@inlined
def farthest(kind: Any, a: Any, b: Any, c: Any, room: Any, x: Any, y: Any, z: Any) -> Any:
    """Return the point of the second set farthest in a direction."""
    if kind == BOX:
        return (a if x > 0.0 else -a), (b if y > 0.0 else -b), (c if z > 0.0 else -c)
    if kind == CYLINDER:
        across = np.sqrt(x * x + y * y)
        scale = a / across if across > 0.0 else 0.0
        return x * scale, y * scale, (c if z > 0.0 else -c)
    if kind == TRIANGLE:
        best, which = -np.inf, 4
        for corner in range(4, 7):
            along = room[corner, 0] * x + room[corner, 1] * y + room[corner, 2] * z
            if along > best:
                best, which = along, corner
        return room[which, 0], room[which, 1], room[which, 2]
    return 0.0, 0.0, 0.0


@subroutine
def separation(
    ax: Any, ay: Any, az: Any, bx: Any, by: Any, bz: Any, cx: Any, cy: Any, cz: Any,
    kind: Any, a: Any, b: Any, c: Any, enough: Any, touching: Any, room: Any,
) -> Any:  # fmt: skip
    """Return a lower bound of the distance of the triangle (a, b, c) from a convex set at the origin.

    The corners are ``ax`` to ``cz``, in the frame of the set, m. The ``kind`` is `BOX` with half sizes ``a``, ``b``,
    ``c``; `CYLINDER` with the radius ``a`` and half the length ``c``; `POINT`; or `TRIANGLE`, the one in rows 4 to 6 of
    ``room``. The search ends once the bound exceeds ``enough``, or once the distance is known not to exceed
    ``touching``. ``room`` is working memory of shape `GJK_ROOM`.

    Returns:
        the bound, m, never above the distance; 0 or less if they touch. If the distance lies between ``touching`` and
        ``enough``, the bound is within 1e-9 m of it, but for degenerate sets.
    """  # fmt: skip
    # The first direction leads from the centre of the second set to that of the triangle.
    x, y, z = (ax + bx + cx) / 3.0, (ay + by + cy) / 3.0, (az + bz + cz) / 3.0
    if kind == TRIANGLE:
        x -= (room[4, 0] + room[5, 0] + room[6, 0]) / 3.0
        y -= (room[4, 1] + room[5, 1] + room[6, 1]) / 3.0
        z -= (room[4, 2] + room[5, 2] + room[6, 2]) / 3.0
    elif kind == BOX:
        x, y, z = x - min(a, max(-a, x)), y - min(b, max(-b, y)), z - min(c, max(-c, z))
    length = np.sqrt(x * x + y * y + z * z)
    if length <= 0.0:
        x, length = 1e-3, 1e-3
    size, low, known = 0, -np.inf, False  # known: whether v is a point of the difference, so that |v| is an upper bound
    for _ in range(MOST_STEPS):
        # The corner of the triangle and the point of the set that are nearest to each other along v.
        along_a, along_b, along_c = ax * x + ay * y + az * z, bx * x + by * y + bz * z, cx * x + cy * y + cz * z
        wx, wy, wz = ax, ay, az
        if along_b < along_a:
            wx, wy, wz, along_a = bx, by, bz, along_b
        if along_c < along_a:
            wx, wy, wz = cx, cy, cz
        fx, fy, fz = farthest(kind, a, b, c, room, x, y, z)
        wx, wy, wz = wx - fx, wy - fy, wz - fz
        bound = (wx * x + wy * y + wz * z) / length
        low = max(low, bound)
        if low > enough or (known and length - bound <= CONVERGED * length):
            return low
        for corner in range(size):
            if room[corner, 0] == wx and room[corner, 1] == wy and room[corner, 2] == wz:
                return low  # no new corner: the search has converged as far as rounding allows
        room[size, 0], room[size, 1], room[size, 2] = wx, wy, wz
        size += 1
        nx, ny, nz, mask = nearest_of_simplex(room, size)
        if mask == 15:
            return min(low, 0.0)
        following = np.sqrt(nx * nx + ny * ny + nz * nz)
        if following <= touching or following <= 0.0 or (known and following >= length):
            return min(low, following)
        size = keep_corners(room, size, mask)
        x, y, z, length, known = nx, ny, nz, following, True
    return low
