"""A bound to compare robot-path with: no path is shorter than the straight line to the nearest goal.

Where the proof finds that line free, it is the optimum. With a goal pose, it is so for the goals that were found only:
there may be others, nearer to the start.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.problem import Answer

if TYPE_CHECKING:
    from problems.robot_path.model import RobotPathModel


def solve_exactly(problem: RobotPathModel) -> Answer:
    """Return the length of the straight line to the nearest goal: the optimum if that line is free, else a bound.

    With a goal pose it is an upper bound if the line is free, else the answer is the lower bound 0.
    """
    from problems.robot_path.checker import objections_to

    lengths = [float(np.linalg.norm(np.subtract(goal, problem.start))) for goal in problem.ends]
    nearest = int(np.argmin(lengths))
    path = [problem.start, problem.ends[nearest]]
    is_free, is_pose = not objections_to(problem, path), problem.goal_pose is not None
    line = f"the straight line to the nearest goal{' that was found' if is_pose else ''}"
    if is_free:
        solution = {"path": path, "length": lengths[nearest], "clearance": 0.0}
        return Answer("upper bound" if is_pose else "optimum", lengths[nearest], f"{line}, which is free", solution)
    if is_pose:
        return Answer("lower bound", 0.0, f"{line} is not free; other configurations that reach the pose may be nearer")
    return Answer("lower bound", lengths[nearest], f"{line}, which is not free")
