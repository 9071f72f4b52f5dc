"""One run of a sampling planner of OMPL, timed until its first way: what the rivals in any space share.

Only this module and those that set up a space for it need the extra `ompl`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

PLANNERS = ("RRTConnect", "BITstar")


class Way(NamedTuple):
    """What a planner found.

    Attributes:
        seconds: until the first way; None if it found none in time.
        length: of the way, shortened, in the unit of the space that was searched.
    """

    seconds: float | None
    length: float | None


class Limits(NamedTuple):
    """How long a planner may take.

    Attributes:
        finding: s, until it has a way.
        improving: s more, for planners that improve what they have found.
    """

    finding: float
    improving: float


def plan(
    make_setup: Callable[[Any, Any], Any], planner: str, seed: int, limits: Limits, length: Callable[[list[Any]], float]
) -> Way:
    """One run of a planner.

    Args:
        make_setup: from OMPL's modules ``base`` and ``geometric``, the ``SimpleSetup`` of what is to be solved.
        planner: one of ``PLANNERS``.
        seed: of OMPL's own random numbers.
        limits: its time.
        length: of a way, from its states.
    """
    from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed)
    setup = make_setup(base, geometric)
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
        return bool(now > limits.finding if np.isinf(found) else now > found + limits.improving)

    setup.solve(base.PlannerTerminationCondition(is_over))
    if not setup.haveExactSolutionPath():
        return Way(None, None)
    seconds = min(found, time.perf_counter() - began)
    setup.simplifySolution()
    return Way(seconds, length(list(setup.getSolutionPath().getStates())))
