"""The exact answers that arm-ik is held against: enumeration, reach in closed form, and a local solver.

No genetic algorithm here, and nothing that `evaluate` uses: kinematics and collisions are those of the verify.
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
    from problems.arm_ik.problem import ArmIk

Floats = NDArray[np.float64]

MOST_BITS = 22
"""Of a genome, so that all that there are can be tried."""

_CLOSE = 1e-6  # m: a local solver has hit a target that is missed by no more
_SAMPLES = 4000
_STARTS = 40


def solve_exactly(problem: ArmIk) -> Answer:
    """The optimum of all coded configurations, if these are few; else what bounds that of all configurations."""
    bits = len(problem.arm.links) * problem.bits
    if bits <= MOST_BITS:
        fitness, configuration = enumerate_best(problem)
        solution = None if configuration is None else _solution(problem, configuration)
        return Answer("optimum", fitness, f"enumeration of all {1 << bits} coded configurations", solution)
    return _bounds(problem)


def _bounds(problem: ArmIk) -> Answer:
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


def enumerate_best(problem: ArmIk) -> tuple[float, Floats | None]:
    """The least distance of all coded configurations that are free, m, and the first configuration that has it.

    They are tried in the order of their distance; +inf and None if none is free.

    Raises:
        BadInput: if the codes are too many.
    """
    bits = len(problem.arm.links) * problem.bits
    if bits > MOST_BITS:
        raise BadInput(f"enumeration: expected at most {MOST_BITS} bits in all, found {bits}")
    codes = np.arange(1 << problem.bits)
    lowest, ranges = problem.joint_ranges
    angles = lowest + ranges * codes[:, None] / problem.steps  # (codes, joints)
    beyond: Any = np.zeros(1, np.complex128)  # from a joint to the tip, for all angles of the joints from there on
    for length, turns in zip(problem.arm.links[::-1], np.exp(1j * angles.T[::-1]), strict=True):
        beyond = (turns[:, None] * (length + beyond)).ravel()
    distances = np.abs(complex(*problem.arm.base) + beyond - complex(*problem.target))
    for code in np.argsort(distances, kind="stable"):
        places = np.unravel_index(code, (len(codes),) * len(problem.arm.links))
        configuration: Floats = np.array([angles[place, joint] for joint, place in enumerate(places)])
        if checker.is_free(problem, configuration.tolist()):
            return float(distances[code]), configuration
    return np.inf, None


def solve_locally(problem: ArmIk) -> Floats | None:
    """The best configuration that a local solver finds from many starts: those free ones of random ones that are best.

    None if not even a random one is free.
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


def _descend(problem: ArmIk, start: Floats) -> Floats:
    """A local minimum of the squared distance, within the limits and clear of everything."""
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


def _distance(problem: ArmIk, configuration: Floats) -> float:
    return float(np.sqrt(_squared_distance(problem, configuration)[0]))


def _squared_distance(problem: ArmIk, configuration: Floats) -> tuple[float, Floats]:
    """With its gradient: a joint turns the tip about itself."""
    joints = checker.joints_of(problem.arm, configuration.tolist())
    missed = joints[-1] - complex(*problem.target)
    turning = 1j * (joints[-1] - joints[:-1])
    return float(abs(missed) ** 2), 2.0 * (missed.conjugate() * turning).real


def _clearances(problem: ArmIk, configuration: Floats) -> Floats:
    """Of each link from each obstacle and from links that are no neighbours, m; negative if they overlap."""
    links = np.array(checker.links_of(checker.joints_of(problem.arm, configuration.tolist())))
    gaps = [np.full(1, 1.0)]
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


def _solution(problem: ArmIk, configuration: Floats) -> Solution:
    tip = checker.joints_of(problem.arm, configuration.tolist())[-1]
    return {
        "configuration": configuration.tolist(),
        "tip": [tip.real, tip.imag],
        "distance": float(abs(tip - complex(*problem.target))),
    }
