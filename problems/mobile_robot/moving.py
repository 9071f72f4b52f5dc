"""A mobile-robot solution over time: it turns on the spot, and moves ahead."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.motion import Body, Column, Floats, Motion, Pace, loop, straight
from problems.plane import outlines
from problems.problem import Solution

if TYPE_CHECKING:
    from problems.mobile_robot.problem import MobileRobot


def motion(problem: MobileRobot, solution: Solution, pace: Pace) -> Motion:
    """Moves at an even speed, m/s; turns at another, unless told such that no point of the robot exceeds the first."""
    speed = pace.along(problem.kind, "m/s")
    robot = problem.robot
    turn_speed = pace.turn_speed or speed / (robot.radius or robot.circumscribed_radius)
    path = np.array(solution["path"], np.float64)
    steps = np.abs(np.diff(path, axis=0))
    seconds = np.hypot(steps[:, 0], steps[:, 1]) / speed + steps[:, 2] / turn_speed
    times, poses = straight(path, seconds, pace)
    x0, y0, x1, y1 = problem.bounds
    walls = loop(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
    return Motion(times, (_body(problem, poses),), (walls, *outlines(problem.obstacles)))


def _body(problem: MobileRobot, poses: Floats) -> Body:
    x, y, heading = poses.T
    still = np.zeros(len(poses))
    outline = loop(np.array(problem.robot.vertices or [(0.0, 0.0)]), problem.robot.radius or 0.0)
    columns = (Column("x", "m", x), Column("y", "m", y), Column("heading", "rad", heading))
    return Body("", columns, np.column_stack([x, y, still]), np.column_stack([still, still, heading]), outline)
