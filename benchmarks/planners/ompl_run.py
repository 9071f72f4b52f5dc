"""Run a sampling planner of OMPL once and time it until its first way. The rivals in all spaces share this module.

Only this module and the modules that set up a space for it need the extra `ompl`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

PLANNERS = ("RRTConnect", "BITstar")


class Way(NamedTuple):
    """The result of a planner.

    Attributes:
        seconds: the time until the first way; None if none was found in time.
        length: the length of the shortened way, in the unit of the space.
    """

    seconds: float | None
    length: float | None


class Limits(NamedTuple):
    """The time limits of a planner.

    Attributes:
        finding: s, until it must have a way.
        improving: s after that, for planners that improve a way.
    """

    finding: float
    improving: float


def plan(
    make_setup: Callable[[Any, Any], Any], planner: str, seed: int, limits: Limits, length: Callable[[list[Any]], float]
) -> Way:
    """Run a planner once.

    Args:
        make_setup: returns the problem's ``SimpleSetup``, from OMPL's modules ``base`` and ``geometric``.
        planner: one of ``PLANNERS``.
        seed: the seed of OMPL's own random numbers.
        limits: the planner's time limits.
        length: returns the length of a way from its states.
    """
    from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed)
    setup = make_setup(base, geometric)
    chosen = getattr(geometric, planner)(setup.getSpaceInformation())
    setup.setPlanner(chosen)
    cost = getattr(chosen, "bestCost", None)  # the cost of the best way so far, for planners that improve it
    began = time.perf_counter()
    found = np.inf

    def is_over() -> bool:
        nonlocal found
        now = time.perf_counter() - began
        if np.isinf(found) and cost is not None and np.isfinite(cost().value()):
            found = now
        return bool(now > limits.finding if np.isinf(found) else now > found + limits.improving)

    setup.solve(base.PlannerTerminationCondition(is_over))
    if not setup.haveExactSolutionPath():
        return Way(None, None)
    seconds = min(found, time.perf_counter() - began)
    setup.simplifySolution()
    return Way(seconds, length(list(setup.getSolutionPath().getStates())))
