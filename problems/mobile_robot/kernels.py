"""The compiled scan of rotate and move commands (Ahuactzin et al. 1992, §5; the scan is that of §4).

Poses are x (m), y (m) and heading (rad), unwrapped: straight interpolation between two poses is the motion.

The parts of the table (see `genetics.operators`), in the order in which `MobileRobot` packs them:
    integers 0: bits of each command, whether they are a Gray code, the number of commands (rotates and moves), whether
        the way to the goal is measured around obstacles
    reals 1: the poses of start and goal
    reals 2: the circumscribed radius and the robot's thickness, m
    reals 3: the robot's outline
    4 to 9: the fields of `contact.Floor`
    reals 10: the first node of the guide's grid and its spacing, m
    reals 11: the guide's distances, m
    reals 12: the approaches to the goal (see `approach_kernels`), none unless ways are measured around obstacles
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Fitness, Genomes
from genetics.bit_kernels import integers_of
from genetics.operators import FITNESS, Table
from lowlevel.compiled import kernel, subroutine
from lowlevel.pointers import integers, reals
from problems.mobile_robot.approach_kernels import LONGEST, follow_approach
from problems.mobile_robot.contact import Floor, drive, robot_of, shorter_angle, turn_to
from problems.mobile_robot.guide_kernels import Field, distance_at
from problems.mobile_robot.shortening import shortened
from problems.plane import CONTACT

Floats = NDArray[np.float64]

_FULL_TURN = 2.0 * np.pi


class Task(NamedTuple):
    """The problem as the kernels take it: the robot, the floor, the goal, and how commands are coded and judged."""

    robot: Any
    floor: Any
    goal: Any  # (3,): m, m, rad
    radius: Any  # m, the circumscribed radius: a difference of headings times this counts as a length
    levels: Any  # 2^q, the number of values of a command
    around: Any  # whether the way to the goal is measured around obstacles
    field: Any  # guide_kernels.Field, used only if so
    approaches: Any  # see approach_kernels


class Room(NamedTuple):
    """The working arrays of a scan; each scan overwrites them."""

    codes: Any  # (commands,)
    path: Any  # (commands + 4 + 2 * LONGEST, 3): the poses, the first of which is the start
    spare: Any  # (3, 3): the last poses of a visible path
    free: Any  # (1 + approaches,): whether the way is free to the goal, and to each approach


@subroutine
def _move(robot: Any, floor: Any, pose: Any, share: Any, moved: Any) -> Any:
    """Fill the pose ``moved`` after a drive over a share of the free length ahead."""
    x, y, heading = pose
    length = share * max(0.0, drive(robot, floor, x, y, heading, np.inf)[1])
    moved[0], moved[1], moved[2] = x + length * np.cos(heading), y + length * np.sin(heading), heading


@subroutine
def _way_is_free(robot: Any, floor: Any, pose: Any, goal: Any, spare: Any) -> Any:
    """Return whether the robot, once it faces the goal, can drive there and turn to the goal's heading.

    Fill ``spare``, the last three poses of the path, up to full turns of the heading.
    """
    x, y = pose[0], pose[1]
    away = np.hypot(goal[0] - x, goal[1] - y)
    # Already at the goal's place: there is nothing to face.
    if away <= CONTACT:
        return True
    facing = np.arctan2(goal[1] - y, goal[0] - x)
    spare[0, 0], spare[0, 1], spare[0, 2] = x, y, facing
    spare[1, 0], spare[1, 1], spare[1, 2] = goal[0], goal[1], facing
    if drive(robot, floor, x, y, facing, away)[0] < away:
        return False
    return turn_to(robot, floor, spare[1], goal[2], spare[2])


@subroutine
def _drive_on(robot: Any, floor: Any, path: Any, row: Any, goal: Any, spare: Any) -> Any:
    """Append the poses that lead from a pose with a free way to the goal: turn, drive, turn.

    Return the number of these commands, -1 if the robot cannot turn to face the goal.
    """
    if np.hypot(goal[0] - path[row, 0], goal[1] - path[row, 1]) <= CONTACT:
        return 1 if turn_to(robot, floor, path[row], goal[2], path[row + 1]) else -1
    if not turn_to(robot, floor, path[row], spare[0, 2], path[row + 1]):
        return -1
    # `_way_is_free` computed its poses from the wrapped heading; the path's headings are unwrapped.
    full_turns = path[row + 1, 2] - spare[0, 2]
    path[row + 2], path[row + 3] = spare[1], spare[2]
    path[row + 2, 2] = path[row + 1, 2]
    path[row + 3, 2] += full_turns
    return 3


@subroutine
def _look_around(task: Any, room: Any, row: Any) -> Any:
    """Fill in whether the way is free from a pose of the path to the goal, and to the approaches that scans look for.

    That depends on the place alone, not on the heading, so it is done once for each place.
    """
    room.free[0] = _way_is_free(task.robot, task.floor, room.path[row], task.goal, room.spare)
    for number in range(len(task.approaches)):
        room.free[1 + number] = task.approaches[number, 6] > 0.0 and _way_is_free(
            task.robot, task.floor, room.path[row], task.approaches[number, :3], room.spare
        )


@subroutine
def _arrive(task: Any, room: Any, row: Any) -> Any:
    """Append the poses that lead from a pose to the goal, directly or over an approach.

    Return the number of these commands, -1 if the robot can face neither the goal nor an approach with a free way.
    """
    robot, floor, path, spare = task.robot, task.floor, room.path, room.spare
    # The goal itself comes first (-1), so an approach is used only where it is needed.
    for number in range(-1, len(task.approaches)):
        if room.free[1 + number]:
            target = task.goal if number < 0 else task.approaches[number, :3]
            # Called for what it writes to ``spare``: `_look_around` went on to other targets since.
            _way_is_free(robot, floor, path[row], target, spare)
            last = _drive_on(robot, floor, path, row, target, spare)
            if last >= 0:
                return last + follow_approach(task.approaches, number, task.goal, path, row + last)
    return -1


@subroutine
def _short_of(task: Any, pose: Any) -> Any:
    """Return how far a pose is from the goal, m: the way, plus the turn times the circumscribed radius."""
    x, y, heading = pose
    goal = task.goal
    away = distance_at(task.field, x, y) if task.around else np.hypot(goal[0] - x, goal[1] - y)
    return away + task.radius * abs(shorter_angle(goal[2] - heading))


@subroutine
def _scan(task: Any, room: Any) -> Any:
    """Carry out the commands from the pose ``path[0]`` until the goal, or an approach to it, is visible.

    The poses are appended to the path. If the goal is never visible, the last pose counts; where ways are measured
    around obstacles, the nearest pose counts, so that commands behind it may vary freely. A rotation that is blocked
    both ways ends the scan (§5), or, where ways are measured around obstacles, is left out.

    Returns:
        The fitness, the number of commands up to the pose that counts, and the number of further commands that lead
        from there to the goal (0 if it is not visible).
    """
    robot, floor, levels, codes, path = task.robot, task.floor, task.levels, room.codes, room.path
    row, nearest, fitness = 0, 0, np.inf
    _look_around(task, room, 0)
    while True:
        last = _arrive(task, room, row)
        if last >= 0:
            return 0.0, row, last
        short = _short_of(task, path[row])
        # The paper's fitness is that of the last pose, so there each pose replaces the one before.
        if short < fitness or not task.around:
            nearest, fitness = row, short
        if row == codes.size:
            break
        # Even rows are rotates, odd rows are moves. A rotate codes i / 2^q of a full turn, a move (i + 1) / 2^q of the
        # free length, which is never 0.
        share = codes[row] / levels
        if row % 2 == 0:
            if not turn_to(robot, floor, path[row], _FULL_TURN * share, path[row + 1]):
                if not task.around:
                    break
                path[row + 1] = path[row]
        else:
            _move(robot, floor, path[row], share + 1.0 / levels, path[row + 1])
            _look_around(task, room, row + 1)
        row += 1
    return fitness, nearest, 0


@subroutine
def _task_of(table: Any) -> Any:
    sizes, outline = reals(table, 2)[0], reals(table, 3)
    robot = robot_of(outline, sizes[1])
    bounds, corners, starts = reals(table, 4)[0], reals(table, 5), integers(table, 6)[0]
    floor = Floor(bounds, corners, starts, reals(table, 7)[0], reals(table, 8), reals(table, 9))
    bits, around = integers(table, 0)[0, 0], integers(table, 0)[0, 3] != 0
    grid = reals(table, 10)[0]
    field = Field(grid[0], grid[1], grid[2], reals(table, 11))
    levels = np.float64(np.int64(1) << bits)
    return Task(robot, floor, reals(table, 1)[1], sizes[0], levels, around, field, reals(table, 12))


@subroutine
def _room_for(table: Any) -> Any:
    commands = integers(table, 0)[0, 2]
    path, free = np.empty((commands + 4 + 2 * LONGEST, 3)), np.empty(1 + table[12, 1], np.bool_)
    room = Room(np.empty(commands, np.int64), path, np.empty((3, 3)), free)
    room.path[0] = reals(table, 1)[0]
    return room


@subroutine
def _carry_out(genome: Any, table: Any, task: Any, room: Any) -> Any:
    """Return the result of `_scan` for the commands that a genome codes."""
    layout = integers(table, 0)[0]
    integers_of(genome, layout[0], layout[1] != 0, room.codes)
    return _scan(task, room)


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Fill how far the scan of each list of coded commands stays from the goal, m; 0 if the goal is visible (§5)."""
    task, room = _task_of(table), _room_for(table)
    for row in range(fitness.size):
        fitness[row] = _carry_out(genomes[row], table, task, room)[0]


@kernel("Tuple((float64[:,::1], int64))(uint8[::1], int64[:,::1], boolean)")
def follow(genome: Genomes, table: Table, shorten: bool) -> tuple[Floats, int]:
    """Return the poses, shape (poses, 3), that a genome's commands lead to, and how many of the commands count.

    The poses behind those of the commands lead to the goal: turns and drives, alternately. With ``shorten`` a way that
    reaches the goal is shortened, so its poses are no longer those of the genome's commands.
    """
    room, task = _room_for(table), _task_of(table)
    _, scanned, last = _carry_out(genome, table, task, room)
    if shorten and last > 0:
        poses = shortened(task.robot, task.floor, room.path, scanned + last)
        if len(poses) > 0:
            return poses, max(0, len(poses) - 4)  # the last three commands count as those that lead to the goal
    return room.path[: 1 + scanned + last].copy(), scanned
