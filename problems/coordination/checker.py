"""The judge of coordination solutions: cell by cell, with its own motions and its own arms; nothing of `evaluate`.

Where the diagram comes from two arms, it also moves them through every rectangle, in all pairs of places half a cell
apart, and measures the distance of their links.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from problems.errors import first_line
from problems.problem import Solution, Table, Verdict

if TYPE_CHECKING:
    from problems.coordination.arms import Robot
    from problems.coordination.problem import Coordination

Floats = NDArray[np.float64]
Cell = tuple[int, int]

TOLERANCE = 1e-6  # s, and share of the time
DEPTH = 1e-6  # m, by which links may overlap


class CoordinationSolution(Table):
    """What a solution of coordination is made of."""

    time: Annotated[float, Field(ge=0)]
    points: list[tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]]]


def judge(problem: Coordination, solution: Solution) -> Verdict:
    """The time of the sequence, or K + its obstacle cells, and all that is wrong with it."""
    claimed = _parsed(solution)
    corners = [(0, 0), *claimed.points, problem.last]
    rectangles = [(corner, following) for corner, following in pairwise(corners) if corner != following]
    time = sum(_seconds(problem, *rectangle) for rectangle in rectangles)
    hits = [_obstacles(problem, *rectangle) for rectangle in rectangles]
    objections = [
        *_descents(corners),
        *_wrong_time(claimed.time, time),
        *(f"rectangle {number} holds {hit} obstacle cells" for number, hit in enumerate(hits, start=1) if hit),
        *_encounters(problem, rectangles),
    ]
    return Verdict(problem.offset + sum(hits) if any(hits) else time, tuple(objections))


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
def _encounters(problem: Coordination, rectangles: list[tuple[Cell, Cell]]) -> Iterator[str]:
    """Where two arms overlap on the way."""
    if problem.robots is None:
        return
    first, second = (_links(robot) for robot in problem.robots)
    thickness = sum(robot.radius for robot in problem.robots)
    for number, ((i, j), (k, to)) in enumerate(rectangles, start=1):
        ones, others = first[2 * i : 2 * k + 1], second[2 * j : 2 * to + 1]
        gap = min((_nearest(one, others) for one in ones), default=np.inf) - thickness
        if -gap > DEPTH:
            overlap = -gap
            yield f"in rectangle {number} the arms overlap by {overlap:.2g} m"
        elif problem.clearance - gap > DEPTH:
            yield f"in rectangle {number} the arms come as near as {gap:.3g} m, the clearance is {problem.clearance:g}"


def _nearest(one: Floats, others: Floats) -> float:
    """The least distance of an arm's links, (links, 2, 3), from those of arms, (n, links, 2, 3), m."""
    return float(_distances(one[:, None], others[:, None]).min(initial=np.inf))


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


def _links(robot: Robot) -> Floats:
    """The axes of an arm's links at each half cell, (places, links, 2, 3), m.

    By turning the stretched-out arm about its joints' axes, the last joint first.
    """
    angles = _configurations(robot)
    joints = angles.shape[1]
    pivots, axes = _at_rest(robot)
    ends = np.tile(pivots, (len(angles), 1, 1))
    for joint in reversed(range(joints)):
        beyond = ends[:, joint + 1 :] - pivots[joint]
        ends[:, joint + 1 :] = pivots[joint] + _turned(beyond, axes[joint], angles[:, joint, None, None])
    links: Floats = np.stack([ends[:, :-1], ends[:, 1:]], axis=2)
    return links[:, np.hypot(robot.d, robot.a) > 0.0]


def _configurations(robot: Robot) -> Floats:
    """Joint angles at each half cell, evenly along the path; shape (2 · cells − 1, joints)."""
    corners = np.array(robot.path)
    passed = np.concatenate([[0.0], np.linalg.norm(np.diff(corners, axis=0), axis=1)]).cumsum()
    where = np.linspace(0.0, passed[-1], 2 * robot.cells - 1)
    return np.stack([np.interp(where, passed, angles) for angles in corners.T], axis=1)


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
