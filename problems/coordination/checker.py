"""Verify coordination solutions cell by cell, with its own motion law and kinematics; nothing here is in `evaluate`.

If the diagram comes from two arms, the check also measures the distances of their links in every rectangle, at all
pairs of places half a cell apart, and at closer places where the links could be nearer to each other in between.
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
from problems.problem import Clearance, Solution, Verdict
from problems.tables import Table

if TYPE_CHECKING:
    from problems.coordination.arms import Robot
    from problems.coordination.model import CoordinationModel

Floats = NDArray[np.float64]
Cell = tuple[int, int]

TOLERANCE = 1e-6  # of times: s, or a share of the time if that is more
DEPTH = 1e-6  # m, the overlap that is allowed, and the shortfall of the clearance
_ACCURACY = 1e-3  # of the measured clearance, as a share of the first arm's length
_MOST_PAIRS = 1 << 16  # pairs of places to refine; if there are more, the result is a lower bound
_TOGETHER = 1 << 12  # pairs whose distances are computed in one call


class CoordinationSolution(Table):
    """The format of a coordination solution."""

    time: Annotated[float, Field(ge=0)]
    points: list[tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]]]


def verify(problem: CoordinationModel, solution: Solution) -> Verdict:
    """Return the time of the sequence, s, or K + its obstacle cells; all objections; and the clearance of two arms.

    Raises:
        BadInput: if this is no solution of coordination.
    """
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


def _seconds(problem: CoordinationModel, corner: Cell, following: Cell) -> float:
    """Return the time that the slower robot takes from one corner of a rectangle to the other, s."""
    cells = np.abs(np.subtract(following, corner))
    return max(_motion(int(count), *times) for count, times in zip(cells, problem.world.times, strict=True))


def _motion(cells: int, per_cell: float, to_speed: float) -> float:
    """Return the seconds for a move of some cells from rest to rest, with constant acceleration and deceleration."""
    cruising = cells * per_cell - to_speed  # a ramp covers as much as to_speed / 2 at full speed
    if cruising >= 0.0:
        return to_speed + cruising + to_speed
    peak = float(np.sqrt(cells * per_cell / to_speed))  # the share of full speed that is reached half-way
    return 2.0 * peak * to_speed


def _obstacles(problem: CoordinationModel, corner: Cell, following: Cell) -> int:
    """Return the number of obstacle cells in a rectangle, both corners included."""
    (i, j), (k, to) = corner, following
    return int(np.count_nonzero(problem.blocked[i : k + 1, j : to + 1]))


# Arms -----------------------------------------------------------------------------------------------------------------
def _meeting(
    problem: CoordinationModel, robots: list[Robot], rectangles: list[tuple[Cell, Cell]]
) -> tuple[Clearance, list[str]]:
    """Return the least gap of two arms over all pairs of places that the rectangles allow, and all objections to it.

    The gap is measured at all pairs of half cells. If that raises no objection, it is also measured at closer places,
    wherever it could be less by more than `_ACCURACY`.
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


def _too_near(problem: CoordinationModel, rectangle: int, gap: float) -> str:
    return f"in rectangle {rectangle} the arms come as near as {gap:.3g} m, the clearance is {problem.clearance:g}"


class _Nearest:
    """The search for the least gap between two arms, by branch and bound.

    Each link has a known bound of how far its points move in one cell. The gap measured at a pair of places is
    therefore a lower bound, less these distances, for all places around. Pairs whose bound exceeds the least measured
    gap are not refined.

    Attributes:
        gap: the least gap measured so far, m.
        where: the rectangle, the place of each arm in cells along its path, and the link of each arm, where it is.
    """

    def __init__(self, first: _Arm, second: _Arm) -> None:
        self.gap, self.where = np.inf, dict[str, Any]()
        self._arms, self._thickness = (first, second), first.robot.radius + second.robot.radius
        self._ways = first.ways[:, None] + second.ways[None, :]
        self._accuracy = _ACCURACY * first.length
        # To be refined; the columns are the rectangle, the place of each arm, the rectangle's corners, and the bound.
        self._pairs: list[Floats] = []

    def measure(self, rectangle: int, corner: Cell, following: Cell) -> float:
        """Measure a rectangle at all pairs of half cells, and return its least gap, m."""
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
        """Halve the distances between places until no pair can have a gap that is less by more than the accuracy.

        Returns:
            the least gap, m; if too many pairs are left, a lower bound of it.
        """
        half = 0.25  # cells, half the side of the square around a pair of places
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
        """Measure links at pairs of places, and return the least gap, m.

        Args:
            one: the axes of the first arm's links, broadcast against ``other``.
            other: the axes of the second arm's links.
            pairs: the pairs, with the columns of `_pairs` but the bound.
            half: half the side of the square around each pair, cells.
            left: receives the pairs around which the gap may be less, with their bounds.
        """
        gaps = _distances(one, other) - self._thickness
        pair, link, facing = np.unravel_index(np.argmin(gaps), gaps.shape)
        least = float(gaps[pair, link, facing])
        if least < self.gap:
            links = [arm.number_of(each) for arm, each in zip(self._arms, (link, facing), strict=True)]
            self.gap = least
            self.where = {"rectangle": int(pairs[pair, 0]), "cells": pairs[pair, 1:3].tolist(), "links": links}
        if least - half * self._ways.max() < self.gap - self._accuracy:  # else no pair can have a bound that low
            bounds = (gaps - half * self._ways).min(axis=(1, 2))
            near = bounds < self.gap - self._accuracy
            left.append(np.column_stack([pairs[near], bounds[near]]))
        return least


class _Arm:
    """An arm and the places of its links; links of length 0 are left out."""

    def __init__(self, robot: Robot) -> None:
        lengths = np.hypot(robot.d, robot.a)
        self.robot, self.length = robot, float(lengths.sum())
        self._is_there = lengths > 0.0
        self.ways = _ways(robot, lengths)[self._is_there]  # the farthest that a point of a link moves in a cell, m
        self.halves = self.links(np.arange(2 * robot.cells - 1) / 2)

    def links(self, where: Floats) -> Floats:
        """Return the axes of the links at places along the path: (n,), in cells, to (n, links, 2, 3), m."""
        places, number = np.unique(where, return_inverse=True)
        return _links(self.robot, places)[:, self._is_there][number]

    def number_of(self, link: np.intp) -> int:
        """Return the number of the joint, from 1, before the link with the index ``link``."""
        return int(np.flatnonzero(self._is_there)[link]) + 1


def _ways(robot: Robot, lengths: Floats) -> Floats:
    """Return a bound of how far any point of each link moves in one cell, m.

    It is the sum, over all joints before, of the joint's greatest turn times the length of the links from there.
    """
    steps = np.abs(np.diff(np.array(robot.path), axis=0))
    along = np.linalg.norm(steps, axis=1, keepdims=True)
    turns = np.divide(steps, along, out=np.zeros(steps.shape), where=along > 0.0) * along.sum() / (robot.cells - 1)
    ends = np.cumsum(lengths)
    ways: Floats = (turns @ np.triu(ends[None, :] - (ends - lengths)[:, None])).max(axis=0)
    return ways


def _distances(segments: Floats, others: Floats) -> Floats:
    """Return the distances of segments, shape (.., 2, 3) each.

    The shortest line between two segments is either perpendicular to both, or begins at an end of one of them.
    """
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
    """Return the distances of points from segments."""
    start, along = segments[..., 0, :], segments[..., 1, :] - segments[..., 0, :]
    share = np.sum((point - start) * along, axis=-1) / np.sum(along * along, axis=-1)
    away: Floats = np.linalg.norm(point - start - np.clip(share, 0.0, 1.0)[..., None] * along, axis=-1)
    return away


def _links(robot: Robot, where: Floats) -> Floats:
    """Return the axes of an arm's links at places along its path: (n,), in cells, to (n, joints, 2, 3), m.

    Start with the arm at all zeros, and turn it about its joints' axes, the last joint first (product of exponentials).
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
    """Return the joint angles at places along the path: (n,), in cells, to (n, joints), rad."""
    corners = np.array(robot.path)
    passed = np.concatenate([[0.0], np.linalg.norm(np.diff(corners, axis=0), axis=1)]).cumsum()
    return np.stack([np.interp(where * passed[-1] / (robot.cells - 1), passed, angles) for angles in corners.T], axis=1)


def _at_rest(robot: Robot) -> tuple[Floats, Floats]:
    """Return the frames' origins, (joints + 1, 3), m, and the joints' axes, (joints, 3), with all angles at 0."""
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
    """Return vectors, (.., 3), turned about a unit axis by an angle (Rodrigues' formula)."""
    along = (vectors @ axis)[..., None] * axis
    return along + np.cos(angle) * (vectors - along) + np.sin(angle) * np.cross(axis, vectors)
