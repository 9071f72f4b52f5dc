"""The compiled scan of rotate and move commands (Ahuactzin et al. 1992, §5; the scan is that of §4).

Poses are x (m), y (m) and heading (rad), unwrapped: straight interpolation between two poses is the motion.

The table (see `genetics.operators`): bits of each command, whether by Gray code, commands, whether the way to the goal
is measured around obstacles; the poses of start and goal; the circumscribed radius and the robot's thickness (m); its
outline; the fields of `contact.Floor`; where the guide's grid begins and its spacing (m), and its distances; the
approaches to the goal (see `approach_kernels`), none unless the way is measured around obstacles.
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
    """Which robot is to go where, and by commands of how many levels."""

    robot: Any
    floor: Any
    goal: Any  # (3,): m, m, rad
    radius: Any  # m, the circumscribed one, by which an angle counts as a length
    levels: Any  # 2^q
    around: Any  # whether the way to the goal is measured around obstacles
    field: Any  # guide_kernels.Field, if so
    approaches: Any  # see approach_kernels


class Room(NamedTuple):
    """What a scan writes to."""

    codes: Any  # (commands,)
    path: Any  # (commands + 4 + 2 * LONGEST, 3): the poses, the first of which is the start
    spare: Any  # (3, 3): the last poses of a visible path
    free: Any  # (1 + approaches,): whether the way is free to the goal, and to each approach


@subroutine
def _move(robot: Any, floor: Any, pose: Any, share: Any, moved: Any) -> Any:
    """Drive a share of the free length ahead. Fills the pose ``moved``."""
    x, y, heading = pose
    length = share * max(0.0, drive(robot, floor, x, y, heading, np.inf)[1])
    moved[0], moved[1], moved[2] = x + length * np.cos(heading), y + length * np.sin(heading), heading


@subroutine
def _way_is_free(robot: Any, floor: Any, pose: Any, goal: Any, spare: Any) -> Any:
    """Whether the robot, once it faces the goal, can drive there and turn to the goal's heading.

    Fills the last three poses of the visible path, ``spare``, but for the heading's full turns.
    """
    x, y = pose[0], pose[1]
    away = np.hypot(goal[0] - x, goal[1] - y)
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
    """The commands that lead from a pose with a free way to the goal: turn, drive, turn; or -1 if it cannot face it.

    Appends their poses to the path.
    """
    if np.hypot(goal[0] - path[row, 0], goal[1] - path[row, 1]) <= CONTACT:
        return 1 if turn_to(robot, floor, path[row], goal[2], path[row + 1]) else -1
    if not turn_to(robot, floor, path[row], spare[0, 2], path[row + 1]):
        return -1
    full_turns = path[row + 1, 2] - spare[0, 2]
    path[row + 2], path[row + 3] = spare[1], spare[2]
    path[row + 2, 2] = path[row + 1, 2]
    path[row + 3, 2] += full_turns
    return 3


@subroutine
def _look_around(task: Any, room: Any, row: Any) -> Any:
    """Fill in whether the way is free from a pose of the path to the goal, and to approaches that are looked for."""
    room.free[0] = _way_is_free(task.robot, task.floor, room.path[row], task.goal, room.spare)
    for number in range(len(task.approaches)):
        room.free[1 + number] = task.approaches[number, 6] > 0.0 and _way_is_free(
            task.robot, task.floor, room.path[row], task.approaches[number, :3], room.spare
        )


@subroutine
def _arrive(task: Any, room: Any, row: Any) -> Any:
    """The commands that lead from a pose to the goal, over an approach if need be; -1 if it can face none of them.

    Appends their poses to the path.
    """
    robot, floor, path, spare = task.robot, task.floor, room.path, room.spare
    for number in range(-1, len(task.approaches)):
        if room.free[1 + number]:
            target = task.goal if number < 0 else task.approaches[number, :3]
            _way_is_free(robot, floor, path[row], target, spare)
            last = _drive_on(robot, floor, path, row, target, spare)
            if last >= 0:
                return last + follow_approach(task.approaches, number, task.goal, path, row + last)
    return -1


@subroutine
def _short_of(task: Any, pose: Any) -> Any:
    """How far a pose is from the goal, m: the way, and the turn at the circumscribed radius."""
    x, y, heading = pose
    goal = task.goal
    away = distance_at(task.field, x, y) if task.around else np.hypot(goal[0] - x, goal[1] - y)
    return away + task.radius * abs(shorter_angle(goal[2] - heading))


@subroutine
def _scan(task: Any, room: Any) -> Any:
    """Carry out the commands from the pose ``path[0]`` until the goal is visible, or an approach to it.

    Appends the poses to the path. Returns the fitness, the number of commands that it is the fitness of, and of those
    that then lead to the goal. If the goal is never visible, the last pose counts, or, where ways are measured around
    obstacles, the nearest: so later commands may try what they like. A rotation that is blocked both ways ends the
    scan (§5), or, where ways are measured around obstacles, is left out.
    """
    robot, floor, levels, codes, path = task.robot, task.floor, task.levels, room.codes, room.path
    row, nearest, fitness = 0, 0, np.inf
    _look_around(task, room, 0)
    while True:
        last = _arrive(task, room, row)
        if last >= 0:
            return 0.0, row, last
        short = _short_of(task, path[row])
        if short < fitness or not task.around:
            nearest, fitness = row, short
        if row == codes.size:
            break
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
    """`_scan` for the commands that a genome codes."""
    layout = integers(table, 0)[0]
    integers_of(genome, layout[0], layout[1] != 0, room.codes)
    return _scan(task, room)


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """How far the scan of each list of coded commands stays from the goal, m; 0 if the goal is visible (§5)."""
    task, room = _task_of(table), _room_for(table)
    for row in range(fitness.size):
        fitness[row] = _carry_out(genomes[row], table, task, room)[0]


@kernel("Tuple((float64[:,::1], int64))(uint8[::1], int64[:,::1], boolean)")
def follow(genome: Genomes, table: Table, shorten: bool) -> tuple[Floats, int]:
    """The poses, shape (poses, 3), that a genome's commands lead to, and how many of the commands count.

    What leads from there to the goal follows in the poses: turns and drives by turns. A way to the goal is shortened if
    that is asked for; then it is another.
    """
    room, task = _room_for(table), _task_of(table)
    _, scanned, last = _carry_out(genome, table, task, room)
    if shorten and last > 0:
        poses = shortened(task.robot, task.floor, room.path, scanned + last)
        if len(poses) > 0:
            return poses, max(0, len(poses) - 4)
    return room.path[: 1 + scanned + last].copy(), scanned
