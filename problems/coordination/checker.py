"""The verify of coordination solutions: cell by cell, with its own motions and its own arms; nothing of `evaluate`.

Where the diagram comes from two arms, it also moves them through every rectangle, in all pairs of places half a cell
apart, and measures the distance of their links; in closer places where links could come nearer to each other between.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from problems.errors import first_line
from problems.problem import Clearance, Solution, Table, Verdict

if TYPE_CHECKING:
    from problems.coordination.arms import Robot
    from problems.coordination.problem import Coordination

Floats = NDArray[np.float64]
Cell = tuple[int, int]

TOLERANCE = 1e-6  # s, and share of the time
DEPTH = 1e-6  # m, by which links may overlap
_ACCURACY = 1e-3  # of the clearance, as a share of an arm's length
_MOST_PAIRS = 1 << 16  # of places of both arms, to look at more closely
_TOGETHER = 1 << 12  # pairs whose distances are computed at once


class CoordinationSolution(Table):
    """What a solution of coordination is made of."""

    time: Annotated[float, Field(ge=0)]
    points: list[tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]]]


def verify(problem: Coordination, solution: Solution) -> Verdict:
    """The time of the sequence, or K + its obstacle cells, and all that is wrong with it."""
    claimed = _parsed(solution)
    corners = [(0, 0), *claimed.points, problem.last]
    rectangles = [(corner, following) for corner, following in pairwise(corners) if corner != following]
    time = sum(_seconds(problem, *rectangle) for rectangle in rectangles)
    hits = [_obstacles(problem, *rectangle) for rectangle in rectangles]
    clearance, collisions = (None, []) if problem.robots is None else _meeting(problem, problem.robots, rectangles)
    objections = [
        *_descents(corners),
        *_wrong_time(claimed.time, time),
        *(f"rectangle {number} holds {hit} obstacle cells" for number, hit in enumerate(hits, start=1) if hit),
        *collisions,
    ]
    return Verdict(problem.offset + sum(hits) if any(hits) else time, tuple(objections), clearance)


def _parsed(solution: Solution) -> CoordinationSolution:
    try:
        return CoordinationSolution.model_validate_json(json.dumps(solution), strict=True)
    except ValidationError as error:
        raise first_line(error, CoordinationSolution, "solution") from None


def _descents(corners: list[Cell]) -> Iterator[str]:
    for (i, j), (k, to) in pairwise(corners):
        if k < i or to < j:
            yield f"the sequence does not increase from {[i, j]} to {[k, to]}"


def _wrong_time(claimed: float, time: float) -> Iterator[str]:
    if abs(claimed - time) > TOLERANCE * max(1.0, time):
        yield f"the sequence takes {time:g} s, not {claimed:g}"


def _seconds(problem: Coordination, corner: Cell, following: Cell) -> float:
    """Of the slower robot; both gain and lose speed evenly."""
    cells = np.abs(np.subtract(following, corner))
    return max(_motion(int(count), *times) for count, times in zip(cells, problem.world.times, strict=True))


def _motion(cells: int, per_cell: float, to_speed: float) -> float:
    """Seconds for some cells, rest to rest: gaining and losing full speed each covers to_speed / 2 of cruising."""
    cruising = cells * per_cell - to_speed
    if cruising >= 0.0:
        return to_speed + cruising + to_speed
    peak = float(np.sqrt(cells * per_cell / to_speed))  # the share of full speed that is reached half-way
    return 2.0 * peak * to_speed


def _obstacles(problem: Coordination, corner: Cell, following: Cell) -> int:
    (i, j), (k, to) = corner, following
    return int(np.count_nonzero(problem.blocked[i : k + 1, j : to + 1]))


# Arms -----------------------------------------------------------------------------------------------------------------
def _meeting(
    problem: Coordination, robots: list[Robot], rectangles: list[tuple[Cell, Cell]]
) -> tuple[Clearance, list[str]]:
    """The least gap of two arms at all pairs of places that a rectangle allows, and where it is less than it may be.

    It is measured at all pairs of half cells, and if that is enough of a gap, then on between those where it could be
    less by more than `_ACCURACY`.
    """
    first, second = (_Arm(robot) for robot in robots)
    found = _Nearest(first, second)
    objections = []
    for number, (corner, following) in enumerate(rectangles, start=1):
        gap = found.measure(number, corner, following)
        if -gap > DEPTH:
            objections.append(f"in rectangle {number} the arms overlap by {-gap:.2g} m")
        elif problem.clearance - gap > DEPTH:
            objections.append(_too_near(problem, number, gap))
    if objections:
        return Clearance(found.gap, found.where), objections
    bound = found.look_closer()
    if problem.clearance - found.gap > DEPTH:
        objections.append(_too_near(problem, found.where["rectangle"], found.gap))
    return Clearance(bound, found.where), objections


def _too_near(problem: Coordination, rectangle: int, gap: float) -> str:
    return f"in rectangle {rectangle} the arms come as near as {gap:.3g} m, the clearance is {problem.clearance:g}"


class _Nearest:
    """The search for the least gap between two arms.

    No point of a link moves farther in a cell than its way. So the gap of two links at a pair of places bounds from
    below what it is around there, and pairs of places whose bounds are above what was found need no more looks.

    Attributes:
        gap: the least that was measured, m.
        where: its rectangle, the place of each arm in cells along its path, and a link of each.
    """

    def __init__(self, first: _Arm, second: _Arm) -> None:
        self.gap, self.where = np.inf, dict[str, Any]()
        self._arms, self._thickness = (first, second), first.robot.radius + second.robot.radius
        self._ways = first.ways[:, None] + second.ways[None, :]
        self._accuracy = _ACCURACY * first.length
        self._pairs: list[Floats] = []  # rectangle, the place of each arm, the rectangle's ends; see `look_closer`

    def measure(self, rectangle: int, corner: Cell, following: Cell) -> float:
        """The least gap at pairs of half cells of a rectangle, m."""
        (i, j), (k, to) = corner, following
        first, second = (arm.halves for arm in self._arms)
        others = second[2 * j : 2 * to + 1, None]
        places = np.arange(2 * j, 2 * j + len(others)) / 2
        least = np.inf
        for half, one in enumerate(first[2 * i : 2 * k + 1] if self._ways.size and len(others) else (), start=2 * i):
            pairs = np.column_stack(np.broadcast_arrays(rectangle, half / 2, places, i, j, k, to)).astype(np.float64)
            least = min(least, self._see(one[:, None], others, pairs, 0.25, self._pairs))
        return least

    def look_closer(self) -> float:
        """Halve the distances between places until nothing is left to be found.

        Returns:
            the least gap, or, if there is too much to look at, a bound of it.
        """
        half = 0.25  # of what lies around a place, cells
        while True:
            rows = np.concatenate([np.empty((0, 8)), *self._pairs])
            rows = rows[rows[:, -1] < self.gap - self._accuracy]
            if not len(rows):
                return self.gap
            if len(rows) > _MOST_PAIRS:
                return float(rows[:, -1].min())
            half /= 2.0
            corners = half * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
            pairs = np.repeat(rows[:, :-1], 4, axis=0)
            pairs[:, 1:3] = np.clip(pairs[:, 1:3] + np.tile(corners, (len(rows), 1)), pairs[:, 3:5], pairs[:, 5:7])
            self._pairs = []
            for some in np.array_split(pairs, -(-len(pairs) // _TOGETHER)):
                one, other = (arm.links(places) for arm, places in zip(self._arms, some[:, 1:3].T, strict=True))
                self._see(one[:, :, None], other[:, None], some, half, self._pairs)

    def _see(self, one: Floats, other: Floats, pairs: Floats, half: float, left: list[Floats]) -> float:
        """Measure links at pairs of places; those around which there may be less come to what is ``left``."""
        gaps = _distances(one, other) - self._thickness
        pair, link, facing = np.unravel_index(np.argmin(gaps), gaps.shape)
        least = float(gaps[pair, link, facing])
        if least < self.gap:
            links = [arm.number_of(each) for arm, each in zip(self._arms, (link, facing), strict=True)]
            self.gap = least
            self.where = {"rectangle": int(pairs[pair, 0]), "cells": pairs[pair, 1:3].tolist(), "links": links}
        if least - half * self._ways.max() < self.gap - self._accuracy:
            bounds = (gaps - half * self._ways).min(axis=(1, 2))
            near = bounds < self.gap - self._accuracy
            left.append(np.column_stack([pairs[near], bounds[near]]))
        return least


class _Arm:
    """An arm, and where its links are."""

    def __init__(self, robot: Robot) -> None:
        lengths = np.hypot(robot.d, robot.a)
        self.robot, self.length = robot, float(lengths.sum())
        self._is_there = lengths > 0.0
        self.ways = _ways(robot, lengths)[self._is_there]  # the farthest that a point of a link moves in a cell, m
        self.halves = self.links(np.arange(2 * robot.cells - 1) / 2)

    def links(self, where: Floats) -> Floats:
        """The axes of the links at places along the path, in cells, (n,), to (n, links, 2, 3), m."""
        places, number = np.unique(where, return_inverse=True)
        return _links(self.robot, places)[:, self._is_there][number]

    def number_of(self, link: np.intp) -> int:
        """Return the number of the joint, from 1, of a link among those that are there."""
        return int(np.flatnonzero(self._is_there)[link]) + 1


def _ways(robot: Robot, lengths: Floats) -> Floats:
    """A bound of how far a point of each link moves in a cell, m: the turn of each joint times the links from there."""
    steps = np.abs(np.diff(np.array(robot.path), axis=0))
    along = np.linalg.norm(steps, axis=1, keepdims=True)
    turns = np.divide(steps, along, out=np.zeros(steps.shape), where=along > 0.0) * along.sum() / (robot.cells - 1)
    ends = np.cumsum(lengths)
    ways: Floats = (turns @ np.triu(ends[None, :] - (ends - lengths)[:, None])).max(axis=0)
    return ways


def _distances(segments: Floats, others: Floats) -> Floats:
    """The distances of segments, (.., 2, 3) each: across if both are nearest within, else from an end of one."""
    p, q = segments[..., 0, :], others[..., 0, :]
    u, v, w = segments[..., 1, :] - p, others[..., 1, :] - q, p - q
    uu, uv, vv, uw, vw = (np.sum(x * y, axis=-1) for x, y in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    skew = uu * vv - uv * uv
    parallel = skew <= 1e-12 * uu * vv
    skew = np.where(parallel, 1.0, skew)
    s, t = (uv * vw - vv * uw) / skew, (uu * vw - uv * uw) / skew
    within = ~parallel & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    across = np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)
    ends = [_from_end(p, others), _from_end(p + u, others), _from_end(q, segments), _from_end(q + v, segments)]
    return np.minimum(np.where(within, across, np.inf), np.minimum.reduce(ends))


def _from_end(point: Floats, segments: Floats) -> Floats:
    """The distances of points from segments."""
    start, along = segments[..., 0, :], segments[..., 1, :] - segments[..., 0, :]
    share = np.sum((point - start) * along, axis=-1) / np.sum(along * along, axis=-1)
    away: Floats = np.linalg.norm(point - start - np.clip(share, 0.0, 1.0)[..., None] * along, axis=-1)
    return away


def _links(robot: Robot, where: Floats) -> Floats:
    """The axes of an arm's links at places along its path, in cells, (n,), to (n, joints, 2, 3), m.

    By turning the stretched-out arm about its joints' axes, the last joint first.
    """
    angles = _configurations(robot, where)
    joints = angles.shape[1]
    pivots, axes = _at_rest(robot)
    ends = np.tile(pivots, (len(angles), 1, 1))
    for joint in reversed(range(joints)):
        beyond = ends[:, joint + 1 :] - pivots[joint]
        ends[:, joint + 1 :] = pivots[joint] + _turned(beyond, axes[joint], angles[:, joint, None, None])
    links: Floats = np.stack([ends[:, :-1], ends[:, 1:]], axis=2)
    return links


def _configurations(robot: Robot, where: Floats) -> Floats:
    """Joint angles at places along the path, in cells, (n,), to (n, joints)."""
    corners = np.array(robot.path)
    passed = np.concatenate([[0.0], np.linalg.norm(np.diff(corners, axis=0), axis=1)]).cumsum()
    return np.stack([np.interp(where * passed[-1] / (robot.cells - 1), passed, angles) for angles in corners.T], axis=1)


def _at_rest(robot: Robot) -> tuple[Floats, Floats]:
    """The origins, (joints + 1, 3), and the joints' axes, (joints, 3), when all angles are 0."""
    x, z, heading = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.array(robot.base[3])
    x, origin = _turned(x, z, heading), np.array(robot.base[:3])
    origins, axes = [origin], []
    for d, a, alpha in zip(robot.d, robot.a, robot.alpha, strict=True):
        axes.append(z)
        origin = origin + d * z + a * x
        z = _turned(z, x, np.array(alpha))
        origins.append(origin)
    return np.array(origins), np.array(axes)


def _turned(vectors: Floats, axis: Floats, angle: Floats) -> Floats:
    """Vectors, (.., 3), turned about a unit axis (Rodrigues)."""
    along = (vectors @ axis)[..., None] * axis
    return along + np.cos(angle) * (vectors - along) + np.sin(angle) * np.cross(axis, vectors)
