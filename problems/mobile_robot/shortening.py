"""Shorten a way that has been found, with turns and drives proven by the same closed forms as the scan's (`contact`).

A way is the sequence of places where the robot turns. Each round takes these places, others on the lines between them
and others inside their corners, and finds the shortest way over any of them in that order. Rounds end when little is
gained.

It is dynamic programming over lines between two places, not over places: whether the robot can turn at a place to its
next heading depends on the heading with which it arrives.
"""

from typing import Any

import numpy as np

from lowlevel.compiled import subroutine
from problems.mobile_robot.contact import can_turn, drive, full_turn_less, shorter_angle, turn_to

_ROUNDS = 12
_MOST_PLACES = 128
_LEAST_GAIN = 1e-3  # a round that gains a smaller share of the cost is the last
_STOP = 0.1  # a stop to turn costs this share of the robot's size, as a length: none is made for next to nothing
_NEAR = 1e-6  # m: places nearer to each other than this are one


@subroutine
def _can_face(robot: Any, floor: Any, x: Any, y: Any, now: Any, then: Any) -> Any:
    """Return whether the robot can turn from one heading to the other, in either sense."""
    short = shorter_angle(then - now)
    return can_turn(robot, floor, x, y, now, short) or can_turn(robot, floor, x, y, now, full_turn_less(short))


@subroutine
def _append(places: Any, count: Any, x: Any, y: Any) -> Any:
    """Append a place unless it repeats the last one or there is no room; return how many there are then."""
    if count == len(places) or (count > 0 and np.hypot(x - places[count - 1, 0], y - places[count - 1, 1]) < _NEAR):
        return count
    places[count, 0], places[count, 1] = x, y
    return count + 1


@subroutine
def _between(places: Any, count: Any, one: Any, other: Any, share: Any) -> Any:
    """Append the place at a share of the line from one place to the other; return how many there are then."""
    x, y = one[0] + share * (other[0] - one[0]), one[1] + share * (other[1] - one[1])
    return _append(places, count, x, y)


@subroutine
def _refined(way: Any, stops: Any, places: Any, finely: Any) -> Any:
    """Fill the places that a shorter way may lead over, in order; return how many there are.

    The way's own places are among them, unless there are too many for the array. ``finely`` adds places near and inside
    the corners.
    """
    count = _append(places, 0, way[0, 0], way[0, 1])
    for stop in range(1, stops):
        before, here = way[stop - 1], way[stop]
        count = _between(places, count, before, here, 0.5)
        if stop == stops - 1:
            break
        after = way[stop + 1]
        if finely:
            count = _between(places, count, before, here, 0.75)
            count = _between(places, count, before, here, 0.9)
        count = _append(places, count, here[0], here[1])
        if finely:
            middle = (before + after) / 2.0
            count = _between(places, count, here, middle, 0.1)
            count = _between(places, count, here, middle, 0.3)
            count = _between(places, count, here, middle, 0.6)
            count = _between(places, count, here, after, 0.1)
            count = _between(places, count, here, after, 0.25)
    if count == len(places):  # the goal needs the last place
        count -= 1
    return _append(places, count, way[stops - 1, 0], way[stops - 1, 1])


@subroutine
def _best_before(robot: Any, floor: Any, places: Any, costs: Any, place: Any, start: Any, heading: Any) -> Any:
    """Return the least cost of a way to a place where the robot can then turn to a heading, and the place before.

    The place before is -1 at the first place, and if there is no such way.
    """
    x, y = places[place]
    if place == 0:
        return (0.0 if _can_face(robot, floor, x, y, start, heading) else np.inf), -1
    least, best = np.inf, -1
    for before in range(place - 1, -1, -1):
        if costs[before, place] < least:  # only a cheaper line is worth the test of its turn
            arriving = np.arctan2(y - places[before, 1], x - places[before, 0])
            if _can_face(robot, floor, x, y, arriving, heading):
                least, best = costs[before, place], before
    return least, best


@subroutine
def _search(robot: Any, floor: Any, places: Any, ends: Any, most: Any, stop: Any, costs: Any, previous: Any) -> Any:
    """Return the least cost of a way from the first place to the last, and the place before the last.

    The place before is -1 if no way costs less than ``most``. ``ends`` are the headings at start and goal. Fill
    ``costs`` with the cost of each line between two places, including all that leads to it, and ``previous`` with the
    place before each line.
    """
    goal = len(places) - 1
    least = np.full(len(places), np.inf)
    least[0] = 0.0
    costs[:] = np.inf
    for place in range(1, len(places)):
        x, y = places[place]
        left = np.hypot(places[goal, 0] - x, places[goal, 1] - y)
        for before in range(place):
            east, north = x - places[before, 0], y - places[before, 1]
            length = np.hypot(east, north)
            # The straight line to the goal is a lower bound of what is left, so nothing shorter is cut off.
            if length < _NEAR or least[before] + length + left >= most:
                continue
            heading = np.arctan2(north, east)
            if drive(robot, floor, places[before, 0], places[before, 1], heading, length)[0] < length:
                continue
            cost, earlier = _best_before(robot, floor, places, costs, before, ends[0], heading)
            costs[before, place], previous[before, place] = cost + length + stop, earlier
            least[place] = min(least[place], costs[before, place])
    return _best_before(robot, floor, places, costs, goal, ends[0], ends[1])


@subroutine
def _length(way: Any, stops: Any) -> Any:
    length = 0.0
    for place in range(1, stops):
        length += np.hypot(way[place, 0] - way[place - 1, 0], way[place, 1] - way[place - 1, 1])
    return length


@subroutine
def _traced(places: Any, previous: Any, before: Any, way: Any) -> Any:
    """Fill the way that ends with the last place, coming from ``before``; return how many stops it has."""
    stops, here = 1, len(places) - 1
    chain = np.empty(len(places), np.int64)
    chain[0] = here
    while before >= 0:
        chain[stops] = before
        before, here = previous[before, here], before
        stops += 1
    for stop in range(stops):
        way[stop] = places[chain[stops - 1 - stop]]
    return stops


@subroutine
def _driven(robot: Any, floor: Any, path: Any, last: Any, way: Any, stops: Any) -> Any:
    """Return the poses of a way: turns and drives, alternately, from the path's first pose to its last heading."""
    poses = np.empty((2 * stops, 3))
    poses[0] = path[0]
    for stop in range(1, stops):
        heading = np.arctan2(way[stop, 1] - way[stop - 1, 1], way[stop, 0] - way[stop - 1, 0])
        turn_to(robot, floor, poses[2 * stop - 2], heading, poses[2 * stop - 1])
        poses[2 * stop, 0], poses[2 * stop, 1], poses[2 * stop, 2] = way[stop, 0], way[stop, 1], poses[2 * stop - 1, 2]
    turn_to(robot, floor, poses[2 * stops - 2], path[last, 2], poses[2 * stops - 1])
    return poses


@subroutine
def shortened(robot: Any, floor: Any, path: Any, last: Any) -> Any:
    """Return the poses of a shorter way than a path up to its pose ``last``; none if no shorter way is found.

    Turns and drives alternate, and the last is a turn. Both ends are the path's, up to full turns of the heading.
    """
    # The way's stops only; the turns between them are found anew.
    way, places = np.empty((max(_MOST_PLACES, last + 1), 2)), np.empty((_MOST_PLACES, 2))
    stops = 0
    for row in range(last + 1):
        stops = _append(way, stops, path[row, 0], path[row, 1])
    costs, previous = np.empty((_MOST_PLACES, _MOST_PLACES)), np.empty((_MOST_PLACES, _MOST_PLACES), np.int64)
    ends, stop = (path[0, 2], path[last, 2]), _STOP * (robot.reach + robot.thickness)
    found, known = False, _length(way, stops) + stops * stop
    for number in range(_ROUNDS):
        count = _refined(way, stops, places, number > 0)
        cost, before = _search(robot, floor, places[:count], ends, known, stop, costs, previous)
        # The known cost counts each stop of the way found so far, so a round can only improve on it.
        if before < 0 or cost >= known:
            break
        stops = _traced(places[:count], previous, before, way)
        gain, found, known = known - cost, True, cost
        if number > 0 and gain < _LEAST_GAIN * cost:
            break
    return _driven(robot, floor, path, last, way, stops) if found else np.empty((0, 3))
