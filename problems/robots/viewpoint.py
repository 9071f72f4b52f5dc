"""Where to look at a motion from: across it, and from a side on which little hides it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_ELEVATIONS = (20.0, 35.0)  # degrees
_AZIMUTHS = (-60, -45, -30, 30, 45, 60, 120, 135, 150, -150, -135, -120)  # degrees; along no axis, as two would overlap
_MOST_POINTS, _MOST_SURFACE = 150, 3000


def viewpoint(ways: Sequence[Floats], points: Floats, surface: Floats, spacing: float) -> tuple[float, float]:
    """Return the elevation and azimuth, degrees, from which ways look long and few of the points are hidden.

    Args:
        ways: lines to look across, m, shape (n, 3) each.
        points: what should be seen, m, shape (n, 3).
        surface: points on all that may hide them, m, shape (n, 3).
        spacing: how far neighbours on the surface are apart, m.
    """
    steps = np.concatenate([np.empty((0, 3)), *(np.diff(way, axis=0) for way in ways)])
    points, surface = _some(points, _MOST_POINTS), _some(surface, _MOST_SURFACE)

    def merit(angles: tuple[float, float]) -> float:
        axes = picture_axes(*angles)
        return _across(steps, axes) * _seen(points @ axes.T, surface @ axes.T, spacing) ** 2

    return max(itertools.product(_ELEVATIONS, _AZIMUTHS), key=merit)


def picture_axes(elevation: float, azimuth: float) -> Floats:
    """Return the directions to the right, up and to the eye, shape (3, 3), for angles in degrees."""
    high, around = np.radians([elevation, azimuth])
    eye = np.array([np.cos(high) * np.cos(around), np.cos(high) * np.sin(around), np.sin(high)])
    right = np.array([-np.sin(around), np.cos(around), 0.0])
    return np.array([right, np.cross(eye, right), eye])


def _across(steps: Floats, axes: Floats) -> float:
    """Return how long steps look as a share of their length; 1 if there are none."""
    length = float(np.linalg.norm(steps, axis=1).sum())
    return 1.0 if length == 0.0 else float(np.linalg.norm(steps @ axes[:2].T, axis=1).sum()) / length


def _seen(points: Floats, surface: Floats, spacing: float) -> float:
    """Return the share of points before which there is no surface; all in the picture's axes."""
    if not len(points) or not len(surface):
        return 1.0
    apart = surface[None] - points[:, None]
    # What is not clearly nearer to the eye is the body to which the point itself belongs.
    hides = (np.hypot(apart[..., 0], apart[..., 1]) < spacing) & (apart[..., 2] > 2.0 * spacing)
    return 1.0 - float(hides.any(axis=1).mean())


def _some(points: Floats, most: int) -> Floats:
    return points[:: max(1, -(-len(points) // most))]
