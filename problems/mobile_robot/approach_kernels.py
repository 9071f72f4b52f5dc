"""How a goal is entered in which the robot cannot turn freely: poses from which turns and drives lead there.

Such a goal is seen only from what is straight behind it. So the robot is backed out of the goal: turned there as far
as it can, driven back, turned again, until it stands where it can turn all around. Each pose found on the way is an
approach, proven by the closed forms of `contact`: from there the robot drives ahead and turns, and is at the next
approach or at the goal. A scan that sees one has found a way.

An approach is a row: x, y, heading; the turn that is made after the drive ahead; the number of the approach that this
leads to (-1: the goal); the length of all drives to the goal, m; whether scans look for it (1, else 0).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lowlevel.compiled import kernel, subroutine
from problems.mobile_robot.contact import Floor, can_turn, drive, full_turn_less, robot_of, shorter_angle

Floats = NDArray[np.float64]

LONGEST = 6
"""Drives from an approach to the goal, at most."""

_FULL_TURN = 2.0 * np.pi
_COLUMNS = 7
_HEADINGS = 32  # to which the robot is turned before it is driven back
_STEPS = 4.0  # places in a circumscribed radius
_FARTHEST = 12.0  # circumscribed radii that it is driven back at once
_MOST = 160  # approaches
_ENOUGH = 6  # of them where the robot can turn all around: then none are looked for farther back
_MOST_LOOKED_FOR = 16


@subroutine
def _turn_between(robot: Any, floor: Any, x: Any, y: Any, begin: Any, end: Any) -> Any:
    """A turn from one heading to another that is free both ways, or infinity; at ``end`` the robot is free."""
    turn = shorter_angle(end - begin)
    for _ in range(2):
        if can_turn(robot, floor, x, y, end, -turn) and can_turn(robot, floor, x, y, begin, turn):
            return turn
        turn = full_turn_less(turn)
    return np.inf


@subroutine
def _is_new(found: Any, count: Any, x: Any, y: Any, heading: Any, near: Any) -> Any:
    """Whether no approach is nearly the same."""
    for row in range(count):
        if np.hypot(found[row, 0] - x, found[row, 1] - y) < near:
            off = abs(shorter_angle(found[row, 2] - heading))
            if off < np.pi / _HEADINGS:
                return False
    return True


@subroutine
def _backed_out(robot: Any, back: Any, floor: Any, goal: Any, number: Any, found: Any, count: Any) -> Any:
    """Append the approaches that lead to approach ``number`` (-1: the goal) by one drive; how many there are then."""
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
    """Let scans look for the first approaches, if the robot can turn around at none."""
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
    """The approaches to a goal, shape (n, 7); none if the robot can turn all around there."""
    robot, back = robot_of(outline, robot_thickness), robot_of(-outline, robot_thickness)
    floor = Floor(bounds, corners, starts, thickness, boxes, middles)
    found = np.zeros((_MOST, _COLUMNS))
    if can_turn(robot, floor, goal[0], goal[1], goal[2], _FULL_TURN):
        return found[:0].copy()
    first, count = 0, _backed_out(robot, back, floor, goal, -1, found, 0)
    for _ in range(1, LONGEST):
        if np.sum(found[:count, 6]) >= _ENOUGH or first == count:
            break
        last = count
        for number in range(first, last):
            if found[number, 6] == 0.0:
                count = _backed_out(robot, back, floor, goal, number, found, count)
        first = last
    _look_for_some(found, count)
    return found[:count].copy()


@subroutine
def follow_approach(approaches: Any, number: Any, goal: Any, path: Any, row: Any) -> Any:
    """Append the poses that lead from an approach, the pose of that row, to the goal; how many."""
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
