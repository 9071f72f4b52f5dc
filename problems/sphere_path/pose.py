"""Where a vehicle is at a configuration: its first axes move it, its others turn it about its origin.

In the plane the one angle is the heading, anticlockwise. In space one angle is the yaw; three are roll, pitch and yaw:
about x first, then y, then z, axes that stand still.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def rotations(angles: Floats, dimensions: int) -> Floats:
    """Rotation matrices, shape (n, dimensions, dimensions), for angles, rad, of shape (n, 0, 1 or 3)."""
    turns = np.broadcast_to(np.eye(dimensions), (len(angles), dimensions, dimensions))
    axes = (2,) if angles.shape[1] == 1 else (0, 1, 2)
    for axis, angle in zip(axes, angles.T, strict=False):
        turns = _about(axis, angle, dimensions) @ turns
    return turns


def _about(axis: int, angle: Floats, dimensions: int) -> Floats:
    """About x, y or z; in the plane about z alone."""
    one, other = (axis + 1) % 3, (axis + 2) % 3
    turns = np.tile(np.eye(dimensions), (len(angle), 1, 1))
    turns[:, one, one] = turns[:, other, other] = np.cos(angle)
    turns[:, other, one], turns[:, one, other] = np.sin(angle), -np.sin(angle)
    return turns
