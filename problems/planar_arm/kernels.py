"""The compiled kinematics and collisions of a planar arm among obstacles.

A clearance here is signed: the gap between two shapes or, if they overlap, minus the depth of the overlap. Two shapes
collide if their clearance is below a limit, which is the sum of their thicknesses less `CONTACT`. For bare links
(radius 0) the limit is negative: they may enter a polygon by up to `CONTACT`.
"""

from typing import Any, NamedTuple

import numpy as np

from lowlevel.compiled import subroutine
from problems.plane import CONTACT

_NOWHERE = (2.0, -1.0)  # an empty interval of [0, 1]


class Arm(NamedTuple):
    """The arm."""

    lengths: Any  # (links,), m
    base: Any  # (2,), m
    radius: Any  # m, the radius of a link plus the clearance
    apart: Any  # m, the least distance between the axes of links that are not neighbours
    self_collision: Any  # whether links that are not neighbours must not touch


class Obstacles(NamedTuple):
    """The obstacles (see `problems.plane.Shapes`)."""

    corners: Any  # (all corners, 2), m
    starts: Any  # (shapes + 1,)
    thickness: Any  # (shapes,), m


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
def hits(ax: Any, ay: Any, bx: Any, by: Any, corners: Any, first: Any, last: Any, limit: Any) -> Any:
    """Return whether the clearance between the segment ab and a shape is below ``limit``.

    A shape of one corner is a disc, of two a link, of more a polygon.
    """
    if last - first == 1:
        return limit > 0.0 and gap_squared(corners[first, 0], corners[first, 1], ax, ay, bx, by) < limit * limit
    if last - first == 2:
        cx, cy, dx, dy = corners[first, 0], corners[first, 1], corners[first + 1, 0], corners[first + 1, 1]
        return clearance(ax, ay, bx, by, cx, cy, dx, dy) < limit
    return hits_polygon(ax, ay, bx, by, corners, first, last, limit)


@subroutine
def link_hits(ax: Any, ay: Any, bx: Any, by: Any, radius: Any, obstacles: Any, boxes: Any) -> Any:
    """Return whether the link ab, thickened by ``radius``, collides with any obstacle.

    The bounding ``boxes`` of the shapes, x0, y0, x1, y1 each, m, exclude most of them cheaply.
    """
    corners, starts, thickness = obstacles.corners, obstacles.starts, obstacles.thickness
    left, right = min(ax, bx) - radius, max(ax, bx) + radius
    low, high = min(ay, by) - radius, max(ay, by) + radius
    for shape in range(thickness.size):
        box = boxes[shape]
        if right < box[0] or high < box[1] or left > box[2] or low > box[3]:
            continue
        first, last = starts[shape], starts[shape + 1]
        limit = radius + thickness[shape] - CONTACT
        if hits(ax, ay, bx, by, corners, first, last, limit):
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
