"""The verification of mobile-robot solutions by shapely, along the whole path. It shares no code with `evaluate`.

A straight move sweeps the convex hulls of the robot's edges, which shapely intersects exactly. A turn is sampled so
finely that no point of the robot moves farther than 1/250 of its circumscribed radius from one sample to the next.
Something sharp that only grazes the robot between two samples can go unseen. Overlaps up to a micrometre are allowed,
since contact is free and computed poses have rounding errors.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from problems.errors import BadInput, first_line
from problems.mobile_robot.guide_check import distance_around
from problems.plane import CONTACT, Circle, Obstacle
from problems.problem import Clearance, Solution, Verdict
from problems.tables import Table

if TYPE_CHECKING:
    from problems.mobile_robot.body import Body
    from problems.mobile_robot.model import MobileRobotModel

Coordinate = Annotated[float, Field(ge=-1e9, le=1e9)]
Pose = tuple[Coordinate, Coordinate, Coordinate]
Pieces = NDArray[Any]  # shapely geometries

TOLERANCE = 1e-6  # m and rad
_SAMPLES_A_RADIAN = 250
_FULL_TURN = 2.0 * np.pi


class RobotSolution(Table):
    """A solution of mobile-robot, as `MobileRobot.decode` writes it."""

    commands: list[tuple[Literal["rotate", "move"], float]]
    path: Annotated[list[Pose], Field(min_length=1)]
    length: Annotated[float, Field(ge=0)]


def verify(problem: MobileRobotModel, solution: Solution) -> Verdict:
    """Return the fitness of the path, by its last pose, and all that is wrong with the way there."""
    claimed = _parsed(solution)
    away, off = _short_of(problem, claimed.path[-1])
    arrived = away <= TOLERANCE and off <= TOLERANCE
    clearance = _clearance(problem, claimed.path)
    objections = [
        *_wrong_start(problem, claimed.path[0]),
        *_wrong_claims(claimed),
        # A collision is a lack of clearance too; naming it once is enough.
        *(list(_collisions(problem, claimed.path)) or _too_near(problem, clearance)),
        *_wrong_end(away, off),
    ]
    return Verdict(0.0 if arrived else _worth(problem, claimed.path[-1]), tuple(objections), clearance)


def objection_to(problem: MobileRobotModel, pose: Pose) -> str | None:
    """Return why the robot cannot stand at a pose, None if it can."""
    standing = _swept(problem.robot, pose, pose)
    thickness = (problem.robot.radius or 0.0) + problem.clearance
    if _beyond(problem, standing, thickness) > CONTACT:
        return "outside the bounds" + _nearer(problem)
    for index, obstacle in enumerate(problem.obstacles):
        if _overlaps(standing, thickness, obstacle, CONTACT).any():
            return f"in obstacles[{index}]{_nearer(problem)}"
    return None


def _nearer(problem: MobileRobotModel) -> str:
    return f", or nearer to it than the clearance, {problem.clearance:g} m" if problem.clearance > 0.0 else ""


def _parsed(solution: Solution) -> RobotSolution:
    try:
        claimed = RobotSolution.model_validate_json(json.dumps(solution), strict=True)
    except ValidationError as error:
        raise first_line(error, RobotSolution, "solution") from None
    if len(claimed.path) != len(claimed.commands) + 1:
        raise BadInput(
            f"solution: path: expected {len(claimed.commands) + 1} poses, one more than commands, "
            f"found {len(claimed.path)}"
        )
    return claimed


def _angle(difference: float) -> float:
    """Return the size of the difference of two headings, in [0, π]."""
    return abs((difference + np.pi) % _FULL_TURN - np.pi)


def _short_of(problem: MobileRobotModel, pose: Pose) -> tuple[float, float]:
    """Return how far a pose is from the goal, m and rad."""
    x, y, heading = problem.goal
    return float(np.hypot(pose[0] - x, pose[1] - y)), _angle(pose[2] - heading)


def _worth(problem: MobileRobotModel, pose: Pose) -> float:
    """Return the fitness of a path that ends at a pose short of the goal, m."""
    away, off = _short_of(problem, pose)
    if problem.guide != "straight":
        away = distance_around(problem, pose[:2])
    return away + problem.robot.circumscribed_radius * off


def _wrong_start(problem: MobileRobotModel, pose: Pose) -> Iterator[str]:
    if np.abs(np.subtract(pose, problem.start)).max() > TOLERANCE:
        yield f"the path starts at {list(pose)}, not at {list(problem.start)}"


def _wrong_end(away: float, off: float) -> Iterator[str]:
    if away > TOLERANCE:
        yield f"the path ends {away:.3g} m from the goal"
    elif off > TOLERANCE:
        yield f"the path ends {off:.3g} rad from the goal's heading"


def _wrong_claims(claimed: RobotSolution) -> Iterator[str]:
    for number, ((name, value), (pose, following)) in enumerate(
        zip(claimed.commands, pairwise(claimed.path), strict=True), start=1
    ):
        x, y, heading = pose
        if name == "rotate":
            expected = (x, y, heading + value)
        else:
            expected = (x + value * np.cos(heading), y + value * np.sin(heading), heading)
        if name == "move" and value < 0.0:
            yield f"command {number} moves backwards, by {value:g} m"
        if np.abs(np.subtract(following, expected)).max() > TOLERANCE:
            yield f"segment {number} of the path does not do what command {number} says"
    length = sum(value for name, value in claimed.commands if name == "move")
    if abs(length - claimed.length) > TOLERANCE:
        yield f"the path is {length:g} m long, not {claimed.length:g}"


def _collisions(problem: MobileRobotModel, path: list[Pose]) -> Iterator[str]:
    thickness = problem.robot.radius or 0.0
    obstacles = problem.obstacles
    # Obstacles are shrunk by the allowed overlap once, and prepared, for all segments.
    forbidden = _forbidden(obstacles, thickness, [_allowed(each) for each in obstacles])
    for number, (pose, following) in enumerate(pairwise(path), start=1):
        pieces = _swept(problem.robot, pose, following)
        beyond = _beyond(problem, pieces, thickness)
        if beyond > TOLERANCE:
            yield f"segment {number} of the path leaves the bounds by {beyond:.2g} m"
        hits = shapely.dwithin(pieces[:, None], *forbidden)
        for index in np.flatnonzero(hits.any(axis=0)).tolist():
            depth = _depth(pieces[hits[:, index]], thickness, obstacles[index])
            yield f"segment {number} of the path hits obstacles[{index}] by {depth:.2g} m"


def _clearance(problem: MobileRobotModel, path: list[Pose]) -> Clearance:
    """Return how near the robot comes to an obstacle or a wall, and in which segment (0 for a path of one pose).

    It is measured from what is swept, exactly on straight moves, at the samples on turns.
    """
    thickness = problem.robot.radius or 0.0
    round_ones = [each.radius if isinstance(each, Circle) else 0.0 for each in problem.obstacles]
    cores = np.array(
        [shapely.Point(each.center) if isinstance(each, Circle) else each.polygon for each in problem.obstacles],
        dtype=object,
    )
    # Discs count as their centres and radii, so that distances to them are exact.
    gaps = thickness + np.array(round_ones)
    least, where = np.inf, {}
    for number, (pose, following) in enumerate(list(pairwise(path)) or [(path[0], path[0])], start=len(path) > 1):
        pieces = _swept(problem.robot, pose, following)
        wall = -_beyond(problem, pieces, thickness)
        if wall < least:
            least, where = wall, {"segment": number, "obstacle": "bounds"}
        if not problem.obstacles:
            continue
        around = shapely.box(*shapely.total_bounds(pieces))
        # Only an obstacle whose distance to the sweep's bounding box is below the least so far can lower it.
        near = np.flatnonzero(shapely.distance(around, cores) - gaps < least)
        for index in near.tolist():
            here = float(shapely.distance(pieces, cores[index]).min() - gaps[index])
            if here < least:
                least, where = here, {"segment": number, "obstacle": index}
    return Clearance(float(least), where)


def _too_near(problem: MobileRobotModel, clearance: Clearance) -> Iterator[str]:
    if clearance.least < problem.clearance - TOLERANCE:
        place = clearance.where["obstacle"]
        yield (
            f"segment {clearance.where['segment']} of the path is {clearance.least:.3g} m from "
            f"{'the bounds' if place == 'bounds' else f'obstacles[{place}]'}, "
            f"nearer than the clearance, {problem.clearance:g} m"
        )


def _allowed(obstacle: Obstacle) -> float:
    """Return how deep an overlap with an obstacle may be, m.

    It is less than `TOLERANCE` for obstacles so slim that nothing of them would be left at that depth.
    """
    if isinstance(obstacle, Circle):
        return min(TOLERANCE, obstacle.radius / 2.0)
    return float(min(TOLERANCE, obstacle.polygon.area / obstacle.polygon.length / 2.0))


def _swept(body: Body, pose: Pose, following: Pose) -> Pieces:
    """Return shapes that cover a motion, without the robot's thickness if it is a disc."""
    if body.vertices is None:
        return np.array([shapely.LineString([pose[:2], following[:2]])])
    turn = float(np.clip(following[2] - pose[2], -_FULL_TURN, _FULL_TURN))  # a longer turn covers nothing new
    # A pure move has two samples: both ends, between which the hulls of the edges sweep exactly.
    samples = 2 + int(_SAMPLES_A_RADIAN * abs(turn))
    last = np.array([*following[:2], pose[2] + turn])
    outlines = _placed(body.vertices, np.linspace(np.array(pose), last, samples))
    solids: Pieces = shapely.polygons(outlines)
    if pose[:2] == following[:2]:
        return solids
    corners = np.stack([outlines, np.roll(outlines, -1, axis=1)], axis=2)  # (poses, edges, 2, 2)
    hulls = shapely.convex_hull(shapely.multipoints(np.concatenate([corners[:-1], corners[1:]], axis=2)))
    return np.concatenate([solids, hulls.ravel()])


def _placed(vertices: list[tuple[float, float]], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the robot's outline at each pose, shape (poses, corners, 2)."""
    places = poses[:, 0] + 1j * poses[:, 1]
    local = np.array(vertices) @ np.array([1.0, 1j])
    corners = places[:, None] + np.exp(1j * poses[:, 2])[:, None] * local
    return np.stack([corners.real, corners.imag], axis=-1)


def _beyond(problem: MobileRobotModel, pieces: Pieces, thickness: float) -> float:
    """Return how far some pieces, thickened, reach beyond the bounds, m; negative if they stay within."""
    west, south, east, north = shapely.total_bounds(pieces)
    x0, y0, x1, y1 = problem.bounds
    return float(max(x0 - west, y0 - south, east - x1, north - y1) + thickness)


def _overlaps(pieces: Pieces, thickness: float, obstacle: Obstacle, depth: float) -> NDArray[np.bool_]:
    """Return which pieces, thickened, are deeper in an obstacle than ``depth``."""
    overlapping: NDArray[np.bool_] = shapely.dwithin(pieces, *_forbidden([obstacle], thickness, [depth]))
    return overlapping


def _forbidden(obstacles: list[Obstacle], thickness: float, depths: list[float]) -> tuple[Pieces, NDArray[np.float64]]:
    """Return what is left of obstacles shrunk by these depths, and the distances (m) that the robot must keep to it.

    A disc keeps its centre and is shrunk by way of its distance, so that it stays exact.
    """
    cores = np.empty(len(obstacles), object)
    reaches = np.full(len(obstacles), thickness)
    for index, (obstacle, depth) in enumerate(zip(obstacles, depths, strict=True)):
        if isinstance(obstacle, Circle):
            cores[index] = shapely.Point(obstacle.center)
            reaches[index] = obstacle.radius + thickness - depth
        else:
            cores[index] = obstacle.polygon.buffer(-depth, join_style="mitre")
    shapely.prepare(cores)
    return cores, reaches


def _depth(pieces: Pieces, thickness: float, obstacle: Obstacle) -> float:
    """Return how deep some pieces, thickened, are in an obstacle, m, by bisection."""
    size = obstacle.radius if isinstance(obstacle, Circle) else np.sqrt(obstacle.polygon.area)
    low, high = 0.0, thickness + float(size)
    for _ in range(30):
        middle = (low + high) / 2.0
        if _overlaps(pieces, thickness, obstacle, middle).any():
            low = middle
        else:
            high = middle
    return low
