"""OMPL's sampling planners in SE(2) on the same floors, with shapely's collision test: rivals of mobile-robot.

Only this module needs the extra `ompl`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from problems.mobile_robot import MobileRobot
from problems.plane import Circle

PLANNERS = ("RRTConnect", "BITstar")
LIMIT = 10.0  # s, to find a way
IMPROVING = 1.0  # s more, for planners that improve what they have found

_ROUND = 64  # sides of a polygon that stands for a quarter of a circle
_STEP = 0.02  # m and rad: how far apart poses along a motion are tested, about


@dataclass(frozen=True)
class Way:
    """What a planner found.

    Attributes:
        seconds: until the first way; None if it found none in time.
        length: of the way that its reference point goes, shortened, m.
    """

    seconds: float | None
    length: float | None


def plan(problem: MobileRobot, planner: str, seed: int) -> Way:
    """One run of a planner."""
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
    states = [(state.getX(), state.getY()) for state in setup.getSolutionPath().getStates()]
    return Way(seconds, float(np.linalg.norm(np.diff(states, axis=0), axis=1).sum()))


def _setup(problem: MobileRobot, base: Any, geometric: Any) -> Any:
    space = base.SE2StateSpace()
    bounds = base.RealVectorBounds(2)
    x0, y0, x1, y1 = problem.bounds
    for axis, (low, high) in enumerate(((x0, x1), (y0, y1))):
        bounds.setLow(axis, low)
        bounds.setHigh(axis, high)
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(_validity(problem))
    setup.getSpaceInformation().setStateValidityCheckingResolution(_STEP / space.getMaximumExtent())
    setup.setStartAndGoalStates(*(_state(space, pose) for pose in (problem.start, problem.goal)))
    return setup


def _state(space: Any, pose: tuple[float, float, float]) -> Any:
    state = space.allocState()
    state.setX(pose[0])
    state.setY(pose[1])
    state.setYaw(float(np.angle(np.exp(1j * pose[2]))))
    return state


def _validity(problem: MobileRobot) -> Any:
    """Whether the robot stands free, by shapely, as the check does it."""
    solids = [
        shapely.Point(each.center).buffer(each.radius, quad_segs=_ROUND) if isinstance(each, Circle) else each.polygon
        for each in problem.obstacles
    ]
    free = shapely.box(*problem.bounds).difference(shapely.union_all(solids))
    if problem.robot.vertices is None:
        edges, radius = free.boundary, problem.robot.radius
        for geometry in (free, edges):
            shapely.prepare(geometry)

        def clear(state: Any) -> bool:
            place = shapely.Point(state.getX(), state.getY())
            return bool(free.covers(place) and not edges.dwithin(place, radius - 1e-9))

        return clear
    shapely.prepare(free)
    outline = np.array(problem.robot.vertices)

    def covered(state: Any) -> bool:
        cosine, sine = np.cos(state.getYaw()), np.sin(state.getYaw())
        placed = outline @ np.array([[cosine, sine], [-sine, cosine]]) + [state.getX(), state.getY()]
        return bool(free.covers(shapely.Polygon(placed)))

    return covered
