"""Places in space as (4, 4) matrices, from and to positions and quaternions x, y, z, w."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from problems.robots.fields import rotation_of

Floats = NDArray[np.float64]

HERE: Floats = np.eye(4)
_DIGITS = 12  # that are written: far below a rounded unit quaternion's error
_MOST_AWAY = 1e6  # m: beyond what problem files may hold, and far below where sums of places would overflow
_MOST_OFF = 0.05  # by which the length of a quaternion may differ from 1: files round


def place(position: Sequence[float], quaternion: Sequence[float]) -> Floats:
    """Return a place; the quaternion 0, 0, 0, 0, which ROS means by none, is no turn.

    Raises:
        ValueError: if the quaternion is not of length 1, but for rounding, or the position is too far away.
    """
    x, y, z, w = quaternion
    length = float(np.sqrt(x * x + y * y + z * z + w * w))
    if max(map(abs, position)) > _MOST_AWAY:
        raise ValueError(f"expected a position within {_MOST_AWAY:g} m, found {list(position)}")
    matrix = np.eye(4)
    matrix[:3, 3] = position
    if length > 0.0:
        if abs(length - 1.0) > _MOST_OFF:
            raise ValueError(f"expected a unit quaternion x, y, z, w, found {list(quaternion)} of length {length:.4g}")
        matrix[:3, :3] = rotation_of((x, y, z, w))
    return matrix


def of_row(row: Floats) -> Floats:
    """Return the place of a row-major 3×4 matrix, shape (12,)."""
    matrix = np.eye(4)
    matrix[:3] = row.reshape(3, 4)
    return matrix


def inverse(matrix: Floats) -> Floats:
    """Return the inverse of a place."""
    back = np.eye(4)
    back[:3, :3] = matrix[:3, :3].T
    back[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return back


def position_of(matrix: Floats) -> list[float]:
    """Return the position, as it is written."""
    return _written(matrix[:3, 3])


def quaternion_of(matrix: Floats) -> list[float]:
    """Return the rotation of a (3, 3) or (4, 4) matrix as x, y, z, w with w ≥ 0, as it is written."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(matrix[:3, :3]).as_quat()
    return _written(-turn if turn[3] < 0.0 else turn)


def _written(values: Floats) -> list[float]:
    return [float(each) + 0.0 for each in np.round(values, _DIGITS)]  # + 0.0: no -0.0
