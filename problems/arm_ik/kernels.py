"""The compiled fitness of coded arm configurations: forward kinematics, then collisions.

Arrays are allocated once per call, not once per configuration.

The table of an operator (see `genetics.operators`) holds, by place:

0. the bits of each angle, whether they are in Gray code, whether the arm must not touch itself;
1. link lengths (m), lowest angles and widths of the ranges (rad), shape (3, links);
2. base x, y and target x, y (m), the radius of a link plus clearance (m), the code steps in a range, and the least
   distance between the axes of links that are not neighbours (m);
3. and up: the four fields of `Obstacles`.

A clearance here is signed: the gap between two shapes or, if they overlap, minus the depth of the overlap. Two shapes
collide if their clearance is below a limit, which is the sum of their thicknesses less `CONTACT`. For bare links
(radius 0) the limit is negative: they may enter a polygon by up to `CONTACT`.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Fitness, Genomes
from genetics.bit_kernels import integers_of
from genetics.operators import FITNESS, Table
from lowlevel.compiled import kernel, subroutine
from lowlevel.pointers import integers, reals
from problems.plane import CONTACT

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_NOWHERE = (2.0, -1.0)  # an empty interval of [0, 1]


class Arm(NamedTuple):
    """An arm and its target."""

    lengths: Any  # (links,), m
    base: Any  # (2,), m
    target: Any  # (2,), m
    radius: Any  # m, the radius of a link plus the clearance
    apart: Any  # m, the least distance between the axes of links that are not neighbours
    self_collision: Any  # whether links that are not neighbours must not touch


class Obstacles(NamedTuple):
    """The obstacles (see `problems.plane.Shapes`)."""

    corners: Any  # (all corners, 2), m
    starts: Any  # (shapes + 1,)
    thickness: Any  # (shapes,), m
    boxes: Any  # (shapes, 4), m: x0, y0, x1, y1 of each shape


@subroutine
def gap_squared(px: Any, py: Any, ax: Any, ay: Any, bx: Any, by: Any) -> Any:
    """Return the squared distance of the point p from the segment ab, which may have the length 0."""
    dx, dy = bx - ax, by - ay
    length_squared = dx * dx + dy * dy
    share = 0.0
    if length_squared > 0.0:
        share = min(1.0, max(0.0, ((px - ax) * dx + (py - ay) * dy) / length_squared))
    ex, ey = ax + share * dx - px, ay + share * dy - py
    return ex * ex + ey * ey


@subroutine
def _side(px: Any, py: Any, ax: Any, ay: Any, bx: Any, by: Any) -> Any:
    """Return a number that is positive if p lies to the left of the line from a to b, negative if to the right."""
    return (bx - ax) * (py - ay) - (by - ay) * (px - ax)


@subroutine
def clearance(ax: Any, ay: Any, bx: Any, by: Any, cx: Any, cy: Any, dx: Any, dy: Any) -> Any:
    """Return the signed clearance of the segments ab and cd.

    The depth of a crossing is the distance of the end nearest to the other segment: so far it sticks out beyond it.
    """
    nearest = np.sqrt(
        min(
            gap_squared(ax, ay, cx, cy, dx, dy),
            gap_squared(bx, by, cx, cy, dx, dy),
            gap_squared(cx, cy, ax, ay, bx, by),
            gap_squared(dx, dy, ax, ay, bx, by),
        )
    )
    # The segments cross if the ends of each lie on different sides of the other.
    apart = (
        _side(ax, ay, cx, cy, dx, dy) * _side(bx, by, cx, cy, dx, dy) >= 0.0
        or _side(cx, cy, ax, ay, bx, by) * _side(dx, dy, ax, ay, bx, by) >= 0.0
    )
    return nearest if apart else -nearest


@subroutine
def _inside(px: Any, py: Any, corners: Any, first: Any, last: Any) -> Any:
    """Return whether p lies inside the polygon (even-odd rule); p must not be on its outline."""
    within = False
    previous = last - 1
    for corner in range(first, last):
        ax, ay = corners[previous, 0], corners[previous, 1]
        bx, by = corners[corner, 0], corners[corner, 1]
        if (ay > py) != (by > py) and px < ax + (py - ay) * (bx - ax) / (by - ay):
            within = not within
        previous = corner
    return within


@subroutine
def _clip(enter: Any, leave: Any, start: Any, slope: Any, low: Any, high: Any) -> Any:
    """Return the part of the interval [enter, leave] in which low <= start + slope * t <= high.

    If there is none, the first number returned is greater than the second.
    """
    if slope == 0.0:
        return (enter, leave) if low <= start <= high else _NOWHERE
    one, other = (low - start) / slope, (high - start) / slope
    return max(enter, min(one, other)), min(leave, max(one, other))


@subroutine
def _along_edge(ax: Any, ay: Any, bx: Any, by: Any, cx: Any, cy: Any, dx: Any, dy: Any, depth: Any) -> Any:
    """Return the interval of [0, 1] in which the points of ab are near the edge cd.

    Near means within a rectangle that reaches ``depth`` beyond cd on all sides.
    """
    length = np.hypot(dx - cx, dy - cy)
    if length == 0.0:
        return _NOWHERE
    ux, uy = (dx - cx) / length, (dy - cy) / length
    along, across = (ax - cx) * ux + (ay - cy) * uy, (ay - cy) * ux - (ax - cx) * uy
    along_slope, across_slope = (bx - ax) * ux + (by - ay) * uy, (by - ay) * ux - (bx - ax) * uy
    enter, leave = _clip(0.0, 1.0, across, across_slope, -depth, depth)
    return _clip(enter, leave, along, along_slope, -depth, length + depth)


@subroutine
def _enters(ax: Any, ay: Any, bx: Any, by: Any, corners: Any, first: Any, last: Any, depth: Any) -> Any:
    """Return whether the bare segment ab has a point inside the polygon that is deeper than ``depth``.

    Walk along ab from one stretch that is not near the outline to the next. Such a stretch does not cross the outline,
    so its middle tells whether all of it is inside.
    """
    at = 0.0
    while at < 1.0:  # all of ab before ``at`` is known to be outside, or near the outline
        until = 1.0
        near = False
        previous = last - 1
        for corner in range(first, last):
            cx, cy, dx, dy = corners[previous, 0], corners[previous, 1], corners[corner, 0], corners[corner, 1]
            enter, leave = _along_edge(ax, ay, bx, by, cx, cy, dx, dy, depth)
            previous = corner
            if enter <= at < leave:
                at, near = leave, True
            elif at < enter < until and enter <= leave:
                until = enter
        if near:
            continue
        middle = (at + until) / 2.0
        if _inside(ax + middle * (bx - ax), ay + middle * (by - ay), corners, first, last):
            return True
        at = until
    return False


@subroutine
def hits_polygon(ax: Any, ay: Any, bx: Any, by: Any, corners: Any, first: Any, last: Any, limit: Any) -> Any:
    """Return whether the clearance between the segment ab and a polygon is below ``limit``."""
    if limit <= 0.0:
        return _enters(ax, ay, bx, by, corners, first, last, -limit)
    previous = last - 1
    for corner in range(first, last):
        cx, cy, dx, dy = corners[previous, 0], corners[previous, 1], corners[corner, 0], corners[corner, 1]
        if clearance(ax, ay, bx, by, cx, cy, dx, dy) < limit:
            return True
        previous = corner
    # The segment keeps clear of the outline, so it is all inside or all outside.
    return _inside(ax, ay, corners, first, last)


@subroutine
def link_hits(ax: Any, ay: Any, bx: Any, by: Any, radius: Any, obstacles: Any) -> Any:
    """Return whether the link ab, thickened by ``radius``, collides with any obstacle."""
    corners, starts, thickness = obstacles.corners, obstacles.starts, obstacles.thickness
    left, right = min(ax, bx) - radius, max(ax, bx) + radius
    low, high = min(ay, by) - radius, max(ay, by) + radius
    for shape in range(thickness.size):
        box = obstacles.boxes[shape]  # a cheap test that excludes most obstacles
        if right < box[0] or high < box[1] or left > box[2] or low > box[3]:
            continue
        first, last = starts[shape], starts[shape + 1]
        limit = radius + thickness[shape] - CONTACT
        if last - first == 1:
            gap = gap_squared(corners[first, 0], corners[first, 1], ax, ay, bx, by)
            if limit > 0.0 and gap < limit * limit:
                return True
        elif hits_polygon(ax, ay, bx, by, corners, first, last, limit):
            return True
    return False


@subroutine
def touches_itself(joints: Any, apart: Any) -> Any:
    """Return whether the axes of two links that are not neighbours are nearer to each other than ``apart``, m."""
    limit = apart - CONTACT
    links = joints.shape[0] - 1
    for one in range(links - 2):
        ax, ay, bx, by = joints[one, 0], joints[one, 1], joints[one + 1, 0], joints[one + 1, 1]
        for other in range(one + 2, links):
            cx, cy, dx, dy = joints[other, 0], joints[other, 1], joints[other + 1, 0], joints[other + 1, 1]
            # Bounding boxes that are far enough apart exclude most pairs cheaply.
            if max(ax, bx) + limit < min(cx, dx) or max(cx, dx) + limit < min(ax, bx):
                continue
            if max(ay, by) + limit < min(cy, dy) or max(cy, dy) + limit < min(ay, by):
                continue
            if clearance(ax, ay, bx, by, cx, cy, dx, dy) < limit:
                return True
    return False


@subroutine
def place(joints: Any, angles: Any, links: Any) -> Any:
    """Compute forward kinematics: fill the rows of ``joints``, shape (links + 1, 2), after the first, the base."""
    heading = 0.0
    for link in range(links.size):
        heading += angles[link]
        joints[link + 1, 0] = joints[link, 0] + links[link] * np.cos(heading)
        joints[link + 1, 1] = joints[link, 1] + links[link] * np.sin(heading)


@subroutine
def _arm_of(table: Any) -> Any:
    self_collision, lengths, places = integers(table, 0)[0, 2] != 0, reals(table, 1)[0], reals(table, 2)[0]
    return Arm(lengths, places[:2], places[2:4], places[4], places[6], self_collision)


@subroutine
def _obstacles_of(table: Any) -> Any:
    return Obstacles(reals(table, 3), integers(table, 4)[0], reals(table, 5)[0], reals(table, 6))


@subroutine
def _turn(codes: Any, table: Any, angles: Any) -> Any:
    """Fill ``angles``, rad, with those that coded integers stand for; both have the shape (links,)."""
    joints, steps = reals(table, 1), reals(table, 2)[0, 5]
    for joint in range(codes.size):
        angles[joint] = joints[1, joint] + joints[2, joint] * codes[joint] / steps


@subroutine
def _distance(angles: Any, arm: Any, obstacles: Any, joints: Any) -> Any:
    """Return f(θ) of §3.1: the tip's distance to the target, m, or +inf in collision.

    ``joints`` is working memory for `place`; its first row must be the base.
    """
    place(joints, angles, arm.lengths)
    if arm.self_collision and touches_itself(joints, arm.apart):
        return np.inf
    for link in range(arm.lengths.size):
        ax, ay, bx, by = joints[link, 0], joints[link, 1], joints[link + 1, 0], joints[link + 1, 1]
        if link_hits(ax, ay, bx, by, arm.radius, obstacles):
            return np.inf
    return np.hypot(joints[-1, 0] - arm.target[0], joints[-1, 1] - arm.target[1])


@subroutine
def _joints_of(arm: Any) -> Any:
    """Return working memory for `place`."""
    joints = np.empty((arm.lengths.size + 1, 2))
    joints[0] = arm.base
    return joints


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Compute f(θ) of §3.1, m, for coded configurations."""
    layout, arm, obstacles = integers(table, 0)[0], _arm_of(table), _obstacles_of(table)
    codes, angles, joints = np.empty(arm.lengths.size, np.int64), np.empty(arm.lengths.size), _joints_of(arm)
    for row in range(fitness.size):
        integers_of(genomes[row], layout[0], layout[1] != 0, codes)
        _turn(codes, table, angles)
        fitness[row] = _distance(angles, arm, obstacles, joints)


@kernel("float64[::1](float64[:,::1], int64[:,::1])")
def distances(configurations: Floats, table: Table) -> Fitness:
    """Return f(θ) of §3.1, m, for joint angles, rad: (n, links) to (n,)."""
    arm, obstacles = _arm_of(table), _obstacles_of(table)
    joints = _joints_of(arm)
    fitness = np.empty(configurations.shape[0])
    for row in range(fitness.size):
        fitness[row] = _distance(configurations[row], arm, obstacles, joints)
    return fitness


@kernel("float64[:,::1](int64[:,::1], int64[:,::1])")
def configurations(codes: Integers, table: Table) -> Floats:
    """Return the joint angles, rad, that coded integers stand for: (n, links) to (n, links)."""
    angles = np.empty(codes.shape)
    for row in range(codes.shape[0]):
        _turn(codes[row], table, angles[row])
    return angles
