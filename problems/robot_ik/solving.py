"""Call the compiled search of robot-ik directly: one pose after another, in this process and without a cluster."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from problems.errors import BadInput

if TYPE_CHECKING:
    from problems.robot_ik.model import RobotIkModel

Floats = NDArray[np.float64]

_POSES = 3  # the entry of the table that holds the pose, see `problems.robot_ik.kernels`


class Found(NamedTuple):
    """The configuration that `Solver.solve` found.

    Attributes:
        configuration: the best configuration, rad or m, shape (n,).
        error: its error as a multiple of the tolerances: 1 or less if it is a solution.
        tried: the number of configurations from which steps were made.
    """

    configuration: Floats
    error: float
    tried: int


class Solver:
    """Finds one configuration for a pose by the first individuals that a cell of a run would have.

    It stops at the first solution, where a run would go on to breed. The pose may be changed from call to call; all
    else is as in the problem. Not thread-safe.

    Args:
        problem: the robot, its scene, the link and the tolerances.
    """

    def __init__(self, problem: RobotIkModel) -> None:
        from problems.robot_ik import kernels

        self._kernels = kernels
        # A copy has an operator of its own, whose table may be changed.
        own = problem.model_copy(update={"solutions": 1})
        own.__dict__.pop("_compiled", None)
        self._operator = own.fitness_kernel
        self._pose: Floats = self._operator.kept[_POSES][1]

    def solve(self, pose: ArrayLike, seed: int = 0, most: int = 2000) -> Found:
        """Return a configuration that brings the link to a pose, or the best of all that were tried.

        Args:
            pose: the frame that the link is to reach, a 4×4 or 3×4 matrix.
            seed: the seed of the draws; the same seed gives the same configuration.
            most: the number of configurations after which the search ends.

        Raises:
            BadInput: if the pose is no such matrix of finite numbers.
        """
        matrix = np.asarray(pose, float)
        if matrix.shape not in ((4, 4), (3, 4)) or not np.isfinite(matrix).all():
            raise BadInput(f"pose: expected a 4x4 or 3x4 matrix of finite numbers, found one of shape {matrix.shape}")
        self._pose[:] = matrix[:3].reshape(12)
        table = self._operator.table
        genes, error, tried = self._kernels.solve(np.uint64(seed), 0, most, table)
        configurations, _ = self._kernels.follow(genes, table)
        return Found(configurations[0], error, tried)
