"""Compiled legal ranges of a joint while the others stand still: one slice of configuration space, in closed form.

The links beyond the joint turn around it as a rigid body. A collision of a link with a shape can begin or end only at
an angle at which their thickened outlines touch, and these angles have closed forms. Between two consecutive ones
nothing changes, so one test in the middle decides for the whole interval. The ranges are therefore exact, up to
`CONTACT` and rounding.

Collisions among the links before the joint, or among those beyond it, are not tested: their relative positions do not
change. Callers must ask only for free configurations, in which these links do not collide.
"""

from typing import Any, NamedTuple

import numpy as np

from lowlevel.compiled import subroutine
from problems.planar_arm.kernels import gap_squared, hits, place
from problems.plane import CONTACT

FULL_TURN = 2.0 * np.pi
MOST_RANGES = 16
"""The most ranges of a slice. If there are more, the narrowest are dropped, which is safe: they count as blocked."""

_NARROWEST = 1e-12  # rad; a smaller distance between two contacts is rounding


class Room(NamedTuple):
    """Working memory; `room_needed` returns its sizes."""

    joints: Any  # (links + 1, 2), m: with the moving joint at angle 0
    contacts: Any  # (n,), rad: of one link with one shape
    blocked: Any  # (n, 2), rad: of all links and shapes


def room_needed(links: int, corners: list[int]) -> tuple[int, int]:
    """Return the greatest number of contacts of a link with a shape, and of blocked ranges in all.

    Args:
        links: the number of links.
        corners: the number of corners of each obstacle.
    """
    per_corner = 16  # 4 with the two ends of a link, 8 of these with an edge, 4 with the sides of the link
    shapes = [*corners, *(2 for _ in range(links))]  # the arm's other links are shapes of two corners
    return per_corner * max(shapes), links * sum(per_corner * each + 1 for each in shapes)


@subroutine
def _add(contacts: Any, count: Any, angle: Any) -> Any:
    """Append an angle, brought into [0, 2π), and return the new count."""
    contacts[count] = angle - FULL_TURN * np.floor(angle / FULL_TURN)
    return count + 1


@subroutine
def _meet_corners(contacts: Any, count: Any, px: Any, py: Any, cx: Any, cy: Any, limit: Any) -> Any:
    """Append the angles at which the distance of the turning point p from the fixed point c is ``limit``.

    Points are relative to the pivot. Returns the new count.
    """
    reach, away = np.hypot(px, py), np.hypot(cx, cy)
    if reach == 0.0 or away == 0.0:
        return count
    # The law of cosines in the triangle of the pivot, p and c.
    cosine = (reach * reach + away * away - limit * limit) / (2.0 * reach * away)
    if abs(cosine) > 1.0:
        return count
    bearing, half = np.arctan2(cy, cx) - np.arctan2(py, px), np.arccos(cosine)
    return _add(contacts, _add(contacts, count, bearing + half), bearing - half)


@subroutine
def _meet_side(
    contacts: Any, count: Any, px: Any, py: Any, cx: Any, cy: Any, dx: Any, dy: Any, limit: Any, sense: Any
) -> Any:
    """Append the angles at which the turning point p is at the distance ``limit`` beside the segment cd.

    With ``sense`` -1, p is fixed and cd turns. Points are relative to the pivot. Returns the new count.
    """
    reach, length = np.hypot(px, py), np.hypot(dx - cx, dy - cy)
    if reach == 0.0 or length == 0.0:
        return count
    ux, uy = (dx - cx) / length, (dy - cy) / length
    across, along = cy * ux - cx * uy, cx * ux + cy * uy
    normal, bearing = np.arctan2(ux, -uy), np.arctan2(py, px)
    for side in range(-1, 2, 2):
        cosine = (across + side * limit) / reach
        if abs(cosine) > 1.0:
            continue
        half = np.arccos(cosine)
        for way in range(-1, 2, 2):
            angle = normal + way * half
            at = reach * (np.cos(angle) * ux + np.sin(angle) * uy) - along
            if 0.0 <= at <= length:
                count = _add(contacts, count, sense * (angle - bearing))
    return count


@subroutine
def _contacts(
    contacts: Any, px: Any, py: Any, qx: Any, qy: Any, corners: Any, first: Any, last: Any, pivot: Any, limit: Any
) -> Any:
    """Collect all angles at which the turning segment pq may begin or cease to touch a shape; return their count."""
    count = 0
    previous = last - 1
    for corner in range(first, last):
        cx, cy = corners[previous, 0] - pivot[0], corners[previous, 1] - pivot[1]
        dx, dy = corners[corner, 0] - pivot[0], corners[corner, 1] - pivot[1]
        previous = corner
        count = _meet_corners(contacts, count, px, py, dx, dy, limit)
        count = _meet_corners(contacts, count, qx, qy, dx, dy, limit)
        count = _meet_side(contacts, count, dx, dy, px, py, qx, qy, limit, -1.0)
        if last - first > 2 or (last - first == 2 and corner == first):  # two corners have one edge, one has none
            count = _meet_side(contacts, count, px, py, cx, cy, dx, dy, limit, 1.0)
            count = _meet_side(contacts, count, qx, qy, cx, cy, dx, dy, limit, 1.0)
    return count


@subroutine
def _hits_when_turned(
    angle: Any, px: Any, py: Any, qx: Any, qy: Any, corners: Any, first: Any, last: Any, pivot: Any, limit: Any
) -> Any:
    """Return whether the segment pq, turned around the pivot by an angle, is nearer to a shape than ``limit``."""
    cosine, sine = np.cos(angle), np.sin(angle)
    ax, ay = pivot[0] + cosine * px - sine * py, pivot[1] + sine * px + cosine * py
    bx, by = pivot[0] + cosine * qx - sine * qy, pivot[1] + sine * qx + cosine * qy
    return hits(ax, ay, bx, by, corners, first, last, limit)


@subroutine
def _sort(values: Any, count: Any) -> Any:
    """Sort the first ``count`` values; there are few of them, so insertion sort is fastest."""
    for place_ in range(1, count):
        value, hole = values[place_], place_
        while hole > 0 and values[hole - 1] > value:
            values[hole] = values[hole - 1]
            hole -= 1
        values[hole] = value


@subroutine
def _block(blocked: Any, count: Any, low: Any, high: Any) -> Any:
    """Insert a range into those sorted by ``low``, and return the new count."""
    hole = count
    while hole > 0 and blocked[hole - 1, 0] > low:
        blocked[hole, 0], blocked[hole, 1] = blocked[hole - 1, 0], blocked[hole - 1, 1]
        hole -= 1
    blocked[hole, 0], blocked[hole, 1] = low, high
    return count + 1


@subroutine
def _out_of_reach(
    px: Any, py: Any, qx: Any, qy: Any, corners: Any, first: Any, last: Any, pivot: Any, limit: Any
) -> Any:
    """Return whether the ring that the segment pq sweeps in a full turn is clear of a shape."""
    reach = max(np.hypot(px, py), np.hypot(qx, qy)) + limit
    hollow = np.sqrt(gap_squared(0.0, 0.0, px, py, qx, qy)) - limit
    nearest, farthest = np.inf, 0.0
    previous = last - 1
    for corner in range(first, last):
        cx, cy, dx, dy = corners[previous, 0], corners[previous, 1], corners[corner, 0], corners[corner, 1]
        previous = corner
        nearest = min(nearest, gap_squared(pivot[0], pivot[1], cx, cy, dx, dy))
        farthest = max(farthest, (dx - pivot[0]) ** 2 + (dy - pivot[1]) ** 2)
    return np.sqrt(nearest) > reach or np.sqrt(farthest) < hollow


@subroutine
def _block_by(
    room: Any,
    count: Any,
    px: Any,
    py: Any,
    qx: Any,
    qy: Any,
    corners: Any,
    first: Any,
    last: Any,
    limit: Any,
    pivot: Any,
) -> Any:
    """Add the ranges in which the segment pq, which turns around the pivot, hits a shape; return the new count."""
    touching = max(0.0, limit)  # for bare links, contacts are those of the outlines themselves
    if _out_of_reach(px, py, qx, qy, corners, first, last, pivot, touching):
        return count
    contacts, blocked = room.contacts, room.blocked
    touches = _contacts(contacts, px, py, qx, qy, corners, first, last, pivot, touching)
    if touches == 0:  # then the segment collides at every angle, or at none
        if _hits_when_turned(0.0, px, py, qx, qy, corners, first, last, pivot, limit):
            return _block(blocked, count, 0.0, FULL_TURN)
        return count
    _sort(contacts, touches)
    for touch in range(touches):
        low = contacts[touch]
        high = contacts[touch + 1] if touch + 1 < touches else contacts[0] + FULL_TURN  # the last one goes around
        if high - low < _NARROWEST:
            continue
        if _hits_when_turned((low + high) / 2.0, px, py, qx, qy, corners, first, last, pivot, limit):
            count = _block(blocked, count, low, min(high, FULL_TURN))
            if high > FULL_TURN:
                count = _block(blocked, count, 0.0, high - FULL_TURN)
    return count


@subroutine
def _keep(ranges: Any, count: Any, low: Any, high: Any) -> Any:
    """Append a range and return the new count. If there is no room, drop the narrowest range."""
    if count < ranges.shape[0]:
        ranges[count, 0], ranges[count, 1] = low, high
        return count + 1
    narrowest = 0
    for place_ in range(1, count):
        if ranges[place_, 1] - ranges[place_, 0] < ranges[narrowest, 1] - ranges[narrowest, 0]:
            narrowest = place_
    if ranges[narrowest, 1] - ranges[narrowest, 0] < high - low:
        ranges[narrowest, 0], ranges[narrowest, 1] = low, high
    return count


@subroutine
def _rest(blocked: Any, count: Any, ranges: Any) -> Any:
    """Fill ``ranges`` with what the blocked ranges leave of the circle, and return their count.

    A range that contains 0 ends beyond 2π. If nothing is blocked, the only range is infinite.
    """
    if count == 0:
        return _keep(ranges, 0, -np.inf, np.inf)
    kept, free_from = 0, 0.0
    first_low = blocked[0, 0]
    for place_ in range(count):
        if blocked[place_, 0] > free_from > 0.0:  # what is free before the first one belongs to the last range
            kept = _keep(ranges, kept, free_from, blocked[place_, 0])
        free_from = max(free_from, blocked[place_, 1])
    if free_from < FULL_TURN or first_low > 0.0:
        kept = _keep(ranges, kept, free_from, FULL_TURN + first_low)
    return kept


@subroutine
def legal_ranges(joint: Any, angles: Any, arm: Any, obstacles: Any, room: Any, ranges: Any) -> Any:
    """Fill ``ranges``, shape (most, 2), with the legal ranges of a joint while the others stand at ``angles``, rad.

    Each range begins in [0, 2π] and may end beyond 2π. Joint limits are not considered. Returns the count.
    """
    joints, links = room.joints, arm.lengths.size
    joints[0, 0], joints[0, 1] = arm.base[0], arm.base[1]
    stood = angles[joint]
    angles[joint] = 0.0
    place(joints, angles, arm.lengths)
    angles[joint] = stood
    pivot = joints[joint]
    count = 0
    for link in range(joint, links):
        px, py = joints[link, 0] - pivot[0], joints[link, 1] - pivot[1]
        qx, qy = joints[link + 1, 0] - pivot[0], joints[link + 1, 1] - pivot[1]
        for shape in range(obstacles.thickness.size):
            first, last = obstacles.starts[shape], obstacles.starts[shape + 1]
            limit = arm.radius + obstacles.thickness[shape] - CONTACT
            count = _block_by(room, count, px, py, qx, qy, obstacles.corners, first, last, limit, pivot)
        if arm.self_collision:
            limit = arm.apart - CONTACT
            for other in range(min(joint, link - 1)):  # links that stand still and are not neighbours of this one
                count = _block_by(room, count, px, py, qx, qy, joints, other, other + 2, limit, pivot)
    return _rest(room.blocked, count, ranges)


@subroutine
def stays(ranges: Any, count: Any, angle: Any, turn: Any) -> Any:
    """Return whether a joint that stands at ``angle`` and turns by ``turn``, rad, stays in one of its legal ranges."""
    begin = angle - FULL_TURN * np.floor(angle / FULL_TURN)
    low, high = min(begin, begin + turn), max(begin, begin + turn)
    for place_ in range(count):
        for _ in range(2):  # a range may end beyond 2π, so compare the turn shifted by 2π, too
            if ranges[place_, 0] <= low and high <= ranges[place_, 1]:
                return True
            low, high = low + FULL_TURN, high + FULL_TURN
        low, high = low - 2.0 * FULL_TURN, high - 2.0 * FULL_TURN
    return False
