"""OMPL's sampling planners in SE(2) on the same floors, with shapely's collision test: rivals of mobile-robot.

Only this module needs the extra `ompl`.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import shapely

from benchmarks.planners import ompl_run
from problems.mobile_robot import MobileRobot
from problems.plane import Circle

LIMITS = ompl_run.Limits(finding=10.0, improving=1.0)

_ROUND = 64  # sides of the polygon that approximates a quarter of a circle
_STEP = 0.02  # m and rad, the approximate distance of tested poses along a motion


def plan(problem: MobileRobot, planner: str, seed: int) -> ompl_run.Way:
    """Run a planner once; the length is that of the path of the robot's reference point, m."""
    return ompl_run.plan(partial(_setup, problem), planner, seed, LIMITS, _length)


def _length(states: list[Any]) -> float:
    places = [(state.getX(), state.getY()) for state in states]
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


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
    """Return a function that tests by shapely whether the robot is free, as the check does."""
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
