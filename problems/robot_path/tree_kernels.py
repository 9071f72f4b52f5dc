"""Bidirectional trees (RRT-Connect, Kuffner and LaValle 2000), grown by counter-based random numbers.

One tree begins at the start, the other at all goals. The smaller one grows a step towards a random point, or more steps
as long as they are free; then the other one tries to reach the new node. All new nodes lie on the grid of the genes.
"""

from typing import Any, NamedTuple

import numpy as np

from lowlevel.compiled import subroutine
from problems.robot_path.layout_kernels import (
    FINEST,
    MOST_POINTS,
    deviate,
    distance,
    is_same,
    pick,
    snap,
    toss,
)
from problems.robots.motion_kernels import is_way_free

_WIDTHS = (0.1, 0.3, 1.0)  # how far beyond start and goal a tree looks, as shares of the limits


class Tree(NamedTuple):
    """A tree of configurations; its roots are its own parents."""

    nodes: Any  # (joints, most): transposed, so that distances of many nodes are computed together
    parents: Any  # (most,)
    sizes: Any  # (1,): number of nodes


class Search(NamedTuple):
    """How far one search goes.

    Attributes:
        budget: the most configurations that are tested.
        longest: the greatest length of a step.
        shorter_than: only points are drawn by which a path shorter than this can lead; infinite at first.
    """

    budget: Any
    longest: Any
    shorter_than: Any


@subroutine
def _new_tree(joints: Any, most: Any) -> Any:
    return Tree(np.empty((joints, most)), np.empty(most, np.int64), np.zeros(1, np.int64))


@subroutine
def _add(tree: Any, point: Any, parent: Any) -> Any:
    """Add a node and return its index; ``parent`` -1 makes it a root."""
    new = tree.sizes[0]
    tree.nodes[:, new] = point
    tree.parents[new] = new if parent < 0 else parent
    tree.sizes[0] += 1
    return new


@subroutine
def _nearest(tree: Any, point: Any, distances: Any) -> Any:
    """Return the node nearest to a point, and how far it is."""
    count = tree.sizes[0]
    distances[:count] = 0.0
    for joint in range(point.size):
        row, value = tree.nodes[joint], point[joint]
        for node in range(count):
            distances[node] += (row[node] - value) * (row[node] - value)
    best = 0
    for node in range(1, count):
        if distances[node] < distances[best]:
            best = node
    return best, np.sqrt(distances[best])


@subroutine
def _grow_towards(tree: Any, node: Any, target: Any, task: Any, search: Any, last: Any, point: Any, here: Any) -> Any:
    """Grow from a node in steps towards a target, as long as they are free; return the last node, and if it is there.

    No step begins after the test ``last`` of the task's room. ``point`` and ``here`` are scratch. The target itself
    must be on the grid, or be an end.
    """
    here[:] = tree.nodes[:, node]
    while task.room.tests[0] < last and tree.sizes[0] < tree.parents.size:
        away = distance(here, target)
        arrives = away <= search.longest
        if arrives:
            point[:] = target
        else:
            for joint in range(here.size):
                point[joint] = here[joint] + (target[joint] - here[joint]) * (search.longest / away)
            snap(task, point)
        if not is_same(point, here):
            if not is_way_free(task.scene, here, point, task.room):
                return node, False
            node = _add(tree, point, node)
            here[:] = point
        if arrives:
            return node, True
    return node, False


@subroutine
def _draw_between(point: Any, task: Any, search: Any, first: Any, goal: Any, dice: Any) -> Any:
    """Draw a point of the ellipsoid of all paths that are short enough (Gammell et al. 2014).

    A point of the unit ball is stretched, and mirrored so that its first axis points from the start to the goal.
    """
    direct = distance(first, goal)
    long, wide = search.shorter_than / 2.0, np.sqrt(max(0.0, search.shorter_than**2 - direct**2)) / 2.0
    size = 0.0
    for joint in range(task.joints):
        point[joint] = deviate(dice)
        size += point[joint] ** 2
    scale = toss(dice) ** (1.0 / task.joints) / np.sqrt(size)
    # The mirror maps the first axis e to the direction d: x - 2 v (v·x) / (v·v) with v = e - d.
    along, square = 0.0, 0.0
    for joint in range(task.joints):
        point[joint] *= scale * (long if joint == 0 else wide)
        v = (1.0 if joint == 0 else 0.0) - (goal[joint] - first[joint]) / direct
        along, square = along + v * point[joint], square + v * v
    for joint in range(task.joints):
        v = (1.0 if joint == 0 else 0.0) - (goal[joint] - first[joint]) / direct
        mirrored = point[joint] - (2.0 * v * along / square if square > 1e-12 else 0.0)
        point[joint] = (first[joint] + goal[joint]) / 2.0 + mirrored


@subroutine
def _draw_point(point: Any, task: Any, search: Any, width: Any, first: Any, goals: Any, dice: Any) -> Any:
    """Draw a point of the grid by which a path may be short enough, or else near the box of the start and a goal."""
    goal = goals[pick(dice, goals.shape[0])]
    if np.isfinite(search.shorter_than) and search.shorter_than > distance(first, goal) > 0.0:
        _draw_between(point, task, search, first, goal, dice)
    else:
        for joint in range(task.joints):
            low, span = task.low[joint], task.step[joint] * FINEST
            least = max(low, min(first[joint], goal[joint]) - width * span)
            most = min(low + span, max(first[joint], goal[joint]) + width * span)
            point[joint] = least + (most - least) * toss(dice)
    snap(task, point)


@subroutine
def _trace(way: Any, one: Any, node: Any, other: Any, meeting: Any, of_start: Any) -> Any:
    """Fill a way from the start's root to the goal's; return the points and the goal's root, or 0 points if too many.

    ``node`` of the tree ``one`` and ``meeting`` of the other are the same point; ``of_start`` says which of the two
    trees began at the start.
    """
    if not of_start:
        one, node, other, meeting = other, meeting, one, node
    count = 1
    at = node
    while one.parents[at] != at:
        at = one.parents[at]
        count += 1
    if count > MOST_POINTS:
        return 0, 0
    at = node
    for place in range(count - 1, -1, -1):
        way[place] = one.nodes[:, at]
        at = one.parents[at]
    at = meeting
    while other.parents[at] != at:
        at = other.parents[at]
        if count >= MOST_POINTS:
            return 0, 0
        way[count] = other.nodes[:, at]
        count += 1
    return count, at


@subroutine
def grow(way: Any, first: Any, goals: Any, task: Any, search: Any, dice: Any) -> Any:
    """Search a way from a configuration to any of some goals; return its number of points, 0 if none, and the goal."""
    most = min(search.budget, 1 << 14) + goals.shape[0] + 1
    from_start, from_goals = _new_tree(task.joints, most), _new_tree(task.joints, most)
    distances, last_test = np.empty(most), task.room.tests[0] + search.budget
    scratch = np.empty((4, task.joints))
    target, new, point, here = scratch[0], scratch[1], scratch[2], scratch[3]
    _add(from_start, first, -1)
    for goal in range(goals.shape[0]):
        _add(from_goals, goals[goal], -1)
    for _ in range(4 * search.budget):  # nearly every round tests something
        if task.room.tests[0] >= last_test or max(from_start.sizes[0], from_goals.sizes[0]) >= most - 1:
            break
        width = _WIDTHS[pick(dice, 3)]
        _draw_point(target, task, search, width, first, goals, dice)
        of_start = from_start.sizes[0] <= from_goals.sizes[0]
        # The smaller tree grows: a tree in a narrow place gets as many nodes as the one outside.
        one, other = (from_start, from_goals) if of_start else (from_goals, from_start)
        near, _ = _nearest(one, target, distances)
        last, _ = _grow_towards(one, near, target, task, search, last_test, point, here)
        if last == near:
            continue
        new[:] = one.nodes[:, last]
        meeting, _ = _nearest(other, new, distances)
        meeting, arrived = _grow_towards(other, meeting, new, task, search, last_test, point, here)
        if arrived:
            return _trace(way, one, last, other, meeting, of_start)
    return 0, 0
