"""Exact answers to compare arm-ik with: enumeration, the arm's reach in closed form, and a local solver.

Nothing here is used by `evaluate`: kinematics and collisions are those of `problems.arm_ik.checker`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from problems.arm_ik import checker
from problems.arm_ik.reach import missed_by
from problems.errors import BadInput
from problems.plane import Circle
from problems.problem import Answer, Solution

if TYPE_CHECKING:
    from problems.arm_ik.model import ArmIkModel

Floats = NDArray[np.float64]

MOST_BITS = 22
"""The longest genome for which all coded configurations are enumerated."""

_CLOSE = 1e-6  # m: a local solution this close to the lower bound counts as the optimum
_SAMPLES = 4000  # random configurations, of which the best free ones are starts
_STARTS = 40  # of the local solver


def solve_exactly(problem: ArmIkModel) -> Answer:
    """Return the optimum over all coded configurations if these are few, else bounds over all configurations."""
    bits = len(problem.arm.links) * problem.bits
    if bits <= MOST_BITS:
        fitness, configuration = enumerate_best(problem)
        solution = None if configuration is None else _solution(problem, configuration)
        return Answer("optimum", fitness, f"enumeration of all {1 << bits} coded configurations", solution)
    return _bounds(problem)


def _bounds(problem: ArmIkModel) -> Answer:
    """Return an upper bound, with a lower one beside it; an optimum if they meet; a lower bound if nothing is found."""
    least = missed_by(problem)
    configuration = solve_locally(problem)
    if configuration is None:
        return Answer("lower bound", least, "the arm's reach; no free configuration was found by chance")
    solution = _solution(problem, configuration)
    closed = solution["distance"] - least <= _CLOSE
    return Answer(
        "optimum" if closed else "upper bound",
        solution["distance"],
        "SLSQP from random free configurations, coded or not" + (", at the limit of the arm's reach" if closed else ""),
        solution,
        {"lower_bound": least},
    )


def enumerate_best(problem: ArmIkModel) -> tuple[float, Floats | None]:
    """Return the least distance of all free coded configurations, m, and the first configuration that has it.

    Configurations are tried in the order of their distance, so only few are tested for collisions.

    Returns:
        +inf and None if no coded configuration is free.

    Raises:
        BadInput: if a genome has more than `MOST_BITS` bits.
    """
    bits = len(problem.arm.links) * problem.bits
    if bits > MOST_BITS:
        raise BadInput(f"enumeration: expected at most {MOST_BITS} bits in all, found {bits}")
    codes = np.arange(1 << problem.bits)
    lowest, ranges = problem.joint_ranges
    angles = lowest + ranges * codes[:, None] / problem.steps  # (codes, joints)
    # From a joint to the tip in the frame of the link before, for all codes of the joints from that one on. The first
    # of these joints varies slowest, so an index unravels into the codes of joint 1, joint 2, ..
    beyond: Any = np.zeros(1, np.complex128)
    for length, turns in zip(problem.arm.links[::-1], np.exp(1j * angles.T[::-1]), strict=True):
        beyond = (turns[:, None] * (length + beyond)).ravel()
    distances = np.abs(complex(*problem.arm.base) + beyond - complex(*problem.target))
    for code in np.argsort(distances, kind="stable"):
        places = np.unravel_index(code, (len(codes),) * len(problem.arm.links))
        configuration: Floats = np.array([angles[place, joint] for joint, place in enumerate(places)])
        if checker.is_free(problem, configuration.tolist()):
            return float(distances[code]), configuration
    return np.inf, None


def solve_locally(problem: ArmIkModel) -> Floats | None:
    """Return the best free configuration, rad, that a local solver finds from many starts.

    The starts are the best free ones of many random configurations, which compete, too. Return None if no random
    configuration is free.
    """
    lowest, ranges = problem.joint_ranges
    samples = lowest + ranges * np.random.default_rng(1992).random((_SAMPLES, len(ranges)))
    free = [sample for sample in samples if checker.is_free(problem, sample.tolist())]
    best: list[Floats] = sorted(free, key=lambda sample: _distance(problem, sample))[:_STARTS]
    least = missed_by(problem)
    for start in list(best):
        found = _descend(problem, start)
        if checker.is_free(problem, found.tolist()):
            best.append(found)
            if _distance(problem, found) - least <= _CLOSE:
                break
    return min(best, key=lambda each: _distance(problem, each), default=None)


def _descend(problem: ArmIkModel, start: Floats) -> Floats:
    """Return where SLSQP ends from ``start``: in a local minimum of the squared distance, if it converges.

    The clearances are constraints, but the result may violate them slightly, so the caller must test it.
    """
    from scipy.optimize import minimize

    lowest, ranges = problem.joint_ranges
    limits = None if problem.arm.limits is None else list(zip(lowest, lowest + ranges, strict=True))
    clear = {"type": "ineq", "fun": lambda configuration: _clearances(problem, configuration)}
    found = minimize(
        lambda configuration: _squared_distance(problem, configuration),
        start,
        jac=True,
        method="SLSQP",
        bounds=limits,
        constraints=[clear],
        options={"maxiter": 200, "ftol": 1e-18},
    ).x
    ended: Floats = lowest + (found - lowest) % (2.0 * np.pi) if limits is None else np.clip(found, *np.array(limits).T)
    return ended


def _distance(problem: ArmIkModel, configuration: Floats) -> float:
    return float(np.sqrt(_squared_distance(problem, configuration)[0]))


def _squared_distance(problem: ArmIkModel, configuration: Floats) -> tuple[float, Floats]:
    """Return the squared distance of the tip to the target, m², and its gradient by the joint angles."""
    joints = checker.joints_of(problem.arm, configuration.tolist())
    missed = joints[-1] - complex(*problem.target)
    turning = 1j * (joints[-1] - joints[:-1])  # how the tip moves per rad of each joint: in a circle around it
    return float(abs(missed) ** 2), 2.0 * (missed.conjugate() * turning).real


def _clearances(problem: ArmIkModel, configuration: Floats) -> Floats:
    """Return the clearances of links from obstacles and from links that are not neighbours, m, less those required.

    A bare link in a polygon has minus the length inside, not the depth: that is cheap, and grows with the overlap.
    """
    links = np.array(checker.links_of(checker.joints_of(problem.arm, configuration.tolist())))
    gaps = [np.full(1, 1.0)]  # a constraint that always holds, so that there is one even without obstacles
    for obstacle in problem.obstacles:
        if isinstance(obstacle, Circle):
            gaps.append(
                shapely.distance(links, shapely.Point(obstacle.center)) - obstacle.radius - problem.reach_of_links
            )
        else:
            inside = shapely.length(shapely.intersection(links, obstacle.polygon))
            gaps.append(shapely.distance(links, obstacle.polygon) - inside - problem.reach_of_links)
    if problem.self_collision:
        one, other = np.triu_indices(len(links), k=2)
        gaps.append(shapely.distance(links[one], links[other]) - problem.apart)
    return np.concatenate(gaps)


def _solution(problem: ArmIkModel, configuration: Floats) -> Solution:
    tip = checker.joints_of(problem.arm, configuration.tolist())[-1]
    return {
        "configuration": configuration.tolist(),
        "tip": [tip.real, tip.imag],
        "distance": float(abs(tip - complex(*problem.target))),
    }
