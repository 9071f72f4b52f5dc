"""Verify robot-ik solutions with pinocchio and on the exact meshes; nothing here is used by `evaluate`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field, ValidationError

from problems.errors import BadInput, first_line
from problems.problem import Clearance, Solution, Verdict
from problems.robots import verifying
from problems.robots.fields import GoalPose
from problems.robots.verifying import missed_by
from problems.tables import Table

if TYPE_CHECKING:
    from problems.robot_ik.model import RobotIkModel
    from problems.robots.proof import Configuration, Proof

_ROUNDING = 1e-7  # m or rad: of errors that a solution states
_GAP_ROUNDING = 1e-5  # m: of its clearance; planner and proof both measure to a few micrometres
_MOST_CLEARANCE = 1.0  # m: solutions state no greater distance
_CONTACT, _MISSING = 10.0, 100.0  # what contact and each missing solution add to the fitness, see the docs
_MOST_CONTACTS = 3  # in a message


class IkSolution(Table):
    """The format of a robot-ik solution."""

    configuration: list[float]
    position_error: Annotated[float, Field(ge=0)]
    angle_error: Annotated[float, Field(ge=0)]
    clearance: Annotated[float, Field(ge=0, le=_MOST_CLEARANCE + _GAP_ROUNDING)]
    others: list[list[float]] | None = None


def verify(problem: RobotIkModel, solution: Solution) -> Verdict:
    """Return the error in multiples of the tolerances, all objections, and the least distance that is kept, m.

    Raises:
        BadInput: if this is no solution of robot-ik for this robot.
    """
    proof = proof_of(problem)
    claimed = _parsed(problem, proof, solution)
    several = [claimed.configuration, *(claimed.others or [])]
    misses = [missed_by(problem.goal_pose, proof, each) for each in several]
    error = max(in_tolerances(problem.goal_pose, *each) for each in misses)
    objections = [text for number, each in enumerate(several) for text in _objections(problem, proof, number, each)]
    if len(several) > 1:
        objections += [*_not_solved(problem, several, misses), *_alike(problem, proof, several)]
    gaps = [(*proof.gap(each), each) for each in several]
    least, between, nearest = min(gaps, key=lambda gap: gap[0])
    objections += _wrong_claims(claimed, misses, least)
    where = {"configuration": list(nearest), "between": list(between)} if between else {}
    touches = not claimed.clearance > problem.clearance
    if touches:
        objections.append(f"nothing shows that the clearance of {problem.clearance:g} m is kept")
    fitness = error + (_CONTACT if touches else 0.0) + _MISSING * (problem.solutions - len(several))
    return Verdict(fitness, tuple(dict.fromkeys(objections)), Clearance(least, where))


def proof_of(problem: RobotIkModel) -> Proof:
    """Return the proof of the problem's robot and scene.

    Raises:
        BadInput: if pinocchio or coal is not installed, or robot and scene do not fit.
    """
    return verifying.proof_of(problem, problem.self_collision)


def in_tolerances(target: GoalPose, away: float, turned: float) -> float:
    """Return the greater of a distance, m, and an angle, rad, each as a multiple of its tolerance."""
    return max(away / target.position_tolerance, turned / target.angle_tolerance)


def _parsed(problem: RobotIkModel, proof: Proof, solution: Solution) -> IkSolution:
    try:
        claimed = IkSolution.model_validate_json(json.dumps(solution), strict=True)
    except ValidationError as error:
        raise first_line(error, IkSolution, "solution") from None
    if (claimed.others is not None) != (problem.solutions > 1):
        expected = "a list, as more than one solution is wanted" if problem.solutions > 1 else "none"
        raise BadInput(f"solution: others: expected {expected}, found {claimed.others}")
    several = [claimed.configuration, *(claimed.others or [])]
    if len(several) > problem.solutions:
        raise BadInput(f"solution: others: expected at most {problem.solutions - 1}, found {len(several) - 1}")
    for each in several:
        if len(each) != len(proof.joints):
            raise BadInput(f"solution: configuration: expected {len(proof.joints)} values, found {len(each)}")
    return claimed


def _objections(problem: RobotIkModel, proof: Proof, number: int, configuration: Configuration) -> Iterator[str]:
    """Yield what is wrong with one of the configurations: limits and contacts."""
    begin = "" if problem.solutions == 1 else f"solution {number + 1}: "
    yield from (begin + text for text in proof.beyond_limits(configuration))
    for contact in proof.contacts(configuration, problem.clearance)[:_MOST_CONTACTS]:
        yield begin + contact.in_words(problem.clearance)


def _not_solved(
    problem: RobotIkModel, several: Sequence[Configuration], misses: Sequence[tuple[float, float]]
) -> Iterator[str]:
    """Yield those of several solutions that miss the pose: only a single one may be the best that there is."""
    for number, (away, turned) in enumerate(misses):
        if in_tolerances(problem.goal_pose, away, turned) > 1.0 + _ROUNDING:
            yield f"solution {number + 1} is {away:.3g} m and {turned:.3g} rad from the pose"


def _alike(problem: RobotIkModel, proof: Proof, several: Sequence[Configuration]) -> Iterator[str]:
    for (one, first), (other, second) in combinations(enumerate(several), 2):
        difference = np.abs(np.subtract(first, second))
        # Angles that differ by whole turns are the same.
        around = np.abs(difference - 2.0 * np.pi * np.round(difference / (2.0 * np.pi)))
        if np.where(proof.turning, around, difference).max() < problem.apart - _ROUNDING:
            yield f"solutions {one + 1} and {other + 1} differ by less than {problem.apart:g} in every joint"


def _wrong_claims(claimed: IkSolution, misses: Sequence[tuple[float, float]], least: float) -> Iterator[str]:
    away, turned = np.max(misses, axis=0)
    if abs(claimed.position_error - away) > _ROUNDING:
        yield f"the link is {away:.4g} m from the pose, not {claimed.position_error:.4g} m"
    if abs(claimed.angle_error - turned) > _ROUNDING:
        yield f"the link is turned by {turned:.4g} rad from the pose, not {claimed.angle_error:.4g} rad"
    if claimed.clearance > least + _GAP_ROUNDING:
        yield f"the robot keeps {least:.4g} m, not {claimed.clearance:.4g} m"
