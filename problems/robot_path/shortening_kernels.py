"""Make ways shorter without leaving what is proven free: shortcuts, pulled corners, single joints made straight.

Each function changes a way in place, if all of the changed segments are free and the way gets shorter, and returns the
number of points. New points lie on the grid of the genes.
"""

from typing import Any

import numpy as np

from lowlevel.compiled import subroutine
from problems.robot_path.layout_kernels import (
    MOST_POINTS,
    deviate,
    distance,
    is_same,
    is_step_free,
    length_of,
    pick,
    snap,
    toss,
)

_LEAST_GAIN = 1e-3  # rad: smaller gains would keep a run from ever ending
_MANY = 12  # points
_SHARES = (1.0, 0.5, 0.25, 0.1)  # of the way to where a corner would vanish


@subroutine
def remove(way: Any, count: Any, first: Any, last: Any) -> Any:
    """Remove the points first, .., last - 1; return the number of points that are left."""
    gone = last - first
    if gone > 0:
        for place in range(last, count):
            way[place - gone] = way[place]
    return count - gone


@subroutine
def insert(way: Any, count: Any, at: Any, point: Any) -> Any:
    """Insert a point before the point ``at``; return the new number of points."""
    for place in range(count, at, -1):
        way[place] = way[place - 1]
    way[at] = point
    return count + 1


@subroutine
def drop_points(way: Any, count: Any, task: Any) -> Any:
    """Drop every point whose neighbours can be joined directly."""
    place = 1
    while place < count - 1:
        if is_same(way[place], way[place - 1]) or is_step_free(task, way[place - 1], way[place + 1]):
            count = remove(way, count, place, place + 1)
        else:
            place += 1
    return count


@subroutine
def _point_at(way: Any, count: Any, where: Any, point: Any) -> Any:
    """Fill the point at a length along the way; return the segment it lies in, and the length left to its end."""
    for segment in range(count - 1):
        long = distance(way[segment], way[segment + 1])
        if where <= long or segment == count - 2:
            share = min(1.0, where / long) if long > 0.0 else 0.0
            point[:] = way[segment] + share * (way[segment + 1] - way[segment])
            return segment
        where -= long
    return 0


@subroutine
def cut_short(way: Any, count: Any, task: Any, dice: Any, one: Any, other: Any) -> Any:
    """Join two points anywhere on the way directly; ``one`` and ``other`` are scratch."""
    if count < 3 or count >= MOST_POINTS - 2:
        return count
    whole = length_of(way, count)
    # Half of the cuts are short: these round off corners when the long ones have no chance left.
    span = whole * (toss(dice) if toss(dice) < 0.5 else 0.3 * toss(dice) ** 2)
    from_ = (whole - span) * toss(dice)
    first = _point_at(way, count, from_, one)
    last = _point_at(way, count, from_ + span, other)
    if first == last:
        return count
    snap(task, one)
    snap(task, other)
    if from_ <= 0.0 or is_same(one, way[first]):
        one[:] = way[first]
    if from_ + span >= whole or (last == count - 2 and is_same(other, way[last + 1])):
        other[:] = way[last + 1]
    old = distance(way[first], way[first + 1]) + distance(way[last], way[last + 1])
    for place in range(first + 1, last):
        old += distance(way[place], way[place + 1])
    new = distance(way[first], one) + distance(one, other) + distance(other, way[last + 1])
    if new > old - _LEAST_GAIN or not is_step_free(task, one, other):
        return count
    # Their ends moved to the grid, so the rests of the two segments are proven anew.
    if not (is_step_free(task, way[first], one) and is_step_free(task, other, way[last + 1])):
        return count
    count = remove(way, count, first + 1, last + 1)
    if not is_same(other, way[first + 1]):
        count = insert(way, count, first + 1, other)
    if not is_same(one, way[first]):
        count = insert(way, count, first + 1, one)
    return count


@subroutine
def _replace(way: Any, count: Any, place: Any, point: Any, task: Any) -> Any:
    """Move a point, if the way gets shorter by it and both segments are free; return whether it was done."""
    before, behind = way[place - 1], way[place + 1]
    old = distance(before, way[place]) + distance(way[place], behind)
    if distance(before, point) + distance(point, behind) > old - _LEAST_GAIN:
        return False
    if not (is_step_free(task, before, point) and is_step_free(task, point, behind)):
        return False
    way[place] = point
    return True


@subroutine
def pull(way: Any, count: Any, task: Any, dice: Any, point: Any) -> Any:
    """Pull a point towards the line between its neighbours, as far as one of a few shares allows."""
    if count < 3:
        return count
    place = 1 + pick(dice, count - 2)
    before, here, behind = way[place - 1], way[place], way[place + 1]
    direct = distance(before, behind)
    along = 0.0
    if direct > 0.0:
        for joint in range(task.joints):
            along += (here[joint] - before[joint]) * (behind[joint] - before[joint])
        along = min(1.0, max(0.0, along / (direct * direct)))
    share = _SHARES[pick(dice, 4)]
    for joint in range(task.joints):
        foot = before[joint] + along * (behind[joint] - before[joint])
        point[joint] = here[joint] + share * (foot - here[joint])
    snap(task, point)
    _replace(way, count, place, point, task)
    return count


@subroutine
def nudge(way: Any, count: Any, task: Any, dice: Any, point: Any) -> Any:
    """Move a point at random by a distance of any size below that to its neighbours."""
    if count < 3:
        return count
    place = 1 + pick(dice, count - 2)
    reach = min(distance(way[place - 1], way[place]), distance(way[place], way[place + 1]))
    size = reach * 2.0 ** (-1.0 - 6.0 * toss(dice)) / np.sqrt(task.joints)
    for joint in range(task.joints):
        point[joint] = way[place, joint] + size * deviate(dice)
    snap(task, point)
    _replace(way, count, place, point, task)
    return count


@subroutine
def straighten(way: Any, count: Any, task: Any, dice: Any, changed: Any) -> Any:
    """Let one joint move evenly between two points of the way, while the others move as before.

    Joints that the obstacles do not concern lose their detours so (Geraerts and Overmars 2007). ``changed`` is scratch.
    """
    if count < 3:
        return count
    first = pick(dice, count - 2)
    last = first + 2 + pick(dice, count - 2 - first)
    joint = pick(dice, task.joints)
    whole = length_of(way[first : last + 1], last + 1 - first)
    if whole <= 0.0:
        return count
    changed[: last + 1 - first] = way[first : last + 1]
    gone = 0.0
    for place in range(first + 1, last):
        gone += distance(way[place - 1], way[place])
        changed[place - first, joint] = way[first, joint] + gone / whole * (way[last, joint] - way[first, joint])
        snap(task, changed[place - first])
    if length_of(changed, last + 1 - first) > whole - _LEAST_GAIN:
        return count
    for place in range(last - first):
        if not is_step_free(task, changed[place], changed[place + 1]):
            return count
    way[first : last + 1] = changed[: last + 1 - first]
    return count


@subroutine
def shorten(way: Any, count: Any, task: Any, dice: Any, tries: Any) -> Any:
    """Shorten a free way by so many tries; drop the points that it does not need, if there are many."""
    one, other, changed = np.empty(task.joints), np.empty(task.joints), np.empty((MOST_POINTS, task.joints))
    for _ in range(tries):
        if count < 3:
            return count
        kind = toss(dice)
        if kind < 0.5:
            count = cut_short(way, count, task, dice, one, other)
        elif kind < 0.7:
            count = pull(way, count, task, dice, one)
        elif kind < 0.85:
            count = straighten(way, count, task, dice, changed)
        else:
            count = nudge(way, count, task, dice, one)
    return drop_points(way, count, task) if count > _MANY else count
