"""The compiled search of the trees of pieces: the distance of a piece from a solid, and of two pieces.

Spheres that are far enough apart end a branch; triangles under spheres that are not are compared exactly
(`problems.robots.gjk_kernels`). Both give lower bounds of distances.
"""

from typing import Any, NamedTuple

import numpy as np

from lowlevel.compiled import inlined, subroutine
from problems.robots.arm import SPHERE
from problems.robots.gjk_kernels import GJK_ROOM, TRIANGLE, separation
from problems.robots.hull_kernels import BRANCH, hull_separation
from problems.robots.solid_kernels import distance_from_solid

_LARGE = 0.015
"""Radius, m, from which on the hull of a branch is worth a test of its own before its spheres are searched."""
_PATIENCE = 24  # steps of a search before such tests begin
_DEEP = 4096  # entries of the stack of a search
_LINE = (0.2672612419124244, 0.5345224838248488, 0.8017837257372732)  # a unit vector along no edge that a drawing has


class TreeRoom(NamedTuple):
    """The working arrays of a search; each search overwrites them."""

    stack: Any  # (_DEEP,): spheres, or pairs of spheres, that are still to be searched
    pose: Any  # (12,): a body in the frame of a solid or of another body
    gjk: Any  # the working array of `separation`


@subroutine
def make_tree_room() -> Any:
    """Return working arrays for a search."""
    return TreeRoom(np.empty(_DEEP, np.int64), np.empty(12), np.empty(GJK_ROOM))


@inlined
def into_solid(solid: Any, frame: Any, pose: Any) -> Any:
    """Fill the placement of a body in the frame of a solid."""
    dx, dy, dz = frame[3] - solid[10], frame[7] - solid[11], frame[11] - solid[12]
    for row in range(3):
        a, b, c = solid[1 + 3 * row], solid[2 + 3 * row], solid[3 + 3 * row]
        for column in range(3):
            pose[4 * row + column] = a * frame[column] + b * frame[4 + column] + c * frame[8 + column]
        pose[4 * row + 3] = a * dx + b * dy + c * dz


@inlined
def into_body(frame: Any, other: Any, pose: Any) -> Any:
    """Fill the placement of the body ``other`` in the frame of a body."""
    dx, dy, dz = other[3] - frame[3], other[7] - frame[7], other[11] - frame[11]
    for row in range(3):
        a, b, c = frame[row], frame[4 + row], frame[8 + row]
        for column in range(3):
            pose[4 * row + column] = a * other[column] + b * other[4 + column] + c * other[8 + column]
        pose[4 * row + 3] = a * dx + b * dy + c * dz


@subroutine
def _triangle_from_solid(
    triangle: Any, pose: Any, kind: Any, a: Any, b: Any, c: Any, most: Any, stop: Any, gjk: Any
) -> Any:
    """Return a lower bound of the distance of a triangle from a solid; no more than needed to exceed ``most``."""
    p0, p1, p2, p3, p4, p5 = pose[0], pose[1], pose[2], pose[3], pose[4], pose[5]
    p6, p7, p8, p9, p10, p11 = pose[6], pose[7], pose[8], pose[9], pose[10], pose[11]
    x, y, z = triangle[0], triangle[1], triangle[2]
    ax, ay, az = p0 * x + p1 * y + p2 * z + p3, p4 * x + p5 * y + p6 * z + p7, p8 * x + p9 * y + p10 * z + p11
    x, y, z = triangle[3], triangle[4], triangle[5]
    bx, by, bz = p0 * x + p1 * y + p2 * z + p3, p4 * x + p5 * y + p6 * z + p7, p8 * x + p9 * y + p10 * z + p11
    x, y, z = triangle[6], triangle[7], triangle[8]
    cx, cy, cz = p0 * x + p1 * y + p2 * z + p3, p4 * x + p5 * y + p6 * z + p7, p8 * x + p9 * y + p10 * z + p11
    # The axes of the solid separate most triangles that are apart from it.
    beyond = max(
        max(min(ax, bx, cx), -max(ax, bx, cx)) - a,
        max(min(ay, by, cy), -max(ay, by, cy)) - b,
        max(min(az, bz, cz), -max(az, bz, cz)) - c,
    )
    if beyond > most:
        return beyond
    # A corner within the solid settles most of the others.
    nearest = min(
        distance_from_solid(kind, ax, ay, az, a, b, c),
        distance_from_solid(kind, bx, by, bz, a, b, c),
        distance_from_solid(kind, cx, cy, cz, a, b, c),
    )
    if nearest <= stop:
        return nearest
    radius = a if kind == SPHERE else 0.0
    bound = separation(
        ax, ay, az, bx, by, bz, cx, cy, cz, kind, a, b, c, most + radius, stop + radius, gjk
    ) - radius  # fmt: skip
    return max(bound, beyond)


@subroutine
def piece_from_solid(
    spheres: Any, children: Any, triangles: Any, root: Any, solid: Any, room: Any, most: Any, stop: Any
) -> Any:
    """Return a lower bound of the distance of a piece from a solid, or infinity if it exceeds ``most``.

    The search ends at the first distance up to ``stop``. ``room.pose`` is the body in the solid's frame.
    """
    pose, stack = room.pose, room.stack
    kind, a, b, c = np.int64(solid[0]), solid[13], solid[14], solid[15]
    radius = a if kind == SPHERE else 0.0
    p0, p1, p2, p3, p4, p5 = pose[0], pose[1], pose[2], pose[3], pose[4], pose[5]
    p6, p7, p8, p9, p10, p11 = pose[6], pose[7], pose[8], pose[9], pose[10], pose[11]
    stack[0], top, least, steps = root, 1, np.inf, 0
    while top > 0:
        top -= 1
        node = stack[top]
        first, count = children[node, 0], children[node, 1]
        if first < 0:
            for number in range(-first - 1, -first - 1 + count):
                bound = _triangle_from_solid(triangles[number], pose, kind, a, b, c, most, stop, room.gjk)
                if bound <= most:
                    most = least = bound
                    if bound <= stop:
                        return bound
            continue
        if top + count > stack.size:
            return -np.inf  # no room: taken for contact, which is safe
        steps += 1
        if (
            steps > _PATIENCE
            and spheres[node, 3] > _LARGE
            and hull_separation(spheres, children, triangles, node, kind, a, b, c, 0, most + radius, room, top)
        ):
            continue
        nearest, last = np.inf, top
        for child in range(first, first + count):
            x, y, z = spheres[child, 0], spheres[child, 1], spheres[child, 2]
            away = distance_from_solid(
                kind,
                p0 * x + p1 * y + p2 * z + p3,
                p4 * x + p5 * y + p6 * z + p7,
                p8 * x + p9 * y + p10 * z + p11,
                a,
                b,
                c,
            )
            away -= spheres[child, 3]
            if away <= most:
                stack[top] = child
                if away < nearest:
                    nearest, last = away, top
                top += 1
        if last < top - 1:  # the nearest child is searched first
            stack[last], stack[top - 1] = stack[top - 1], stack[last]
    return least


@inlined
def _load(triangle: Any, pose: Any, gjk: Any) -> Any:
    """Put a triangle into rows 4 to 6 of GJK's working array, in another frame."""
    for corner in range(3):
        x, y, z = triangle[3 * corner], triangle[3 * corner + 1], triangle[3 * corner + 2]
        for axis in range(3):
            gjk[4 + corner, axis] = (
                pose[4 * axis] * x + pose[4 * axis + 1] * y + pose[4 * axis + 2] * z + pose[4 * axis + 3]
            )


@subroutine
def _leaf_from_leaf(
    triangles: Any, one: Any, ones: Any, other: Any, others: Any, room: Any, most: Any, stop: Any
) -> Any:
    """Return a lower bound of the least distance of triangles of two leaves, or infinity if it exceeds ``most``."""
    gjk, least = room.gjk, np.inf
    for second in range(other, other + others):
        _load(triangles[second], room.pose, gjk)
        for first in range(one, one + ones):
            t = triangles[first]
            bound = separation(
                t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8], TRIANGLE, 0.0, 0.0, 0.0, most, stop, gjk
            )
            if bound <= most:
                most = least = bound
                if bound <= stop:
                    return bound
    return least


@subroutine
def piece_from_piece(
    spheres: Any, children: Any, triangles: Any, one: Any, other: Any, room: Any, most: Any, stop: Any
) -> Any:
    """Return a lower bound of the distance of two pieces, given by their roots, or infinity if it exceeds ``most``.

    ``room.pose`` is the body of the other piece in the frame of the first one's.
    """
    pose, stack = room.pose, room.stack
    p0, p1, p2, p3, p4, p5 = pose[0], pose[1], pose[2], pose[3], pose[4], pose[5]
    p6, p7, p8, p9, p10, p11 = pose[6], pose[7], pose[8], pose[9], pose[10], pose[11]
    stack[0], stack[1], top, least, steps = one, other, 2, np.inf, 0
    while top > 0:
        top -= 2
        left, right = stack[top], stack[top + 1]
        left_leaf, right_leaf = children[left, 0] < 0, children[right, 0] < 0
        if left_leaf and right_leaf:
            bound = _leaf_from_leaf(
                triangles,
                -children[left, 0] - 1,
                children[left, 1],
                -children[right, 0] - 1,
                children[right, 1],
                room,
                most,
                stop,
            )
            if bound <= most:
                most = least = bound
                if bound <= stop:
                    return bound
            continue
        steps += 1
        if (
            steps > _PATIENCE
            and min(spheres[left, 3], spheres[right, 3]) > _LARGE
            and hull_separation(spheres, children, triangles, right, BRANCH, 0.0, 0.0, 0.0, left, most, room, top)
        ):
            continue
        # The larger sphere is replaced by its children.
        opens_left = right_leaf or (not left_leaf and spheres[left, 3] >= spheres[right, 3])
        opened = left if opens_left else right
        first, count = children[opened, 0], children[opened, 1]
        if top + 2 * count > stack.size:
            return -np.inf
        nearest, last = np.inf, top
        for child in range(first, first + count):
            if opens_left:
                left = child
            else:
                right = child
            x, y, z = spheres[right, 0], spheres[right, 1], spheres[right, 2]
            dx = p0 * x + p1 * y + p2 * z + p3 - spheres[left, 0]
            dy = p4 * x + p5 * y + p6 * z + p7 - spheres[left, 1]
            dz = p8 * x + p9 * y + p10 * z + p11 - spheres[left, 2]
            away = np.sqrt(dx * dx + dy * dy + dz * dz) - spheres[left, 3] - spheres[right, 3]
            if away <= most:
                stack[top], stack[top + 1] = left, right
                if away < nearest:
                    nearest, last = away, top
                top += 2
        if last < top - 2:
            stack[last], stack[top - 2] = stack[top - 2], stack[last]
            stack[last + 1], stack[top - 1] = stack[top - 1], stack[last + 1]
    return least


@inlined
def _crossing(t: Any, x: Any, y: Any, z: Any) -> Any:
    """Return where the line from a point along `_LINE` crosses a triangle (0: it does not), and from which side: ±1."""
    ux, uy, uz = t[3] - t[0], t[4] - t[1], t[5] - t[2]
    vx, vy, vz = t[6] - t[0], t[7] - t[1], t[8] - t[2]
    # Möller and Trumbore (1997).
    px, py, pz = _LINE[1] * vz - _LINE[2] * vy, _LINE[2] * vx - _LINE[0] * vz, _LINE[0] * vy - _LINE[1] * vx
    volume = ux * px + uy * py + uz * pz
    if volume == 0.0:
        return 0.0, 0
    x, y, z = x - t[0], y - t[1], z - t[2]
    one = (x * px + y * py + z * pz) / volume
    qx, qy, qz = y * uz - z * uy, z * ux - x * uz, x * uy - y * ux
    other = (_LINE[0] * qx + _LINE[1] * qy + _LINE[2] * qz) / volume
    if one < 0.0 or other < 0.0 or one + other > 1.0:
        return 0.0, 0
    return (vx * qx + vy * qy + vz * qz) / volume, (1 if volume > 0.0 else -1)


@subroutine
def contains(spheres: Any, children: Any, triangles: Any, root: Any, x: Any, y: Any, z: Any, stack: Any) -> Any:
    """Return whether the surface of a piece encloses a point, in the frame of its body.

    A line through the point crosses a closed surface an odd number of times on either side. Where several closed
    surfaces overlap, it leaves them more often than it enters them. An open surface, as of a box without a lid,
    encloses nothing unless both sides of the line say so.
    """
    before, after, out_before, out_after = 0, 0, 0, 0
    stack[0], top = root, 1
    while top > 0:
        top -= 1
        sphere = spheres[stack[top]]
        dx, dy, dz = sphere[0] - x, sphere[1] - y, sphere[2] - z
        along = dx * _LINE[0] + dy * _LINE[1] + dz * _LINE[2]
        if dx * dx + dy * dy + dz * dz - along * along > sphere[3] * sphere[3] + 1e-12:
            continue
        first, count = children[stack[top], 0], children[stack[top], 1]
        if first >= 0:
            if top + count > stack.size:
                return True
            for child in range(first, first + count):
                stack[top] = child
                top += 1
            continue
        for number in range(-first - 1, -first - 1 + count):
            where, side = _crossing(triangles[number], x, y, z)
            if where > 0.0:
                after += 1
                out_after += side
            elif where < 0.0:
                before += 1
                out_before += side
    return (before % 2 == 1 and after % 2 == 1) or (out_before != 0 and out_after != 0)


@subroutine
def first_corner(children: Any, triangles: Any, root: Any) -> Any:
    """Return a point on the surface of a piece, in the frame of its body."""
    while children[root, 0] >= 0:
        root = children[root, 0]
    corner = triangles[-children[root, 0] - 1]
    return corner[0], corner[1], corner[2]


@subroutine
def solid_is_within(spheres: Any, children: Any, triangles: Any, root: Any, solid: Any, room: Any) -> Any:
    """Return whether a piece encloses the centre of a solid that may fit into it.

    Where the surfaces do not meet, the whole solid is enclosed then. ``room.pose`` is the body in the solid's frame.
    """
    pose, sphere = room.pose, spheres[root]
    x = pose[0] * sphere[0] + pose[1] * sphere[1] + pose[2] * sphere[2] + pose[3]
    y = pose[4] * sphere[0] + pose[5] * sphere[1] + pose[6] * sphere[2] + pose[7]
    z = pose[8] * sphere[0] + pose[9] * sphere[1] + pose[10] * sphere[2] + pose[11]
    half = max(solid[13], solid[14], solid[15])
    if x * x + y * y + z * z + half * half > sphere[3] * sphere[3]:
        return False  # the usual case: one end of the solid sticks out of the root
    return contains(
        spheres,
        children,
        triangles,
        root,
        -pose[0] * pose[3] - pose[4] * pose[7] - pose[8] * pose[11],
        -pose[1] * pose[3] - pose[5] * pose[7] - pose[9] * pose[11],
        -pose[2] * pose[3] - pose[6] * pose[7] - pose[10] * pose[11],
        room.stack,
    )


@subroutine
def piece_is_within(spheres: Any, children: Any, triangles: Any, one: Any, other: Any, room: Any) -> Any:
    """Return whether one of two pieces, given by their roots, encloses a corner of the other one."""
    p = room.pose
    x, y, z = first_corner(children, triangles, other)
    x, y, z = (
        p[0] * x + p[1] * y + p[2] * z + p[3],
        p[4] * x + p[5] * y + p[6] * z + p[7],
        p[8] * x + p[9] * y + p[10] * z + p[11],
    )
    if _is_in_sphere(spheres[one], x, y, z) and contains(
        spheres, children, triangles, one, x, y, z, room.stack
    ):  # fmt: skip
        return True
    x, y, z = first_corner(children, triangles, one)
    x, y, z = x - p[3], y - p[7], z - p[11]
    x, y, z = (
        p[0] * x + p[4] * y + p[8] * z,
        p[1] * x + p[5] * y + p[9] * z,
        p[2] * x + p[6] * y + p[10] * z,
    )
    return _is_in_sphere(spheres[other], x, y, z) and contains(
        spheres, children, triangles, other, x, y, z, room.stack
    )  # fmt: skip


@inlined
def _is_in_sphere(sphere: Any, x: Any, y: Any, z: Any) -> Any:
    x, y, z = x - sphere[0], y - sphere[1], z - sphere[2]
    return x * x + y * y + z * z <= sphere[3] * sphere[3]
