"""Verify robot-path solutions on the exact meshes, by `problems.robots.proof`; nothing here is used by `evaluate`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field, ValidationError

from problems.errors import BadInput, first_line
from problems.problem import Clearance, Solution, Verdict
from problems.robots import trajectory as timing
from problems.robots.fields import GoalPose
from problems.robots.verifying import missed_by, proof_of, refuse_standing_contacts
from problems.tables import Table

if TYPE_CHECKING:
    from problems.robot_path.model import RobotPathModel
    from problems.robots.proof import Proof

TOLERANCE = 1e-6  # of joints, rad or m, and of lengths and distances
_NOT_FREE = 1000.0  # the fitness of a path that the planner has not proven, beside the length of what is not
_MOST_CONTACTS = 3  # in a message

Path = Sequence[Sequence[float]]


class PathSolution(Table):
    """The format of a robot-path solution."""

    path: Annotated[list[list[float]], Field(min_length=2)]
    length: Annotated[float, Field(ge=0)]
    clearance: Annotated[float, Field(ge=0)]
    blocked: Annotated[float, Field(gt=0)] | None = None
    trajectory: timing.Trajectory | None = None


def verify(problem: RobotPathModel, solution: Solution) -> Verdict:
    """Return the length of the path, rad, all objections, and the least distance that it keeps, m.

    Raises:
        BadInput: if this is no solution of robot-path for this robot.
    """
    claimed = _parsed(problem, solution)
    proof = proof_of(problem)
    found = proof.of_path(claimed.path, problem.clearance)
    length = float(np.linalg.norm(np.diff(np.array(claimed.path), axis=0), axis=1).sum())
    objections = [
        *_wrong_ends(problem, proof, claimed.path),
        *found.objections,
        *_wrong_numbers(claimed, length, found.least),
        *_wrong_motion(problem, proof, claimed),
    ]
    fitness = length
    if claimed.blocked is not None:
        fitness = _NOT_FREE + claimed.blocked
        objections.append("the planner has not proven the path free")
    return Verdict(fitness, tuple(objections), Clearance(found.least, found.where))


def refuse_blocked_ends(problem: RobotPathModel) -> None:
    """Refuse a problem whose start touches something, or all of whose goals do.

    Raises:
        ValueError: names the pairs, and how deep they overlap.
    """
    refuse_standing_contacts(problem)
    proof = proof_of(problem)
    if not problem.ends:
        raise ValueError(_why_out_of_reach(problem))
    objection = _objection_at(problem, proof, problem.start)
    if objection is not None:
        raise ValueError(f"start: expected a free configuration, found one where {objection}")
    objections = [_objection_at(problem, proof, goal) for goal in problem.ends]
    if None not in objections:
        name = "goal" if problem.goal is not None else "goals"
        raise ValueError(f"{name}: expected a free configuration, found one where {objections[0]}")


def _why_out_of_reach(problem: RobotPathModel) -> str:
    """Return why no free configuration that reaches the goal pose was found."""
    from problems.robot_path.goals import reach

    pose = problem.goal_pose
    if pose is None:
        return "goals: expected at least one configuration, found none"
    found = reach(problem.scene, np.array(problem.start), pose)
    if found.reaching:
        return (
            f"goal_pose: expected a pose that {pose.link} can reach without contact, found one where all "
            f"{found.reaching} configurations that were found touch something"
        )
    turned = "" if pose.quaternion is None else f" and {found.turn:.3g} rad"
    return (
        f"goal_pose: expected a pose that {pose.link} can reach, found one that it misses by {found.away:.3g} m{turned}"
    )


def objections_to(problem: RobotPathModel, path: Path) -> tuple[str, ...]:
    """Return why the segments of a path are not free; empty if they are."""
    return proof_of(problem).of_path(path, problem.clearance).objections


def _objection_at(problem: RobotPathModel, proof: Proof, configuration: Sequence[float]) -> str | None:
    contacts = proof.contacts(configuration, problem.clearance)
    words = [each.in_words(problem.clearance) for each in contacts[:_MOST_CONTACTS]]
    return "; ".join(words) if words else None


def _parsed(problem: RobotPathModel, solution: Solution) -> PathSolution:
    try:
        claimed = PathSolution.model_validate_json(json.dumps(solution), strict=True)
    except ValidationError as error:
        raise first_line(error, PathSolution, "solution") from None
    for row in claimed.path:
        if len(row) != len(problem.start):
            raise BadInput(f"solution: path: expected {len(problem.start)} values in each row, found {len(row)}")
    return claimed


def _wrong_ends(problem: RobotPathModel, proof: Proof, path: Path) -> Iterator[str]:
    if np.abs(np.subtract(path[0], problem.start)).max() > TOLERANCE:
        yield f"the path starts at {list(path[0])}, not at {problem.start}"
    if problem.goal_pose is not None:
        yield from _off_the_pose(problem.goal_pose, proof, path[-1])
    else:
        away = min((np.abs(np.subtract(path[-1], goal)) for goal in problem.ends), key=np.max)
        if away.max() > TOLERANCE:
            joint = proof.joints[int(np.argmax(away))]
            yield f"the path ends {away.max():.3g} rad or m from the nearest goal in joint {joint}"


def _off_the_pose(target: GoalPose, proof: Proof, configuration: Sequence[float]) -> Iterator[str]:
    """Yield an objection if a configuration does not reach the pose within its tolerances."""
    away, turn = missed_by(target, proof, configuration)
    if away > target.position_tolerance + TOLERANCE:
        yield f"at the end {target.link} is {away:.3g} m from the goal pose"
    if turn > target.angle_tolerance + TOLERANCE:
        yield f"at the end {target.link} is turned by {turn:.3g} rad from the goal pose"


def _wrong_motion(problem: RobotPathModel, proof: Proof, claimed: PathSolution) -> tuple[str, ...]:
    """Return the objections to the trajectory, if there is one; the way between its rows is proven too."""
    if claimed.trajectory is None:
        return ()

    def proven(path: Path, room: float) -> tuple[str, ...]:
        objections: tuple[str, ...] = proof.of_path(path, problem.clearance + room).objections
        return objections

    return timing.objections_to(claimed.trajectory, claimed.path, problem.robot, problem.scene.arm.joints, proven)


def _wrong_numbers(claimed: PathSolution, length: float, least: float) -> Iterator[str]:
    if abs(claimed.length - length) > TOLERANCE * max(1.0, length):
        yield f"the path is {length:.6g} rad long, not {claimed.length:.6g}"
    if claimed.clearance > least + TOLERANCE:
        yield f"the path keeps {least:.4g} m, not {claimed.clearance:.4g} m"
