"""A bound to compare robot-path with: no path is shorter than the straight line to the nearest goal.

Where the proof finds that line free, it is the optimum.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.problem import Answer

if TYPE_CHECKING:
    from problems.robot_path.model import RobotPathModel


def solve_exactly(problem: RobotPathModel) -> Answer:
    """Return the length of the straight line to the nearest goal: the optimum if that line is free, else a bound."""
    from problems.robot_path.checker import objections_to

    lengths = [float(np.linalg.norm(np.subtract(goal, problem.start))) for goal in problem.ends]
    nearest = int(np.argmin(lengths))
    path = [problem.start, problem.ends[nearest]]
    if objections_to(problem, path):
        return Answer("lower bound", lengths[nearest], "the straight line to the nearest goal, which is not free")
    solution = {"path": path, "length": lengths[nearest], "clearance": 0.0}
    return Answer("optimum", lengths[nearest], "the straight line to the nearest goal, which is free", solution)
