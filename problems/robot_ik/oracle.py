"""A reference to compare robot-ik with: a local solver from many starts, by the proof's kinematics and contacts.

Nothing here is used by `evaluate`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from problems.problem import Answer, Solution
from problems.robot_ik.checker import in_tolerances, proof_of
from problems.robots.fields import rotation_of
from problems.robots.verifying import missed_by

if TYPE_CHECKING:
    from problems.robot_ik.model import RobotIkModel
    from problems.robots.proof import Proof

Floats = NDArray[np.float64]

_STARTS = 60  # of the local solver
_ANGLE_WEIGHT = 0.3  # m per rad
_CLOSE = 1e-3  # a multiple of the tolerances that counts as the optimum, 0


def solve_locally(problem: RobotIkModel) -> Answer:
    """Return the best free configuration that least squares find from random starts: an optimum if it is at the pose.

    Its fitness is that of a problem that wants one solution.
    """
    proof = proof_of(problem)
    low, high = proof.limits.T
    draws = np.random.default_rng(1992).random((_STARTS, len(low)))
    best: tuple[float, Floats] | None = None
    for start in low + (high - low) * draws:
        found = _descend(problem, proof, start)
        if next(iter(proof.contacts(found, problem.clearance)), None) is not None:
            continue
        error = in_tolerances(problem.goal_pose, *missed_by(problem.goal_pose, proof, found))
        if best is None or error < best[0]:
            best = error, found
        if error <= _CLOSE:
            break
    method = f"least squares with pinocchio's kinematics, at most {_STARTS} random starts"
    if best is None:
        return Answer("lower bound", 0.0, method + ", of which none led to a free configuration")
    solution = _solution(problem, proof, best[1])
    return Answer("optimum" if best[0] <= _CLOSE else "upper bound", best[0], method, solution)


def _descend(problem: RobotIkModel, proof: Proof, start: Floats) -> Floats:
    """Return where least squares end from a start, within the limits of the joints."""
    from scipy.optimize import least_squares

    low, high = proof.limits.T
    span = np.maximum(high - low, 1e-9)
    inner = np.clip(start, low + 1e-9 * span, high - 1e-9 * span)  # the solver wants a start inside the bounds
    found: Floats = least_squares(
        lambda configuration: _errors(problem, proof, configuration),
        inner,
        bounds=(low, low + span),
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
        max_nfev=100,
    ).x
    return np.clip(found, low, high)


def _errors(problem: RobotIkModel, proof: Proof, configuration: Floats) -> Floats:
    """Return the errors of the position, m, and of the nine elements of the rotation, weighted."""
    target, pose = problem.goal_pose, proof.pose(configuration, problem.goal_pose.link)
    shift: Floats = pose[:3, 3] - target.position
    if target.quaternion is None:
        return shift
    return np.concatenate([shift, _ANGLE_WEIGHT * (pose[:3, :3] - rotation_of(target.quaternion)).ravel()])


def _solution(problem: RobotIkModel, proof: Proof, configuration: Floats) -> Solution:
    away, turned = missed_by(problem.goal_pose, proof, configuration)
    solution = {
        "configuration": configuration.tolist(),
        "position_error": away,
        "angle_error": turned,
        "clearance": min(1.0, proof.gap(configuration)[0]),
    }
    return solution if problem.solutions == 1 else solution | {"others": []}
