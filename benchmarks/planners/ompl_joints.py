"""OMPL's sampling planners in the joint space of a planar arm, with this project's collision test: rivals of arm-path.

Only this module needs the extra `ompl`.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from benchmarks.arm_path_worlds import same_arm
from benchmarks.planners import ompl_run
from problems.arm_path import ArmPath

LIMITS = ompl_run.Limits(finding=5.0, improving=0.5)

_STEP = 0.01  # rad between tested configurations along a motion


def plan(problem: ArmPath, planner: str, seed: int) -> ompl_run.Way:
    """Run a planner once, for joints with limits; the length is the sum of all turns of all joints, rad."""
    return ompl_run.plan(partial(_setup, problem), planner, seed, LIMITS, partial(_turns, problem))


def _turns(problem: ArmPath, states: list[Any]) -> float:
    rows = np.array([_angles(problem, state) for state in states])
    return float(np.abs(np.diff(rows, axis=0)).sum())


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
