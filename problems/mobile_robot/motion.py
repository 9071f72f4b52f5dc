"""The motion of a mobile-robot solution: turns on the spot and drives ahead, each from rest to rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.motion import Body, Column, Floats, Motion, Pace, loop
from problems.plane import outlines
from problems.problem import Solution
from problems.profile import drive

if TYPE_CHECKING:
    from problems.mobile_robot.model import MobileRobotModel


def motion(problem: MobileRobotModel, solution: Solution, pace: Pace) -> Motion:
    """Return the motion at most at --speed, m/s.

    If no speed of turns is given, they are so slow that no point of the robot exceeds --speed.
    """
    speed, gain = pace.moving(problem.kind, "m")
    robot = problem.robot
    turn, turn_gain = pace.turning(speed.value, gain.value, robot.radius or robot.circumscribed_radius)
    path = np.array(solution["path"], np.float64)
    way = drive(path, (speed.value, gain.value), (turn.value, turn_gain.value), pace)
    x0, y0, x1, y1 = problem.bounds
    walls = loop(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
    obstacles = (walls, *outlines(problem.obstacles))
    return Motion(way.times, (_body(problem, way.rows),), obstacles, (speed, gain, turn, turn_gain), way.notes)


def _body(problem: MobileRobotModel, poses: Floats) -> Body:
    x, y, heading = poses.T
    still = np.zeros(len(poses))
    outline = loop(np.array(problem.robot.vertices or [(0.0, 0.0)]), problem.robot.radius or 0.0)
    columns = (Column("x", "m", x), Column("y", "m", y), Column("heading", "rad", heading))
    return Body("", columns, np.column_stack([x, y, still]), np.column_stack([still, still, heading]), outline)
