"""The pose of a vehicle at a configuration: the first axes move it, the others turn it about its origin.

In the plane the one angle is the heading, anticlockwise. In space one angle is the yaw; three angles are roll, pitch
and yaw: turns about the fixed axes x, y and z, in this order.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def rotations(angles: Floats, dimensions: int) -> Floats:
    """Return rotation matrices, shape (n, dimensions, dimensions), for angles, rad, of shape (n, 0, 1 or 3)."""
    turns = np.broadcast_to(np.eye(dimensions), (len(angles), dimensions, dimensions))
    axes = (2,) if angles.shape[1] == 1 else (0, 1, 2)
    for axis, angle in zip(axes, angles.T, strict=False):
        turns = _about(axis, angle, dimensions) @ turns
    return turns


def _about(axis: int, angle: Floats, dimensions: int) -> Floats:
    """Return rotation matrices about x, y or z (axis 0, 1 or 2); in the plane only about z."""
    one, other = (axis + 1) % 3, (axis + 2) % 3
    turns = np.tile(np.eye(dimensions), (len(angle), 1, 1))
    turns[:, one, one] = turns[:, other, other] = np.cos(angle)
    turns[:, other, one], turns[:, one, other] = np.sin(angle), -np.sin(angle)
    return turns
