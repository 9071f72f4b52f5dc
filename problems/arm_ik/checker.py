"""Verify arm-ik solutions with kinematics in complex numbers and shapely; nothing here is used by `evaluate`.

The check allows overlaps of twice `CONTACT`, the evaluation of only one, so that rounding never makes the check refuse
what the evaluation accepts.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from problems.errors import BadInput, first_line
from problems.plane import CONTACT, Circle, Obstacle
from problems.problem import Clearance, Solution, Verdict
from problems.tables import Table

if TYPE_CHECKING:
    from problems.arm_ik.model import ArmIkModel
    from problems.planar_arm.model import Arm

Coordinate = Annotated[float, Field(ge=-1e9, le=1e9)]
Joints = NDArray[np.complex128]  # (links + 1,), m

_LENIENCE = 2 * CONTACT
_ROUNDING = 1e-9  # rad, for angles; for lengths, a share of the arm's length


class ArmSolution(Table):
    """The format of an arm-ik solution."""

    configuration: list[float]
    tip: tuple[Coordinate, Coordinate]
    distance: Annotated[float, Field(ge=0)]


def verify(problem: ArmIkModel, solution: Solution) -> Verdict:
    """Return the tip's distance to the target, m (inf in collision), all objections, and the clearance.

    Raises:
        BadInput: if this is no solution of arm-ik for this arm.
    """
    claimed = _parsed(problem.arm, solution)
    joints = joints_of(problem.arm, claimed.configuration)
    distance = float(abs(joints[-1] - complex(*problem.target)))
    collisions = list(_collisions(problem, joints))
    objections = [
        *_limits_exceeded(problem.arm, claimed.configuration),
        *collisions,
        *_wrong_claims(problem.arm, claimed, joints[-1], distance),
    ]
    return Verdict(np.inf if collisions else distance, tuple(objections), _clearance(problem, claimed, joints))


def is_free(problem: ArmIkModel, configuration: Sequence[float]) -> bool:
    """Return whether the arm in a configuration, rad, touches neither an obstacle nor itself."""
    return next(_collisions(problem, joints_of(problem.arm, configuration)), None) is None


def joints_of(arm: Arm, configuration: Sequence[float]) -> Joints:
    """Return the base, the joints and the tip as complex numbers, m."""
    turns = np.cumprod(np.exp(1j * np.array(configuration)))  # the direction of each link
    return complex(*arm.base) + np.concatenate([[0], np.cumsum(arm.links * turns)])


def links_of(joints: Joints) -> list[shapely.LineString]:
    """Return the axes of the links, m."""
    points = np.column_stack([joints.real, joints.imag])
    return [shapely.LineString(points[link : link + 2]) for link in range(len(points) - 1)]


def _parsed(arm: Arm, solution: Solution) -> ArmSolution:
    try:
        claimed = ArmSolution.model_validate_json(json.dumps(solution), strict=True)
    except ValidationError as error:
        raise first_line(error, ArmSolution, "solution") from None
    if len(claimed.configuration) != len(arm.links):
        raise BadInput(f"solution: configuration: expected {len(arm.links)} angles, found {len(claimed.configuration)}")
    return claimed


def _collisions(problem: ArmIkModel, joints: Joints) -> Iterator[str]:
    links = links_of(joints)
    yield from _obstacles_hit(problem, links)
    yield from _links_touching(problem, links)


def _is_hit(link: shapely.LineString, obstacle: Obstacle, radius: float) -> bool:
    if isinstance(obstacle, Circle) or radius > _LENIENCE:
        return obstacle.is_nearer(link, radius - _LENIENCE)
    # A distance from a polygon is never negative, so for a bare link shrink the polygon instead.
    core = obstacle.polygon.buffer(-_LENIENCE, join_style="mitre")
    return bool(link.intersects(core))


def _obstacles_hit(problem: ArmIkModel, links: list[shapely.LineString]) -> Iterator[str]:
    for number, link in enumerate(links, start=1):
        for index, obstacle in enumerate(problem.obstacles):
            if _is_hit(link, obstacle, problem.arm.radius + problem.clearance):
                yield f"link {number} {_near(problem, 'is in')} obstacles[{index}]"


def _links_touching(problem: ArmIkModel, links: list[shapely.LineString]) -> Iterator[str]:
    """Yield an objection for each pair of links that touch, or are nearer to each other than the clearance."""
    if not problem.self_collision:
        return
    for one in range(len(links)):
        for other in range(one + 2, len(links)):  # neighbours share a joint, so they always touch
            if _overlap(links[one], links[other], 2 * problem.arm.radius + problem.clearance):
                touch = f"come nearer than the clearance {problem.clearance:g} m" if problem.clearance else "touch"
                yield f"links {one + 1} and {other + 1} {touch}"


def _overlap(one: shapely.LineString, other: shapely.LineString, thickness: float) -> bool:
    """Return whether two axes are nearer than ``thickness``, m, or, if that is 0, cross each other."""
    if thickness > _LENIENCE:
        return bool(one.distance(other) < thickness - _LENIENCE)
    # Bare links that touch are free: an end must stick out beyond the other link.
    ends = [*shapely.points(one.coords), *shapely.points(other.coords)]
    stick_out = min(max(end.distance(one), end.distance(other)) for end in ends)
    return bool(one.crosses(other)) and stick_out > _LENIENCE


def _near(problem: ArmIkModel, touching: str) -> str:
    """Return the verb of an objection: ``touching``, or one about the clearance if the problem has one."""
    return f"comes nearer than the clearance {problem.clearance:g} m to" if problem.clearance else touching


def _clearance(problem: ArmIkModel, claimed: ArmSolution, joints: Joints) -> Clearance:
    """Return the least gap between links and obstacles, and between links that are not neighbours, m.

    It is exact where bodies do not overlap.
    """
    links, radius = links_of(joints), problem.arm.radius
    found: list[tuple[float, dict[str, Any]]] = []
    for number, link in enumerate(links, start=1):
        for index, obstacle in enumerate(problem.obstacles):
            solid = shapely.Point(obstacle.center) if isinstance(obstacle, Circle) else obstacle.polygon
            found.append((link.distance(solid) - obstacle.thickness - radius, {"link": number, "obstacle": index}))
    if problem.self_collision:
        for one, other in combinations(range(len(links)), 2):
            if other > one + 1:
                gap = links[one].distance(links[other]) - 2 * radius
                found.append((gap, {"links": [one + 1, other + 1]}))
    least, where = min(found, key=lambda each: each[0], default=(np.inf, {}))
    return Clearance(float(least), where | {"configuration": claimed.configuration} if where else {})


def _limits_exceeded(arm: Arm, configuration: list[float]) -> Iterator[str]:
    for joint, (angle, limits) in enumerate(zip(configuration, arm.limits or [], strict=False), start=1):
        if not limits[0] - _ROUNDING <= angle <= limits[1] + _ROUNDING:
            yield f"joint {joint} is at {angle:g} rad, outside its limits {list(limits)}"


def _wrong_claims(arm: Arm, claimed: ArmSolution, tip: complex, distance: float) -> Iterator[str]:
    rounding = _ROUNDING * max(1.0, sum(arm.links), abs(tip))
    if abs(complex(*claimed.tip) - tip) > rounding:
        yield f"the tip is at {[tip.real, tip.imag]}, not at {list(claimed.tip)}"
    if abs(claimed.distance - distance) > rounding:
        yield f"the tip's distance to the target is {distance:g} m, not {claimed.distance:g}"
