"""Outlines of bodies in the plane, for pictures."""

import numpy as np
from numpy.typing import NDArray


def capsule(start: NDArray[np.float64], end: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Return the outline of all points within ``radius`` of the segment from ``start`` to ``end``, shape (n, 2)."""
    bearing = np.arctan2(*(end - start)[::-1])
    half = np.linspace(-np.pi / 2, np.pi / 2, 19)
    angles = np.concatenate([bearing + half, bearing + np.pi + half])
    centres = np.repeat([end, start], len(half), axis=0)
    outline: NDArray[np.float64] = centres + radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return outline
