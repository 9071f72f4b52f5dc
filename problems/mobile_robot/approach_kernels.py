"""Approaches to a goal in which the robot cannot turn freely: poses from which turns and drives lead there.

Such a goal is visible only from straight behind it, where hardly any scan ends. So the robot is backed out of the goal
before the search: turned there as far as it can, driven back, turned again, until it stands where it can turn all
around. Each pose found this way is an approach, proven by the closed forms of `contact`: from there the robot drives
ahead and turns, and is at the next approach or at the goal. A scan that sees an approach has found a way.

Backing out goes from the goal to the approaches, but the robot moves the other way. So each drive and turn is proven in
the direction in which the robot will make it.

An approach is a row: x, y, heading; the turn after the drive ahead; the number of the approach that this leads to (-1:
the goal); the length of all drives from there to the goal, m; 1 if scans look for it, else 0.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lowlevel.compiled import kernel, subroutine
from problems.mobile_robot.contact import Floor, can_turn, drive, full_turn_less, robot_of, shorter_angle

Floats = NDArray[np.float64]

LONGEST = 6
"""The most drives from an approach to the goal."""

_FULL_TURN = 2.0 * np.pi
_COLUMNS = 7
_HEADINGS = 32  # headings that are tried for driving back
_STEPS = 4.0  # places on a drive back in a circumscribed radius
_FARTHEST = 12.0  # the longest drive back, in circumscribed radii
_MOST = 160  # approaches in all
_ENOUGH = 6  # so many approaches where the robot can turn all around end the backing out
_MOST_LOOKED_FOR = 16  # each costs every scan a test at each of its places


@subroutine
def _turn_between(robot: Any, floor: Any, x: Any, y: Any, begin: Any, end: Any) -> Any:
    """Return a turn from one heading to another that is free both ways, or infinity.

    The robot is known to be free at ``end`` only. The turn back from there proves that it is free at ``begin``, which
    the test of the turn itself presumes.
    """
    turn = shorter_angle(end - begin)
    for _ in range(2):
        if can_turn(robot, floor, x, y, end, -turn) and can_turn(robot, floor, x, y, begin, turn):
            return turn
        turn = full_turn_less(turn)
    return np.inf


@subroutine
def _is_new(found: Any, count: Any, x: Any, y: Any, heading: Any, near: Any) -> Any:
    """Return whether no approach found so far is nearly the same."""
    for row in range(count):
        if np.hypot(found[row, 0] - x, found[row, 1] - y) < near:
            off = abs(shorter_angle(found[row, 2] - heading))
            if off < np.pi / _HEADINGS:
                return False
    return True


@subroutine
def _backed_out(robot: Any, back: Any, floor: Any, goal: Any, number: Any, found: Any, count: Any) -> Any:
    """Append the approaches that lead to approach ``number`` (-1: the goal) by one drive; return how many there are.

    ``back`` is the robot turned by half a turn in its own frame: driving it ahead drives the robot back.
    """
    x, y, heading, before = goal[0], goal[1], goal[2], 0.0
    if number >= 0:
        x, y, heading, before = found[number, 0], found[number, 1], found[number, 2], found[number, 5]
    size = robot.reach + robot.thickness
    for each in range(_HEADINGS):
        ahead = heading + each * _FULL_TURN / _HEADINGS
        turn = _turn_between(robot, floor, x, y, ahead, heading)
        if turn == np.inf:
            continue
        farthest = drive(back, floor, x, y, ahead + np.pi, _FARTHEST * size)[1]
        for step in range(1, int(farthest * _STEPS / size) + 2):
            length = min(step * size / _STEPS, farthest)
            east, north = x - length * np.cos(ahead), y - length * np.sin(ahead)
            if count == _MOST or length <= 0.0 or drive(robot, floor, east, north, ahead, length)[0] < length:
                break
            # A place where the robot can turn all around is kept in any case, and ends this drive back: from there the
            # scan can do the rest.
            turns = can_turn(robot, floor, east, north, ahead, _FULL_TURN)
            if turns or _is_new(found, count, east, north, ahead, size / _STEPS / 2.0):
                found[count, 0], found[count, 1], found[count, 2] = east, north, ahead
                found[count, 3], found[count, 4], found[count, 5] = turn, number, before + length
                found[count, 6] = 1.0 if turns else 0.0
                count += 1
            if turns:
                break
    return count


@subroutine
def _look_for_some(found: Any, count: Any) -> Any:
    """Choose at most `_MOST_LOOKED_FOR` approaches that scans look for.

    These are the first ones where the robot can turn all around; if there are none, the first ones of all.
    """
    if np.sum(found[:count, 6]) == 0.0:
        found[: min(count, _MOST_LOOKED_FOR), 6] = 1.0
    looked_for = 0
    for row in range(count):
        if looked_for == _MOST_LOOKED_FOR:
            found[row, 6] = 0.0
        elif found[row, 6] > 0.0:
            looked_for += 1


@kernel(
    "float64[:,::1](float64[::1], float64[:,::1], float64, float64[::1], float64[:,::1], int64[::1], float64[::1],"
    "float64[:,::1], float64[:,::1])"
)
def approaches_to(
    goal: Floats,
    outline: Floats,
    robot_thickness: float,
    bounds: Floats,
    corners: Floats,
    starts: NDArray[np.int64],
    thickness: Floats,
    boxes: Floats,
    middles: Floats,
) -> Floats:
    """Return the approaches to a goal, shape (n, 7); none if the robot can turn all around there.

    Breadth first: each round backs out of the approaches of the round before, except where the robot can turn all
    around already.
    """
    robot, back = robot_of(outline, robot_thickness), robot_of(-outline, robot_thickness)
    floor = Floor(bounds, corners, starts, thickness, boxes, middles)
    found = np.zeros((_MOST, _COLUMNS))
    if can_turn(robot, floor, goal[0], goal[1], goal[2], _FULL_TURN):
        return found[:0].copy()
    first, count = 0, _backed_out(robot, back, floor, goal, -1, found, 0)
    for _ in range(1, LONGEST):
        # Enough roomy places, or the last round found nothing new.
        if np.sum(found[:count, 6]) >= _ENOUGH or first == count:
            break
        last = count
        # Approaches of the last round only; those before have been backed out of.
        for number in range(first, last):
            if found[number, 6] == 0.0:
                count = _backed_out(robot, back, floor, goal, number, found, count)
        first = last
    _look_for_some(found, count)
    return found[:count].copy()


@subroutine
def follow_approach(approaches: Any, number: Any, goal: Any, path: Any, row: Any) -> Any:
    """Append the poses that lead from an approach, at which ``path[row]`` stands, to the goal; return how many."""
    first = row
    while number >= 0:
        turn, number = approaches[number, 3], int(approaches[number, 4])
        x, y = goal[0], goal[1]
        if number >= 0:
            x, y = approaches[number, 0], approaches[number, 1]
        heading = path[row, 2]
        path[row + 1, 0], path[row + 1, 1], path[row + 1, 2] = x, y, heading
        path[row + 2, 0], path[row + 2, 1], path[row + 2, 2] = x, y, heading + turn
        row += 2
    return row - first
