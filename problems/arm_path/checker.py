"""Verify arm-path solutions with kinematics in complex numbers and shapely; nothing here is used by `evaluate`.

A move turns everything beyond one joint. It is sampled, and the convex hull of a link at two consecutive samples covers
what the link sweeps between them up to a few micrometres. Overlaps up to that amount are allowed.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from problems.errors import BadInput, first_line
from problems.nearest import least_along
from problems.plane import CONTACT, Circle, Obstacle
from problems.problem import Clearance, Solution, Verdict
from problems.tables import Table

if TYPE_CHECKING:
    from problems.arm_path.model import ArmPathModel

Angles = NDArray[np.float64]  # (rows, links), rad
Joints = NDArray[np.complex128]  # (samples, links + 1), m
Lines = NDArray[Any]  # shapely geometries, (samples, links)
Code = Annotated[int, Field(ge=0)] | Literal["start", "goal"]

TOLERANCE = 1e-6  # of angles, rad, and of distances, m
_SAMPLES_A_RADIAN = 400
_SHARE = 1e-3  # of configuration space: for cells that only touch an obstacle, this check and the kernels may differ
_FULL_TURN = 2.0 * np.pi
_ACCURACY = 1e-3  # of the measured clearance, as a share of the arm's reach


class PathSolution(Table):
    """The format of an arm-path solution."""

    path: Annotated[list[list[float]], Field(min_length=1)]
    cspace_evaluated: Annotated[float, Field(ge=0, le=1)]
    slices: tuple[list[Code], list[Code]] | Annotated[int, Field(ge=0)]


def verify(problem: ArmPathModel, solution: Solution) -> Verdict:
    """Return the distance of the path's end from the goal, rad, all objections, and the clearance.

    Raises:
        BadInput: if this is no solution of arm-path for this arm.
    """
    claimed = _parsed(problem, solution)
    path = np.array(claimed.path)
    away = _distance_to_goal(problem, path[-1])
    objections = [
        *_wrong_start(problem, path[0]),
        *_wrong_rows(problem, path),
        *_collisions(problem, path),
        *_wrong_share(problem, claimed),
    ]
    if away > TOLERANCE:
        objections.append(f"the path ends {away:.3g} rad from the goal")
    return Verdict(0.0 if away <= TOLERANCE else away, tuple(objections), _clearance(problem, path))


def objection_to(problem: ArmPathModel, configuration: Sequence[float]) -> str | None:
    """Return why the arm cannot stand in a configuration, rad; None if it can."""
    for joint, ((lowest, highest), angle) in enumerate(zip(problem.arm.limits or [], configuration, strict=False)):
        if not lowest <= angle <= highest:
            return f"joint {joint + 1} is beyond its limits [{lowest:g}, {highest:g}]"
    lines = _lines(_joints(problem, np.array([configuration])))
    for index, obstacle in enumerate(problem.obstacles):
        if _hits(lines, obstacle, problem.arm.radius + problem.clearance - 2 * CONTACT).any():
            return f"the arm {_near(problem, 'is in')} obstacles[{index}]"
    if problem.self_collision and _touching(problem, lines[0]):
        return f"the arm {_near(problem, 'touches')} itself"
    return None


def _near(problem: ArmPathModel, touching: str) -> str:
    """Return the verb of an objection: ``touching``, or one about the clearance if the problem has one."""
    return f"comes nearer than the clearance {problem.clearance:g} m to" if problem.clearance else touching


def _parsed(problem: ArmPathModel, solution: Solution) -> PathSolution:
    try:
        claimed = PathSolution.model_validate_json(json.dumps(solution), strict=True)
    except ValidationError as error:
        raise first_line(error, PathSolution, "solution") from None
    links, levels = len(problem.arm.links), 1 << problem.bits
    for row in claimed.path:
        if len(row) != links:
            raise BadInput(f"solution: path: expected {links} angles in each row, found {len(row)}")
    # Two links list their slices, more links only count them; see `ArmPath.decode`.
    if (links == 2) == isinstance(claimed.slices, int):
        expected = "two lists of codes" if links == 2 else "a number"
        raise BadInput(f"solution: slices: expected {expected} for {links} links")
    if not isinstance(claimed.slices, int):
        for code in (*claimed.slices[0], *claimed.slices[1]):
            if isinstance(code, int) and code >= levels:
                raise BadInput(f"solution: slices: expected codes below {levels}, found {code}")
    return claimed


# The path -------------------------------------------------------------------------------------------------------------
def _distance_to_goal(problem: ArmPathModel, configuration: Angles) -> float:
    """Return the distance to the goal, rad; without joint limits, on the torus of angles."""
    difference = np.array(problem.goal) - configuration
    if problem.arm.limits is None:
        difference = (difference + np.pi) % _FULL_TURN - np.pi
    return float(np.linalg.norm(difference))


def _wrong_start(problem: ArmPathModel, row: Angles) -> Iterator[str]:
    if np.abs(row - problem.start).max() > TOLERANCE:
        yield f"the path starts at {row.tolist()}, not at {problem.start}"


def _wrong_rows(problem: ArmPathModel, path: Angles) -> Iterator[str]:
    for number, moved in enumerate(np.count_nonzero(np.diff(path, axis=0), axis=1), start=1):
        if moved != 1:
            yield f"move {number} turns {moved} joints, not one"
    for joint, (lowest, highest) in enumerate(problem.arm.limits or []):
        if path[:, joint].min() < lowest - TOLERANCE or path[:, joint].max() > highest + TOLERANCE:
            yield f"joint {joint + 1} leaves its limits [{lowest:g}, {highest:g}]"


def _collisions(problem: ArmPathModel, path: Angles) -> Iterator[str]:
    """Yield an objection for each move, and each obstacle or the arm itself, that collide."""
    objection = objection_to(problem, path[0].tolist())
    if objection is not None:
        yield f"at the start {objection}"
    for number, (row, following) in enumerate(pairwise(path), start=1):
        turn = np.clip(following - row, -_FULL_TURN, _FULL_TURN)  # more than that covers nothing new
        samples = 1 + int(_SAMPLES_A_RADIAN * np.abs(turn).max())
        joints = _joints(problem, row + np.linspace(0.0, 1.0, samples + 1)[:, None] * turn)
        moved = int(np.argmax(np.abs(turn)))  # `_wrong_rows` objects if several joints move
        # The arc between two samples rises above the hull, or the hull above an inner arc, by at most r φ² / 8:
        allowed = TOLERANCE + sum(problem.arm.links) * (np.abs(turn).max() / samples) ** 2 / 8
        swept = _swept(joints[:, moved:])
        for index, obstacle in enumerate(problem.obstacles):
            if _hits(swept, obstacle, problem.arm.radius + problem.clearance - allowed).any():
                yield f"move {number} {_near(problem, 'hits')} obstacles[{index}]"
        if problem.self_collision and _hits_itself(joints, moved, 2 * problem.arm.radius + problem.clearance - allowed):
            near = f"come nearer than the clearance {problem.clearance:g} m to" if problem.clearance else "touch"
            yield f"move {number} makes the arm {near} itself"


def _clearance(problem: ArmPathModel, path: Angles) -> Clearance:
    """Return the least clearance on the whole path, m. It exceeds the true one by at most `_ACCURACY` times the reach.

    No point moves farther than the angle of the move times the arm's reach, which is what `least_along` needs to know.
    """
    moves = [(path[0], path[0])] if len(path) == 1 else list(pairwise(path))

    def at(move: int, share: float) -> Angles:
        row, following = moves[move]
        configuration: Angles = row + share * np.clip(following - row, -_FULL_TURN, _FULL_TURN)
        return configuration

    reach = sum(problem.arm.links)
    ways = [reach * min(_FULL_TURN, float(np.abs(following - row).max())) for row, following in moves]
    least, move, share = least_along(lambda *place: _gaps(problem, at(*place))[0], ways, _ACCURACY * reach)
    where = _gaps(problem, at(move, share))[1]
    return Clearance(least, where | {"move": move + 1, "configuration": at(move, share).tolist()} if where else {})


def _gaps(problem: ArmPathModel, configuration: Angles) -> tuple[float, dict[str, Any]]:
    """Return the least gap of a configuration, m, and between which bodies it is."""
    links, radius = _lines(_joints(problem, configuration[None]))[0], problem.arm.radius
    found: list[tuple[float, dict[str, Any]]] = []
    for index, obstacle in enumerate(problem.obstacles):
        solid = shapely.Point(obstacle.center) if isinstance(obstacle, Circle) else obstacle.polygon
        gaps = shapely.distance(links, solid) - obstacle.thickness - radius
        found.append((float(gaps.min()), {"link": int(gaps.argmin()) + 1, "obstacle": index}))
    for one in range(len(links) if problem.self_collision else 0):
        for other in range(one + 2, len(links)):
            gap = float(shapely.distance(links[one], links[other])) - 2 * radius
            found.append((gap, {"links": [one + 1, other + 1]}))
    return min(found, key=lambda each: each[0], default=(float("inf"), {}))


def _joints(problem: ArmPathModel, configurations: Angles) -> Joints:
    """Return the base, the joints and the tip of each configuration: (n, links) to (n, links + 1)."""
    turns = np.exp(1j * np.cumsum(configurations, axis=1))
    steps = np.array(problem.arm.links) * turns
    start = np.full((len(configurations), 1), complex(*problem.arm.base))
    joints: Joints = np.cumsum(np.concatenate([start, steps], axis=1), axis=1)
    return joints


def _lines(joints: Joints) -> Lines:
    """Return the axes of all links."""
    ends = np.stack([joints[:, :-1], joints[:, 1:]], axis=-1)
    lines: Lines = shapely.linestrings(np.stack([ends.real, ends.imag], axis=-1))
    return lines


def _swept(joints: Joints) -> Lines:
    """Return the hulls that contain what each link sweeps between two samples, shape (samples - 1, links)."""
    corners = np.stack([joints[:-1, :-1], joints[:-1, 1:], joints[1:, :-1], joints[1:, 1:]], axis=-1)
    swept: Lines = shapely.convex_hull(shapely.multipoints(np.stack([corners.real, corners.imag], axis=-1)))
    return swept


def _hits(shapes: Lines, obstacle: Obstacle, limit: float) -> NDArray[np.bool_]:
    """Return which shapes are nearer to an obstacle than ``limit``, m, or, if that is negative, deeper in it."""
    if isinstance(obstacle, Circle):
        core, limit = shapely.Point(obstacle.center), limit + obstacle.radius
    else:
        core = obstacle.polygon
        if limit < 0.0:
            core, limit = core.buffer(limit, join_style="mitre"), 0.0
    if limit < 0.0 or core.is_empty:
        return np.zeros(shapes.shape, np.bool_)
    shapely.prepare(core)
    hit: NDArray[np.bool_] = shapely.dwithin(core, shapes, limit)
    return hit


def _touching(problem: ArmPathModel, links: Lines) -> bool:
    """Return whether links that are not neighbours touch in one configuration."""
    limit = 2 * problem.arm.radius + problem.clearance - 2 * CONTACT
    return any(
        _overlap(links[one], links[other], limit) for one in range(len(links)) for other in range(one + 2, len(links))
    )


def _overlap(one: Lines, other: Lines, limit: float) -> bool:
    """Return whether a link is nearer than ``limit``, m, to any of some others.

    If the limit is negative: whether it crosses one of them, and ends of both stick out by more than -``limit``.
    """
    if limit >= 0.0:
        return bool(np.any(shapely.dwithin(one, other, limit)))
    ends = [
        shapely.distance(shapely.get_point(link, end), rest)
        for link, rest in ((one, other), (other, one))
        for end in (0, -1)
    ]
    return bool(np.any(shapely.crosses(one, other) & (np.min(ends, axis=0) > -limit)))


def _hits_itself(joints: Joints, moved: int, limit: float) -> bool:
    """Return whether a move makes links that are not neighbours touch.

    Args:
        joints: the positions of all samples.
        moved: the joint that turns. Only links before it can meet links beyond it.
        limit: see `_overlap`. If it is negative (bare links, which may touch), only the samples are tested, not the
            hulls between them.
    """
    lines = _lines(joints)
    turning = (
        lines if limit < 0.0 else np.concatenate([np.full((len(lines) - 1, moved), None), _swept(joints[:, moved:])], 1)
    )
    return any(
        _overlap(lines[0, link], turning[:, other], limit)
        for link in range(moved)
        for other in range(max(moved, link + 2), lines.shape[1])
    )


# What was evaluated ---------------------------------------------------------------------------------------------------
def _wrong_share(problem: ArmPathModel, claimed: PathSolution) -> Iterator[str]:
    """Yield an objection if ``cspace_evaluated`` does not agree with ``slices``."""
    levels, links = 1 << problem.bits, len(problem.arm.links)
    if isinstance(claimed.slices, int):
        # A slice has `levels` cells at most. Which slices they were is not known, so no more can be checked.
        if claimed.cspace_evaluated > claimed.slices / levels ** (links - 1) * (1 + TOLERANCE):
            yield f"{claimed.slices} slices are less than the share {claimed.cspace_evaluated:g} of configuration space"
        return
    share = _evaluated(problem, claimed.slices)
    if abs(share - claimed.cspace_evaluated) > _SHARE:
        yield f"the slices evaluate {share:.4f} of configuration space, not {claimed.cspace_evaluated:.4f}"


def _evaluated(problem: ArmPathModel, slices: tuple[list[Code], list[Code]]) -> float:
    """Return the share of all cells of two joints that lie in the legal ranges of some slices."""
    levels = 1 << problem.bits
    limits = np.array(problem.arm.limits or [(0.0, _FULL_TURN)] * 2)
    steps = (limits[:, 1] - limits[:, 0]) / (levels if problem.arm.limits is None else levels - 1)
    cells = np.zeros((levels, levels), np.bool_)
    for joint, places in enumerate(slices):
        other = 1 - joint
        ends = {"start": problem.start[other], "goal": problem.goal[other]}
        for place in places:
            fixed = ends[place] if isinstance(place, str) else limits[other, 0] + steps[other] * place
            configurations = np.empty((levels, 2))
            configurations[:, joint] = limits[joint, 0] + steps[joint] * np.arange(levels)
            configurations[:, other] = fixed
            lane = np.rint((fixed - limits[other, 0]) / steps[other]).astype(int) % levels
            (cells if joint == 1 else cells.T)[lane] |= _clear(problem, configurations)
    return float(cells.mean())


def _clear(problem: ArmPathModel, configurations: Angles) -> NDArray[np.bool_]:
    """Return which configurations of two joints are clear of the obstacles."""
    lines = _lines(_joints(problem, configurations))
    clear = np.ones(len(lines), np.bool_)
    for obstacle in problem.obstacles:
        clear &= ~_hits(lines, obstacle, problem.arm.radius + problem.clearance - 2 * CONTACT).any(axis=1)
    return clear
