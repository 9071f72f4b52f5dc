"""Exact answers to compare arm-path with, for two links: the whole configuration space, tested twice with shapely.

A cell is a pair of coded angles with all angles within half a code step of them. With links thickened by the greatest
sweep of half a step, a free cell is free everywhere, so a path of free cells is a motion: the problem is solvable. With
links thinned by that sweep, a blocked cell is blocked everywhere: without a path of free cells there is no motion.
Between the two the answer is unknown.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from problems.errors import BadInput
from problems.plane import Circle, Obstacle
from problems.problem import Answer, Solution

if TYPE_CHECKING:
    from problems.arm_path.model import ArmPathModel

Free = NDArray[np.bool_]  # (levels, levels), by the codes of joint 1, then of joint 2
Cell = tuple[int, int]

MOST_BITS = 9  # of an angle
_ROUNDING = 1e-12  # rad


class Grid(NamedTuple):
    """The cells of a configuration space.

    Attributes:
        surely_free: which cells are certainly free everywhere.
        maybe_free: which cells are not certainly blocked everywhere.
        start: the cell of the start.
        goal: the cell of the goal.
        is_torus: whether joints turn full circles, without limits.
    """

    surely_free: Free
    maybe_free: Free
    start: Cell
    goal: Cell
    is_torus: bool


def solve_exactly(problem: ArmPathModel) -> Answer:
    """Return whether the goal can be reached, with upper bounds of the fewest moves and the shortest way.

    Raises:
        BadInput: if the arm does not have two links, or there are too many codes.
    """
    grid = fill(problem)
    corners = fewest_moves(grid)
    figures: dict[str, float | int | bool] = {"surely_solvable": bool(corners)}
    if corners:
        solution = _solution(problem, grid, corners)
        moves, length = len(solution["path"]) - 1, round(shortest(problem, grid), 6)
        figures |= {"fewest_moves_at_most": moves, "shortest_rad_at_most": length}  # unknown cells may allow less
        return Answer("optimum", 0.0, _METHOD, solution, figures)
    unreachable = not fewest_moves(grid._replace(surely_free=grid.maybe_free))
    return Answer("lower bound", np.inf if unreachable else 0.0, _METHOD, None, figures)


_METHOD = (
    "all cells of configuration space with links thickened, and thinned, by the sweep of half a code step; "
    "fewest moves by breadth-first search, shortest way by Dijkstra, both on cells that are surely free"
)


def fill(problem: ArmPathModel) -> Grid:
    """Return the grid with all cells tested.

    Raises:
        BadInput: if the arm does not have two links, or there are too many codes.
    """
    if len(problem.arm.links) != 2 or problem.bits > MOST_BITS:
        raise BadInput(
            f"the oracle of arm-path is for 2 links and at most {MOST_BITS} bits a move, "
            f"found {len(problem.arm.links)} links and {problem.bits} bits"
        )
    one, two = problem.arm.links
    halves = problem.joint_ranges[1] / problem.steps / 2
    # Half a step of joint 1 moves all links, at most by its angle times their reach; of joint 2 only the second link.
    sweeps = (one * halves[0], (one + two) * halves[0] + two * halves[1])
    surely, maybe = (_free(problem, sign * np.array(sweeps)) for sign in (1, -1))
    start, goal = (_cell(problem, configuration) for configuration in (problem.start, problem.goal))
    return Grid(surely, maybe, start, goal, problem.arm.limits is None)


def _cell(problem: ArmPathModel, configuration: list[float]) -> Cell:
    lowest, ranges = problem.joint_ranges
    one, two = np.rint((configuration - lowest) / ranges * problem.steps).astype(int) % (1 << problem.bits)
    return int(one), int(two)


def _free(problem: ArmPathModel, thicker: NDArray[np.float64]) -> Free:
    """Return which coded configurations are clear of the obstacles if links are thickened.

    Args:
        problem: an arm of two links.
        thicker: the increase of each link's radius, m, shape (2,); negative to thin the links.
    """
    lowest, ranges = problem.joint_ranges
    angles = lowest[:, None] + ranges[:, None] * np.arange(1 << problem.bits) / problem.steps
    base = complex(*problem.arm.base)
    elbows = base + problem.arm.links[0] * np.exp(1j * angles[0])
    tips = elbows[:, None] + problem.arm.links[1] * np.exp(1j * (angles[0][:, None] + angles[1]))
    radii = problem.reach_of_links + thicker
    first = _clear(problem, _segments(np.full_like(elbows, base), elbows), radii[0])
    second = _clear(problem, _segments(np.broadcast_to(elbows[:, None], tips.shape), tips), radii[1])
    return first[:, None] & second


def _segments(starts: NDArray[np.complex128], ends: NDArray[np.complex128]) -> NDArray[np.object_]:
    points = np.stack([starts, ends], axis=-1)
    lines: NDArray[np.object_] = shapely.linestrings(np.stack([points.real, points.imag], axis=-1))
    return lines


def _clear(problem: ArmPathModel, links: NDArray[np.object_], radius: float) -> Free:
    clear = np.ones(links.shape, np.bool_)
    for obstacle in problem.obstacles:
        clear &= ~_hit(obstacle, links, radius)
    return clear


def _hit(obstacle: Obstacle, links: NDArray[np.object_], radius: float) -> Free:
    """Return which links are nearer to an obstacle than ``radius``, m, or, if that is negative, deeper in it."""
    if isinstance(obstacle, Circle):
        solid, radius = shapely.Point(obstacle.center), radius + obstacle.radius
    elif radius >= 0.0:
        solid = obstacle.polygon
    else:
        solid, radius = obstacle.polygon.buffer(radius, join_style="mitre"), 0.0
    if radius < 0.0 or solid.is_empty:
        return np.zeros(links.shape, np.bool_)
    shapely.prepare(solid)
    hit: Free = shapely.dwithin(solid, links, radius)
    return hit


def move_counts(grid: Grid) -> NDArray[np.int64]:
    """Return the fewest moves from the start's cell to each cell, by the joint that moves last, (2, levels, levels).

    Unreachable cells have -1. This is a breadth-first search that handles all cells of a move at once: one move leads
    from a cell to all cells of its run of free cells.
    """
    runs = [_runs(grid.surely_free, joint, grid.is_torus) for joint in (0, 1)]
    counts = np.full((2, *grid.surely_free.shape), -1)
    newest = [np.zeros_like(grid.surely_free) for _ in (0, 1)]
    # No joint has moved last at the start, so either may move first.
    newest[0][grid.start] = newest[1][grid.start] = grid.surely_free[grid.start]
    counts[:, grid.start[0], grid.start[1]] = np.where(grid.surely_free[grid.start], 0, -1)
    moves = 0
    while newest[0].any() or newest[1].any():
        moves += 1
        # Two moves of one joint in a row are one move, so joints alternate on every path with the fewest moves.
        reached = [_along(runs[joint], newest[1 - joint]) & (counts[joint] < 0) for joint in (0, 1)]
        for joint in (0, 1):
            counts[joint][reached[joint]] = moves
        newest = reached
    return counts


def _runs(free: Free, joint: int, is_torus: bool) -> NDArray[np.int64]:
    """Return the number of each cell's run of free cells along a joint's axis; 0 for cells that are not free."""
    lanes = free if joint == 1 else free.T
    begins = lanes & ~np.roll(lanes, 1, axis=1)
    if not is_torus:
        begins[:, 0] = lanes[:, 0]
    begins[:, 0] |= lanes.all(axis=1)  # a lane that is free all around begins nowhere else
    numbers = np.cumsum(begins).reshape(lanes.shape)
    before = np.cumsum(begins.sum(axis=1)) - begins.sum(axis=1)  # runs in earlier lanes
    across = numbers == before[:, None]  # no run of this lane has begun yet, so this one began at the lane's other end
    whole: NDArray[np.int64] = np.where(across, np.cumsum(begins.sum(axis=1))[:, None], numbers) * lanes
    return whole if joint == 1 else whole.T


def _along(runs: NDArray[np.int64], cells: Free) -> Free:
    """Return all cells that share a run with one of ``cells``."""
    reached = np.zeros(runs.max(initial=0) + 1, np.bool_)
    reached[runs[cells]] = True
    reached[0] = False
    along: Free = reached[runs]
    return along


def fewest_moves(grid: Grid) -> list[Cell]:
    """Return the corner cells of a path with the fewest moves, ends included; an empty list if there is no path."""
    counts = move_counts(grid)
    cell, corners = grid.goal, [grid.goal]
    if (counts[:, *cell] < 0).all():
        return []
    joint = int(np.argmin(np.where(counts[:, *cell] < 0, np.inf, counts[:, *cell])))
    runs = [_runs(grid.surely_free, each, grid.is_torus) for each in (0, 1)]
    while (left := counts[joint, *cell]) > 0:
        # The move before ended in the same run, with one move less, and was of the other joint (or this is the start).
        there = (runs[joint] == runs[joint][cell]) & (counts[1 - joint] == left - 1)
        one, two = np.argwhere(there)[0]
        cell, joint = (int(one), int(two)), 1 - joint
        corners.append(cell)
    return corners[::-1]


def _neighbours(grid: Grid, cell: Cell) -> Iterator[tuple[int, Cell]]:
    """Yield the surely free cells beside a cell, each with the joint that moves."""
    levels = len(grid.surely_free)
    for joint in (0, 1):
        for step in (-1, 1):
            beside = [*cell]
            beside[joint] += step
            if grid.is_torus:
                beside[joint] %= levels
            elif not 0 <= beside[joint] < levels:
                continue
            if grid.surely_free[beside[0], beside[1]]:
                yield joint, (beside[0], beside[1])


def shortest(problem: ArmPathModel, grid: Grid) -> float:
    """Return the least sum of turns from the start's cell to the goal's, rad (Dijkstra); +inf if there is no path."""
    steps = problem.joint_ranges[1] / problem.steps
    if not grid.surely_free[grid.start]:
        return float(np.inf)
    length = {grid.start: 0.0}
    heap = [(0.0, grid.start)]
    while heap:
        so_far, cell = heapq.heappop(heap)
        if cell == grid.goal:
            return so_far
        if so_far > length[cell]:
            continue
        for joint, beside in _neighbours(grid, cell):
            farther = so_far + float(steps[joint])
            if farther < length.get(beside, np.inf):
                length[beside] = farther
                heapq.heappush(heap, (farther, beside))
    return float(np.inf)


def _solution(problem: ArmPathModel, grid: Grid, corners: list[Cell]) -> Solution:
    """Return a path through the corner cells that begins and ends exactly at start and goal.

    Start and goal need not be the centres of their cells. Each joint's last move ends at its angle of the goal.
    """
    lowest, ranges = problem.joint_ranges
    steps = ranges / problem.steps
    rows = [np.array(problem.start)]

    def turn(joint: int, to: float, about: float) -> None:
        """Append a turn of ``about`` so much to the angle ``to``; on the torus, to that angle plus full turns."""
        row = rows[-1].copy()
        off = to - row[joint] - about
        row[joint] += about + (off - 2 * np.pi * np.rint(off / (2 * np.pi)) if grid.is_torus else off)
        if abs(row[joint] - rows[-1][joint]) > _ROUNDING:
            rows.append(row)

    moves = list(pairwise(corners))
    joints = [int(corner[0] == following[0]) for corner, following in moves]
    for number, (joint, (corner, following)) in enumerate(zip(joints, moves, strict=True)):
        coded = float(lowest[joint] + steps[joint] * following[joint])
        to = coded if joint in joints[number + 1 :] else problem.goal[joint]
        turn(joint, to, float(steps[joint] * _cells_along(grid, corner, following)))
    for joint in (0, 1):
        turn(joint, problem.goal[joint], 0.0)
    return {"path": [row.tolist() for row in rows], "cspace_evaluated": 0.0, "slices": [[], []]}


def _cells_along(grid: Grid, cell: Cell, following: Cell) -> int:
    """Return the number of cells of a move, negative if it goes downwards; on the torus, by the sense that is free."""
    levels, joint = len(grid.surely_free), int(cell[0] == following[0])
    lane = grid.surely_free[cell[0]] if joint == 1 else grid.surely_free[:, cell[1]]
    up = following[joint] - cell[joint]
    if not grid.is_torus:
        return up
    up %= levels
    return up if lane[(cell[joint] + np.arange(up)) % levels].all() else up - levels
