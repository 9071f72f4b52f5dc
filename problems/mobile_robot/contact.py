"""How far a robot can turn or drive before it meets something: closed forms, without sampling or stepping.

Two solids that are clear of each other first meet where a corner of one reaches an edge of the other. A disc is a
corner thickened by its radius. Two thicknesses add up, so only one solid of each pair needs to be thickened. So there
are three encounters: a corner of the robot with an edge of an obstacle, a corner of an obstacle with an edge of the
robot (the same, seen from the other side), and two thickened corners. All computations are in the robot's frame: its
reference point is the origin and it drives along +x.

Robots are given smaller by `CONTACT` all round, and stop where their true outline touches. So a robot that touches a
wall is clear of it by `CONTACT`, which is far more than rounding errors, and can slide along it, and along walls whose
faces adjoin flush. Doubtful cases, such as a corner that meets a corner head-on, count as blocked: the forms err on the
safe side, since a way that they allow must pass `check`.

`drive` and `can_turn` require the robot to be free where it stands.
"""

from typing import Any, NamedTuple

import numpy as np

from lowlevel.compiled import subroutine
from problems.plane import CONTACT

_NEVER = (np.inf, np.inf)
_SLACK = 1e-11  # m: corners this far beyond an edge's ends still meet it, so that none slips between two edges
_BEHIND = 1e-9  # rad: an encounter this little behind the robot counts as one at angle 0
_FULL_TURN = 2.0 * np.pi


class Robot(NamedTuple):
    """The robot: an outline, anticlockwise, thickened; smaller than the true robot by `CONTACT`."""

    outline: Any  # (corners, 2), m; a single corner for a disc
    thickness: Any  # m
    reach: Any  # m, the distance of the farthest corner from the reference point


@subroutine
def robot_of(outline: Any, thickness: Any) -> Any:
    """Return the `Robot` of an outline and a thickness."""
    squared = 0.0
    for corner in range(outline.shape[0]):
        squared = max(squared, outline[corner, 0] ** 2 + outline[corner, 1] ** 2)
    return Robot(outline, thickness, np.sqrt(squared))


class Floor(NamedTuple):
    """The obstacles (see `problems.plane.Shapes`) and the walls around them.

    Boxes and discs around shapes are a little too large; they serve only to skip shapes that are out of reach.
    """

    bounds: Any  # (4,), m: x0, y0, x1, y1
    corners: Any  # (all corners, 2), m
    starts: Any  # (shapes + 1,): the first corner of each shape
    thickness: Any  # (shapes,), m
    boxes: Any  # (shapes, 4), m: x0, y0, x1, y1 of each shape
    middles: Any  # (shapes, 3), m: x, y and radius of a disc around each shape


# Driving along +x. Each encounter returns two lengths: how far the smaller robot can go until it would be inside the
# other solid, and how far the true robot can go until it touches. The latter may be negative if it touches already.


@subroutine
def _drive_to_edge(px: Any, py: Any, ax: Any, ay: Any, bx: Any, by: Any, thickness: Any) -> Any:
    """Return the lengths until the corner p drives into the edge ab, which is solid on its left and thickened.

    Only an edge that descends (b below a) has its free side towards -x, where p comes from.
    """
    rise = by - ay
    if rise >= 0.0 or py > ay + thickness + _SLACK or py < by - thickness - _SLACK:
        return _NEVER
    run = bx - ax
    length = np.hypot(run, rise)
    normal_x, normal_y = rise / length, -run / length
    # The edge moved outwards by the thickness. Its round ends belong to the corners, which `_drive_to_corner` tests.
    top, bottom = ay + thickness * normal_y, by + thickness * normal_y
    if py > top + _SLACK or py < bottom - _SLACK:
        return _NEVER
    share = min(1.0, max(0.0, (py - top) / rise))
    # The line at the height of p. A slack beyond the ends counts as the end itself.
    hit = ax + thickness * normal_x + share * run - px
    # The true robot touches earlier, by `CONTACT` measured along the edge's normal.
    gap = -CONTACT / normal_x
    if hit < -gap:  # p is past the edge already, deeper than contact: the edge's line is behind it
        return _NEVER
    return hit, hit - gap


@subroutine
def _drive_to_corner(px: Any, py: Any, cx: Any, cy: Any, thickness: Any) -> Any:
    """Return the lengths until the corner p drives into the thickened corner c, by Pythagoras."""
    ahead, aside = cx - px, cy - py
    if ahead <= 0.0 or abs(aside) >= thickness:
        return _NEVER
    touching = thickness + CONTACT
    hit = ahead - np.sqrt((thickness - aside) * (thickness + aside))
    # Factored squares: they do not lose digits where aside is close to the thickness.
    stop = ahead - np.sqrt((touching - aside) * (touching + aside))
    # p is already deeper in the disc than contact, so it does not drive into it.
    if hit < 0.0 and np.hypot(ahead, aside) < thickness - CONTACT:
        return _NEVER
    return hit, stop


@subroutine
def _nearer(one: Any, other: Any) -> Any:
    return min(one[0], other[0]), min(one[1], other[1])


@subroutine
def _drive_into(robot: Any, ax: Any, ay: Any, bx: Any, by: Any, single: Any, thickness: Any, free: Any) -> Any:
    """Return the lengths until the robot drives into an obstacle's corner a or its edge ab (no edge if ``single``).

    ``free`` are the least lengths so far.
    """
    outline = robot.outline
    corners = outline.shape[0]
    previous = corners - 1
    for corner in range(corners):
        px, py = outline[corner, 0], outline[corner, 1]
        if not single:
            free = _nearer(free, _drive_to_edge(px, py, ax, ay, bx, by, thickness))
        if thickness > 0.0:
            free = _nearer(free, _drive_to_corner(px, py, ax, ay, thickness))
        if corners > 1:  # half a turn of the frame brings the robot's edge to the obstacle's corner
            qx, qy = outline[previous, 0], outline[previous, 1]
            free = _nearer(free, _drive_to_edge(-ax, -ay, -qx, -qy, -px, -py, thickness))
        previous = corner
    return free


@subroutine
def _drive_to_shape(robot: Any, floor: Any, shape: Any, x: Any, y: Any, cosine: Any, sine: Any, free: Any) -> Any:
    """Return the lengths until the robot drives into one obstacle; ``free`` are the least lengths so far."""
    first, last = floor.starts[shape], floor.starts[shape + 1]
    thickness = robot.thickness + floor.thickness[shape]
    wide = robot.reach + thickness + _SLACK
    east, north = floor.corners[last - 1, 0] - x, floor.corners[last - 1, 1] - y
    ax, ay = cosine * east + sine * north, cosine * north - sine * east
    for corner in range(first, last):
        east, north = floor.corners[corner, 0] - x, floor.corners[corner, 1] - y
        bx, by = cosine * east + sine * north, cosine * north - sine * east
        # Skip edges that lie behind, aside, or farther ahead than something that is in the way already.
        near = min(ax, bx) - wide <= free[0] and max(ax, bx) + wide >= 0.0
        if near and min(ay, by) <= wide and max(ay, by) >= -wide:
            free = _drive_into(robot, ax, ay, bx, by, last - first == 1, thickness, free)
        ax, ay = bx, by
    return free


@subroutine
def _drive_to_wall(room: Any, speed: Any, farthest: Any) -> Any:
    """Return the lengths until a wall ``room`` away that comes nearer by ``speed`` for each metre driven."""
    if speed <= 0.0 or room > speed * farthest:
        return _NEVER
    return room / speed, (room - CONTACT) / speed


@subroutine
def _drive_to_bounds(robot: Any, floor: Any, x: Any, y: Any, cosine: Any, sine: Any) -> Any:
    bounds, outline = floor.bounds, robot.outline
    west, south, east, north = x, y, x, y
    for corner in range(outline.shape[0]):
        px = x + cosine * outline[corner, 0] - sine * outline[corner, 1]
        py = y + sine * outline[corner, 0] + cosine * outline[corner, 1]
        if corner == 0:
            west, south, east, north = px, py, px, py
        west, south, east, north = min(west, px), min(south, py), max(east, px), max(north, py)
    thickness = robot.thickness
    # No drive within the bounds is longer. A wall beyond that is one that the robot drives alongside, up to rounding.
    farthest = bounds[2] - bounds[0] + bounds[3] - bounds[1]
    free = _drive_to_wall(west - thickness - bounds[0], -cosine, farthest)
    free = _nearer(free, _drive_to_wall(south - thickness - bounds[1], -sine, farthest))
    free = _nearer(free, _drive_to_wall(bounds[2] - east - thickness, cosine, farthest))
    return _nearer(free, _drive_to_wall(bounds[3] - north - thickness, sine, farthest))


@subroutine
def drive(robot: Any, floor: Any, x: Any, y: Any, heading: Any, needed: Any) -> Any:
    """Return how far the robot at a free place can drive ahead, m; lengths beyond ``needed`` are cut to it.

    Returns:
        (hit, stop): the robot can drive any length below ``hit``. It touches at ``stop``, which is less than ``hit``
        and may be negative.
    """
    cosine, sine = np.cos(heading), np.sin(heading)
    free = _nearer((needed, needed), _drive_to_bounds(robot, floor, x, y, cosine, sine))
    for shape in range(floor.thickness.size):
        east, north = floor.middles[shape, 0] - x, floor.middles[shape, 1] - y
        ahead, aside = cosine * east + sine * north, cosine * north - sine * east
        wide = floor.middles[shape, 2] + robot.reach + robot.thickness
        if abs(aside) <= wide and ahead + wide >= 0.0 and ahead - wide <= free[0]:
            free = _drive_to_shape(robot, floor, shape, x, y, cosine, sine, free)
    return free


# Turning on the spot, anticlockwise with sense 1.0 and clockwise with -1.0. Each encounter returns the angle by which
# the smaller robot can turn until it would be inside the other solid. A corner moves on a circle about the origin, so
# each encounter is the intersection of that circle with a line or with another circle.


@subroutine
def _angle_between(px: Any, py: Any, qx: Any, qy: Any, sense: Any) -> Any:
    """Return the angle from p to q about the origin, counted in the given sense, in (-π, π]."""
    return np.arctan2(sense * (px * qy - py * qx), px * qx + py * qy)


@subroutine
def _ahead(angle: Any) -> Any:
    """Return an angle in [0, 2π), but keep one just below 0: that encounter is at hand, not a full turn away."""
    return angle if angle >= -_BEHIND else angle + _FULL_TURN


@subroutine
def _turn_to_line(px: Any, py: Any, nx: Any, ny: Any, offset: Any, low: Any, high: Any, sense: Any) -> Any:
    """Return the angle until p, turning about the origin, crosses a part of a line; inf if it never does.

    The line is all x with x·n = offset, the part where ``low`` <= x·t <= ``high``. Its free side is the one that its
    unit normal n points to; t is n turned by a right angle. The point leaves the free side at n turned by
    acos(offset / radius), so there x·t is the positive root of radius² - offset².
    """
    # Negative if p is nearer to the origin than the line: its circle never crosses it.
    squared = px * px + py * py - offset * offset
    if squared <= 0.0:
        return np.inf
    along = sense * np.sqrt(squared)
    if along < low - _SLACK or along > high + _SLACK:
        return np.inf
    return _ahead(_angle_between(px, py, offset * nx - along * ny, offset * ny + along * nx, sense))


@subroutine
def _turn_to_edge(px: Any, py: Any, ax: Any, ay: Any, bx: Any, by: Any, thickness: Any, sense: Any) -> Any:
    """Return the angle until the corner p turns into the edge ab, which is solid on its left and thickened."""
    run, rise = bx - ax, by - ay
    length = np.hypot(run, rise)
    if length == 0.0:
        return np.inf
    tx, ty = run / length, rise / length
    low = ax * tx + ay * ty
    return _turn_to_line(px, py, ty, -tx, ax * ty - ay * tx + thickness, low, low + length, sense)


@subroutine
def _turn_to_corner(px: Any, py: Any, cx: Any, cy: Any, thickness: Any, sense: Any) -> Any:
    """Return the angle until the corner p turns into the thickened corner c, by the cosine rule."""
    radius_squared, away_squared = px * px + py * py, cx * cx + cy * cy
    dot_at_contact = (radius_squared + away_squared - thickness * thickness) / 2.0
    # Beyond ±1 the circle of p never meets that of c; p or c at the origin gives NaN, which counts as never.
    share = dot_at_contact / np.sqrt(radius_squared * away_squared)
    if not -1.0 < share < 1.0:
        return np.inf
    return _ahead(_angle_between(px, py, cx, cy, sense) - np.arccos(share))


@subroutine
def _turns_into(
    robot: Any, ax: Any, ay: Any, bx: Any, by: Any, single: Any, thickness: Any, sense: Any, turn: Any
) -> Any:
    """Return whether the robot turns into an obstacle's corner a or its edge ab (no edge if ``single``)."""
    outline = robot.outline
    previous = outline.shape[0] - 1
    for corner in range(outline.shape[0]):
        px, py, qx, qy = outline[corner, 0], outline[corner, 1], outline[previous, 0], outline[previous, 1]
        # Any encounter within the turn blocks it; which one comes first does not matter.
        if not single and _turn_to_edge(px, py, ax, ay, bx, by, thickness, sense) <= turn:
            return True
        # Seen from the robot, the obstacle's corner turns the other way into the robot's edge.
        if _turn_to_edge(ax, ay, qx, qy, px, py, thickness, -sense) <= turn:
            return True
        if thickness > 0.0 and _turn_to_corner(px, py, ax, ay, thickness, sense) <= turn:
            return True
        previous = corner
    return False


@subroutine
def _turns_into_shape(
    robot: Any, floor: Any, shape: Any, x: Any, y: Any, cosine: Any, sine: Any, sense: Any, turn: Any
) -> Any:
    first, last = floor.starts[shape], floor.starts[shape + 1]
    thickness = robot.thickness + floor.thickness[shape]
    east, north = floor.corners[last - 1, 0] - x, floor.corners[last - 1, 1] - y
    ax, ay = cosine * east + sine * north, cosine * north - sine * east
    for corner in range(first, last):
        east, north = floor.corners[corner, 0] - x, floor.corners[corner, 1] - y
        bx, by = cosine * east + sine * north, cosine * north - sine * east
        if _turns_into(robot, ax, ay, bx, by, last - first == 1, thickness, sense, turn):
            return True
        ax, ay = bx, by
    return False


@subroutine
def _turns_across(robot: Any, nx: Any, ny: Any, room: Any, sense: Any, turn: Any) -> Any:
    """Return whether the robot turns across a wall ``room`` away, whose normal into the room is n."""
    room -= robot.thickness
    if room < robot.reach:
        outline = robot.outline
        for corner in range(outline.shape[0]):
            px, py = outline[corner, 0], outline[corner, 1]
            if _turn_to_line(px, py, nx, ny, -room, -np.inf, np.inf, sense) <= turn:
                return True
    return False


@subroutine
def _turns_across_bounds(robot: Any, floor: Any, x: Any, y: Any, cosine: Any, sine: Any, sense: Any, turn: Any) -> Any:
    bounds = floor.bounds
    return (
        _turns_across(robot, cosine, -sine, x - bounds[0], sense, turn)
        or _turns_across(robot, sine, cosine, y - bounds[1], sense, turn)
        or _turns_across(robot, -cosine, sine, bounds[2] - x, sense, turn)
        or _turns_across(robot, -sine, -cosine, bounds[3] - y, sense, turn)
    )


@subroutine
def can_turn(robot: Any, floor: Any, x: Any, y: Any, heading: Any, turn: Any) -> Any:
    """Return whether the robot at a free place can turn by an angle, anticlockwise if it is positive."""
    if robot.reach == 0.0 or turn == 0.0:
        return True
    cosine, sine = np.cos(heading), np.sin(heading)
    sense = 1.0 if turn > 0.0 else -1.0
    if _turns_across_bounds(robot, floor, x, y, cosine, sine, sense, abs(turn)):
        return False
    for shape in range(floor.thickness.size):
        box = floor.boxes[shape]
        east, north = max(box[0] - x, 0.0, x - box[2]), max(box[1] - y, 0.0, y - box[3])
        reach = robot.reach + robot.thickness
        if east * east + north * north > reach * reach:
            continue
        if _turns_into_shape(robot, floor, shape, x, y, cosine, sine, sense, abs(turn)):
            return False
    return True


@subroutine
def shorter_angle(angle: Any) -> Any:
    """Return the same angle in (-π, π]."""
    return angle - _FULL_TURN * np.ceil((angle - np.pi) / _FULL_TURN)


@subroutine
def full_turn_less(turn: Any) -> Any:
    """Return the turn to the same heading in the other sense."""
    return turn - _FULL_TURN if turn > 0.0 else turn + _FULL_TURN


@subroutine
def turn_to(robot: Any, floor: Any, pose: Any, heading: Any, turned: Any) -> Any:
    """Fill the pose ``turned`` after a turn to ``heading``, by the shorter sense if free, else by the other.

    Return whether one of them was free.
    """
    x, y, now = pose
    turned[0], turned[1] = x, y
    short = shorter_angle(heading - now)
    if can_turn(robot, floor, x, y, now, short):
        turned[2] = now + short
        return True
    long = full_turn_less(short)
    turned[2] = now + long
    return can_turn(robot, floor, x, y, now, long)
