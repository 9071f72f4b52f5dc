"""Convert robot-path's solutions to animations: the robot along its path, with pale copies at start and goal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.animation import Animation, Floats, Ghost
from problems.errors import BadInput
from problems.motion import Joints, Pace
from problems.problem import Solution
from problems.robot_path.motion import motion
from problems.robots.animating import bodies_of, places_of, target_of, ways_of

if TYPE_CHECKING:
    from problems.robot_path.model import RobotPathModel

STEPS = 101
"""Configurations along a path, evenly spaced in time."""


def animation(problem: RobotPathModel, solution: Solution | None) -> Animation:
    """Return the robot along its path over time, or over the path's length where the URDF states no speeds.

    Without a solution the robot stands at the start, with a pale copy at the goal.
    """
    arm, start = problem.scene.arm, np.array([problem.start])
    if solution is None:
        along, name, configurations, goal = np.zeros(1), "path / rad", start, np.array(problem.ends[:1])
    else:
        along, name, configurations = _timed(problem, solution) or _lengths(solution)
        goal = np.array(solution["path"][-1:])
    frames = places_of(arm, configurations)
    link = None if problem.goal_pose is None else problem.goal_pose.link
    return Animation(
        bodies=bodies_of(problem.robot, arm, problem.obstacles, problem.attached),
        frames=frames,
        along=along,
        along_name=name,
        ghosts=(Ghost("start", places_of(arm, start)[0]), Ghost("goal", places_of(arm, goal)[0])),
        lines=ways_of(arm, frames, link) if len(frames) > 1 else (),
        targets=np.empty((0, 12)) if problem.goal_pose is None else target_of(problem.goal_pose)[None],
        names=arm.joints,
        curves=configurations,
        curves_name="joint / rad (m if prismatic)",
    )


def _timed(problem: RobotPathModel, solution: Solution) -> tuple[Floats, str, Floats] | None:
    """Return times, their name and configurations; None if the robot's speeds are not known."""
    try:
        moved = motion(problem, solution, Pace())
    except BadInput:
        return None
    (track,) = (each for each in moved.tracks if isinstance(each, Joints))
    if moved.times[-1] <= 0.0:
        return None
    times = np.linspace(0.0, moved.times[-1], STEPS)
    return times, "time / s", _at(times, moved.times, track.position)


def _lengths(solution: Solution) -> tuple[Floats, str, Floats]:
    path = np.array(solution["path"], np.float64)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    along = np.linspace(0.0, lengths[-1], STEPS)
    return along, "path / rad", _at(along, lengths, path)


def _at(along: Floats, known: Floats, rows: Floats) -> Floats:
    return np.column_stack([np.interp(along, known, column) for column in rows.T])
