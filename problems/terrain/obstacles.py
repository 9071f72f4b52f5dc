"""Which cells are obstacles, and how far from them places are, by scipy: for validation, `check` and the oracle.

The compiled fitness does not use this module; `problems.terrain.arrays` computes the same for it in another way.
"""

from collections.abc import Container, Sequence
from math import inf

import numpy as np
from numpy.typing import NDArray

HAIR = 1e-12  # a share by which distances may be too small, since contact at exactly the radius is free

Floats = NDArray[np.float64]


def obstacles_of(rows: Sequence[str], passable: Container[str]) -> NDArray[np.bool_]:
    """Return which cells of a map are obstacles, (rows, columns): those whose character is not a passable one."""
    return np.array([[character not in passable for character in row] for row in rows])


def distances_from(blocked: NDArray[np.bool_]) -> Floats:
    """Return distances from obstacles, in cells, on a grid twice as fine as the map, (2 rows + 1, 2 columns + 1).

    Places with two odd coordinates are centres of cells, those with two even ones their corners. Obstacles are squares,
    at distance 0; without obstacles all distances are infinite. The edge of the map is no obstacle.
    """
    from scipy import ndimage

    # The transform is exact here: the nearest point of a square to a centre or corner of another one is a corner or the
    # middle of a side, and all of these are places of the fine grid.
    fine = np.zeros((2 * blocked.shape[0] + 1, 2 * blocked.shape[1] + 1), bool)
    for row in range(3):
        for column in range(3):
            fine[row : row + 2 * blocked.shape[0] : 2, column : column + 2 * blocked.shape[1] : 2] |= blocked
    if not fine.any():
        return np.full(fine.shape, inf)
    found: Floats = ndimage.distance_transform_edt(~fine) / 2.0
    return found
