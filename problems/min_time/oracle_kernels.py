"""The compiled rivals of the genetic algorithm on two joints: a dynamic program and a tree search over grid nodes.

Both move from node to node, and never move a joint away from the goal. A cubic B-spline is local: a stretch depends on
its two nodes, the one before them and the one after them. So the dynamic program's state holds three nodes (as a node,
the move to it and the move from it), and the tree search can time a stretch only once the node after it is chosen.

Both use the rows and caps of `problems.min_time.scaling` at full torque, without its tightening between grid points.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from genetics.operators import Table
from lowlevel.compiled import kernel, subroutine
from problems.min_time.kernels import task_of
from problems.min_time.scaling import (
    add_phantoms,
    cap_speeds,
    controllable,
    limit_half,
    room_of,
    scale_time,
    step_time,
    weigh_end,
    weigh_stretch,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

STEPS = 8
"""The number of steps of a stretch."""

_LENGTH = 1.0 / STEPS


@subroutine
def _put_node(node: Any, task: Any, row: Any, column: Any, lines: Any) -> Any:
    start, goal = task.ends[0], task.ends[1]
    node[0] = start[0] + (goal[0] - start[0]) * (row / (lines - 1))
    node[1] = start[1] + (goal[1] - start[1]) * (column / (lines - 1))


@subroutine
def _limit_forwards(rows: Any, task: Any, room: Any, half: Any) -> Any:
    """Fill the rows of a half step whose x is that at its end, for a pass forwards."""
    limit_half(rows, task, room, (half + 1) // 2, 1.0, 1.0, -_LENGTH if half % 2 == 0 else 0.0)


@subroutine
def _limit_backwards(rows: Any, task: Any, room: Any, half: Any) -> Any:
    """Fill the rows of a half step whose x is that at its beginning, for a pass backwards."""
    limit_half(rows, task, room, (half + 1) // 2, 1.0, 1.0, _LENGTH if half % 2 == 1 else 0.0)


@subroutine
def _greatest(rows: Any, x: Any, length: Any) -> Any:
    """Return the greatest x at the far end of a half step, with at most ``x`` at the near end; -1 if there is none.

    It reads `controllable` in either direction: backwards with a positive ``length``, forwards with a negative one.
    """
    if x < 0.0:
        return -1.0
    low, high = controllable(rows, 0.0, x, length)
    return high if high >= low else -1.0


# The dynamic program --------------------------------------------------------------------------------------------------
@subroutine
def _curves(task: Any, room: Any, start: Any, end: Any, forth: Any, back: Any) -> Any:
    """Fill the greatest x along the stretch in the room, for each level of speed at its ends.

    Row i of ``forth`` holds the greatest x that can be reached from ``start[i]`` or less, row i of ``back`` the
    greatest from which ``end[i]`` or less can be reached; -1 where there is none. Shapes (levels, 2 * STEPS + 1). So a
    stretch takes one pass for each level, not one for each pair of levels.
    """
    rows, caps = np.empty((2 * STEPS, 2, room.rows.shape[1], 3)), room.caps
    cap_speeds(task, room, 0, STEPS, STEPS)
    for half in range(2 * STEPS):
        _limit_forwards(rows[half, 0], task, room, half)
        _limit_backwards(rows[half, 1], task, room, half)
    for level in range(start.size):
        # A level above the speed limit is impossible; -1 then runs along the whole row.
        forth[level, 0] = start[level] if start[level] <= caps[0] else -1.0
        back[level, 2 * STEPS] = end[level] if end[level] <= caps[2 * STEPS] else -1.0
        for half in range(2 * STEPS):
            forth[level, half + 1] = min(caps[half + 1], _greatest(rows[half, 0], forth[level, half], -_LENGTH))
        for half in range(2 * STEPS - 1, -1, -1):
            back[level, half] = min(caps[half], _greatest(rows[half, 1], back[level, half + 1], _LENGTH))


@subroutine
def _time_between(forth: Any, back: Any) -> Any:
    """Return the time of a stretch, s, along the lesser of two curves of x: speeding up first, then slowing down."""
    time = 0.0
    for half in range(0, 2 * STEPS, 2):
        first, middle = min(forth[half], back[half]), min(forth[half + 1], back[half + 1])
        last = min(forth[half + 2], back[half + 2])
        if middle < 0.0 or last < 0.0:
            return np.inf
        time += step_time(first, middle, last, _LENGTH)
    return time


@subroutine
def _set_stretch(task: Any, room: Any, corners: Any, lines: Any) -> Any:
    """Put the stretch between the second and third of four grid nodes into the room; -1 stands for a phantom node."""
    for corner in range(4):
        if corners[corner, 0] >= 0:
            _put_node(room.nodes[corner], task, corners[corner, 0], corners[corner, 1], lines)
    if corners[0, 0] < 0:
        room.nodes[0] = 2.0 * room.nodes[1] - room.nodes[2]
    if corners[3, 0] < 0:
        room.nodes[3] = 2.0 * room.nodes[2] - room.nodes[1]
    weigh_stretch(task, room, 0, 0, STEPS)
    weigh_end(task, room, 0, STEPS)


@subroutine
def _squared_rate(speed: Any, before: Any, after: Any) -> Any:
    """Return x where the joints move at a speed, rad/s, at the node between two others.

    The spline's slope at a node is half the way from the node before to the node after.
    """
    slope_squared = 0.25 * ((after[0] - before[0]) ** 2 + (after[1] - before[1]) ** 2)
    return speed * speed / slope_squared


@subroutine
def _put_corners(row: Any, column: Any, entry: Any, exit_: Any, onward: Any, moves: Any, lines: Any, into: Any) -> Any:
    """Fill four nodes: the one before a node, the node, the next, and the one after that; return False if impossible.

    It is impossible where a node would be off the grid, or where there is a move onward from the goal or none from any
    other node. The number of moves, as ``entry`` or ``onward``, means no move: at the start, or from the goal.
    """
    into[1] = row, column
    into[0], into[3] = -1, -1
    if entry < moves.shape[0]:
        into[0] = into[1] - moves[entry]
    into[2] = into[1] + moves[exit_]
    if np.max(into[2]) >= lines or (np.min(into[2]) == lines - 1) != (onward == moves.shape[0]):
        return False
    if onward < moves.shape[0]:
        into[3] = into[2] + moves[onward]
    return np.max(into[3]) < lines


@subroutine
def _arrive(so_far: Any, start: Any, end: Any, forth: Any, back: Any, entry: Any, times: Any, origin: Any) -> Any:
    """Update the least times at the levels of a stretch's end, and their origins (entry and level of the state before).

    A pair of levels is possible if the slow-down curve to the arrival begins at or above the departure's level, and the
    speed-up curve from the departure ends at or above the arrival's.
    """
    levels = so_far.size
    for arrival in range(times.size):
        for departure in range(levels):
            if so_far[departure] == np.inf or back[arrival, 0] < start[departure]:
                continue
            if forth[departure, 2 * STEPS] >= end[arrival]:
                time = so_far[departure] + _time_between(forth[departure], back[arrival])
                if time < times[arrival]:
                    times[arrival] = time
                    origin[arrival] = entry * levels + departure


@subroutine
def _trace(origin: Any, at_goal: Any, moves: Any, lines: Any, levels: Any) -> Any:
    """Return the nodes of the path, start and goal included, by following the origins back from ``at_goal``."""
    path = np.empty((2 * lines, 2), np.int64)
    place = path.shape[0] - 1
    path[place] = lines - 1
    row, column, exit_, code = at_goal
    while True:
        place -= 1
        path[place] = row, column
        entry, level = code // levels, code % levels
        if entry == moves.shape[0]:
            return path[place:].copy()
        code = origin[row, column, entry, exit_, level]
        row, column, exit_ = row - moves[entry, 0], column - moves[entry, 1], entry


@kernel("Tuple((float64, int64[:,::1], int64))(int64[:,::1], int64[:,::1], int64, int64, float64)", may_be_long=True)
def dynamic_program(
    table: Table, moves: Integers, lines: int, levels: int, fastest: float
) -> tuple[float, Integers, int]:
    """Return the quickest path of grid nodes whose speeds at the nodes are among some levels.

    Args:
        table: The table of the fitness.
        moves: The moves from node to node, in grid steps, none negative, shape (moves, 2).
        lines: The number of lines of the grid.
        levels: The number of levels of speed, evenly from 0 to the fastest.
        fastest: The fastest level, rad/s.

    Returns:
        The time, s; the nodes, start and goal included, in grid steps, shape (nodes, 2); and the number of evaluations
        of the inverse dynamics.
    """
    task, count = task_of(table), moves.shape[0]
    room = room_of(task, 1, STEPS)
    # The state: the node (two coordinates), the move to it, the move from it, the level of speed there.
    best = np.full((lines, lines, count + 1, count, levels), np.inf)
    origin = np.full((lines, lines, count + 1, count, levels), -1)
    best[0, 0, count, :, 0] = 0.0
    at_goal, goal_time, goal_origin = np.full(4, -1), np.full(1, np.inf), np.full(1, -1)
    start, end = np.empty(levels), np.empty(levels)
    forth, back = np.empty((levels, 2 * STEPS + 1)), np.empty((levels, 2 * STEPS + 1))
    corners = np.empty((4, 2), np.int64)
    weighed = 0
    # No move decreases a coordinate, so in this order every state is final when its turn comes.
    for state in range(lines * lines * (count + 1) * count):
        # The state's number holds row, column, entry and exit, the last varying fastest.
        row, column = state // count // (count + 1) // lines, state // count // (count + 1) % lines
        entry, exit_ = state // count % (count + 1), state % count
        so_far = best[row, column, entry, exit_]
        if np.min(so_far) == np.inf:
            continue
        for onward in range(count + 1):
            if not _put_corners(row, column, entry, exit_, onward, moves, lines, corners):
                continue
            _set_stretch(task, room, corners, lines)
            weighed += STEPS + 1
            for level in range(levels):
                speed = level * fastest / (levels - 1)
                start[level] = _squared_rate(speed, room.nodes[0], room.nodes[2])
                end[level] = _squared_rate(speed, room.nodes[1], room.nodes[3])
            _curves(task, room, start, end, forth, back)
            if onward < count:
                # The next state: this stretch's exit is the move into its node.
                following = corners[2, 0], corners[2, 1], exit_, onward
                _arrive(so_far, start, end, forth, back, entry, best[following], origin[following])
            else:
                known = goal_time[0]
                _arrive(so_far, start, end, forth, back, entry, goal_time, goal_origin)
                if goal_time[0] < known:
                    at_goal[:] = row, column, exit_, goal_origin[0]
    if goal_time[0] == np.inf:
        return np.inf, np.empty((0, 2), np.int64), weighed
    return goal_time[0], _trace(origin, at_goal, moves, lines, levels), weighed


# The tree search ------------------------------------------------------------------------------------------------------
@subroutine
def _least_time(bound: Any, first: Any) -> Any:
    """Return the time of a stretch, s, at the greatest x that can be reached: a lower bound of what it takes."""
    time = 0.0
    for half in range(2 * first, 2 * (first + STEPS), 2):
        if bound[half + 1] < 0.0 or bound[half + 2] < 0.0:
            return np.inf
        time += step_time(bound[half], bound[half + 1], bound[half + 2], _LENGTH)
    return time


@kernel("Tuple((float64, int64[:,::1], int64, float64))(int64[:,::1], int64, int64)", may_be_long=True)
def tree_search(table: Table, lines: int, most: int) -> tuple[float, Integers, int, float]:
    """Search all paths from node to neighbouring node depth first, with branch and bound (§II).

    The bound of a path is its time so far at the greatest speeds that can be reached along it. These ignore that the
    arm must slow down later, so the bound is never above the true time, and no best path is cut off.

    Args:
        table: The table of the fitness.
        lines: The number of lines of the grid.
        most: The number of evaluations of the inverse dynamics after which the search ends.

    Returns:
        The best time, s; its nodes, shape (nodes, 2); the number of evaluations of the inverse dynamics; the share of
        all paths that was searched or ruled out.
    """
    task = task_of(table)
    deepest = 2 * (lines - 1)
    room = room_of(task, deepest, deepest * STEPS)
    ways = np.ones((lines, lines))  # the number of paths from each node to the goal; 1 from the last row and column
    for row in range(lines - 2, -1, -1):
        for column in range(lines - 2, -1, -1):
            # By the three moves: both joints, or one of them. The counts tell how much of the tree a cut-off branch
            # held.
            ways[row, column] = ways[row + 1, column] + ways[row, column + 1] + ways[row + 1, column + 1]
    path, chosen = np.zeros((deepest + 2, 2), np.int64), np.zeros(deepest + 2, np.int64)
    best_path, best = path[:0].copy(), np.inf
    bound, spent = np.zeros(2 * deepest * STEPS + 1), np.zeros(deepest + 2)
    rows = np.empty(room.rows.shape[1:])
    room.nodes[1] = task.ends[0]
    depth, weighed, done = 0, 0, 0.0
    # An explicit stack: ``chosen`` holds the next move to try at each depth.
    while depth >= 0 and weighed < most:
        if chosen[depth] == 3:
            depth -= 1
            continue
        move = chosen[depth]
        chosen[depth] += 1
        row, column = path[depth, 0] + (move != 1), path[depth, 1] + (move != 2)  # both joints first
        if max(row, column) >= lines:
            continue
        depth += 1
        path[depth] = row, column
        chosen[depth] = 0
        _put_node(room.nodes[depth + 1], task, row, column, lines)
        at_goal = min(row, column) == lines - 1
        spent[depth] = 0.0
        # The new node completes the stretch that ends in the node before it; at the goal, the last one too, whose far
        # control point is a phantom. The next node on another branch overwrites the phantom.
        for stretch in range(max(0, depth - 2), depth if at_goal else depth - 1):
            add_phantoms(room.nodes, depth)
            first = stretch * STEPS
            weigh_stretch(task, room, stretch, first, STEPS)
            weigh_end(task, room, stretch, first + STEPS)
            weighed += STEPS
            if not at_goal:
                cap_speeds(task, room, first, STEPS, STEPS)
                for half in range(2 * first, 2 * (first + STEPS)):
                    # Only forwards: a path's bound extends that of its parent by one stretch.
                    _limit_forwards(rows, task, room, half)
                    bound[half + 1] = min(room.caps[half + 1], _greatest(rows, bound[half], -_LENGTH))
                spent[depth] = spent[depth - 1] + _least_time(bound, first)
        if at_goal:
            room.shares[:] = 1.0
            # The whole path, timed as the fitness does, but with the steps of this module.
            time = scale_time(task, room, depth * STEPS, STEPS)
            if time < best:
                best, best_path = time, path[: depth + 1].copy()
        if at_goal or spent[depth] >= best:
            # Done with all paths through this node: at the goal the path itself, else all that the bound rules out.
            done += ways[row, column]
            depth -= 1
    return best, best_path, weighed, done / ways[0, 0]
