"""OMPL's sampling planners in the joint space of a planar arm, with this project's collision test: rivals of arm-path.

Only this module needs the extra `ompl`.
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np

from benchmarks.arm_path_worlds import same_arm
from problems.arm_path import ArmPath

PLANNERS = ("RRTConnect", "BITstar")
LIMIT = 5.0  # s, to find a way
IMPROVING = 0.5  # s more, for planners that improve what they have found

_STEP = 0.01  # rad: how far apart configurations along a motion are tested


class Way(NamedTuple):
    """What a planner found.

    Attributes:
        seconds: until the first way; None if it found none in time.
        length: the sum of all turns of all joints, shortened, rad.
    """

    seconds: float | None
    length: float | None


def plan(problem: ArmPath, planner: str, seed: int) -> Way:
    """One run of a planner, for joints with limits."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed)
    setup = _setup(problem, base, geometric)
    chosen = getattr(geometric, planner)(setup.getSpaceInformation())
    setup.setPlanner(chosen)
    cost = getattr(chosen, "bestCost", None)  # of the best way so far, where a planner goes on
    began = time.perf_counter()
    found = np.inf

    def is_over() -> bool:
        nonlocal found
        now = time.perf_counter() - began
        if np.isinf(found) and cost is not None and np.isfinite(cost().value()):
            found = now
        return bool(now > LIMIT if np.isinf(found) else now > found + IMPROVING)

    setup.solve(base.PlannerTerminationCondition(is_over))
    if not setup.haveExactSolutionPath():
        return Way(None, None)
    seconds = min(found, time.perf_counter() - began)
    setup.simplifySolution()
    rows = np.array([_angles(problem, state) for state in setup.getSolutionPath().getStates()])
    return Way(seconds, float(np.abs(np.diff(rows, axis=0)).sum()))


def _angles(problem: ArmPath, state: Any) -> list[float]:
    return [state[joint] for joint in range(len(problem.arm.links))]


def _setup(problem: ArmPath, base: Any, geometric: Any) -> Any:
    assert problem.arm.limits is not None
    space = base.RealVectorStateSpace(len(problem.arm.links))
    bounds = base.RealVectorBounds(len(problem.arm.links))
    for joint, (lowest, highest) in enumerate(problem.arm.limits):
        bounds.setLow(joint, lowest)
        bounds.setHigh(joint, highest)
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    arm = same_arm(problem)

    def is_free(state: Any) -> bool:
        return bool(np.isfinite(arm.distances(np.array([_angles(problem, state)]))[0]))

    setup.setStateValidityChecker(is_free)
    setup.getSpaceInformation().setStateValidityCheckingResolution(_STEP / space.getMaximumExtent())
    setup.setStartAndGoalStates(*(_state(space, configuration) for configuration in (problem.start, problem.goal)))
    return setup


def _state(space: Any, configuration: list[float]) -> Any:
    state = space.allocState()
    for joint, angle in enumerate(configuration):
        state[joint] = angle
    return state
