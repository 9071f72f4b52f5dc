"""Bounds of how far the points of each body move when a variable changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from problems.robots.arm import PRISMATIC
from problems.robots.chain import Chain
from problems.robots.shapes import placed

Floats = NDArray[np.float64]

_SIDES = 64  # of the polygon around a circle
_SLACK = 1.0 + 1e-9  # against rounding


@dataclass(frozen=True, eq=False)
class _Region:
    """A set that contains a body in the frame of some joint: the hull of corners within a ball."""

    corners: Floats  # (m, 3)
    centre: Floats
    radius: float

    def moved(self, placement: Floats) -> _Region:
        """Return the region in the frame in which this frame has a placement."""
        return _Region(placed(placement, self.corners), placed(placement, self.centre), self.radius)

    def from_point(self, point: Floats) -> float:
        """Return a bound of the distance from a point."""
        of_corners = float(np.linalg.norm(self.corners - point, axis=1).max())
        return min(of_corners, float(np.linalg.norm(self.centre - point)) + self.radius)

    def from_axis(self, axis: Floats) -> float:
        """Return a bound of the distance from an axis through the origin."""
        of_corners = float(np.linalg.norm(_across(self.corners, axis), axis=1).max())
        return min(of_corners, float(np.linalg.norm(_across(self.centre, axis))) + self.radius)

    def along(self, axis: Floats) -> tuple[float, float]:
        """Return bounds of the least and the greatest coordinate along an axis."""
        heights, middle = np.einsum("ni,i->n", self.corners, axis), float((self.centre * axis).sum())
        return max(float(heights.min()), middle - self.radius), min(float(heights.max()), middle + self.radius)

    def turned(self, axis: Floats) -> _Region:
        """Return the region of all that a full turn about an axis through the origin sweeps."""
        radius, (low, high) = self.from_axis(axis), self.along(axis)
        across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        across /= np.linalg.norm(across)
        angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
        ring = np.cos(angles)[:, None] * across + np.sin(angles)[:, None] * np.cross(axis, across)
        ring *= radius / np.cos(np.pi / _SIDES)
        # A turn leaves the distance from every point of the axis as it is: any of them may be the ball's centre.
        heights = (0.0, float((self.centre * axis).sum()), (low + high) / 2)
        radius, height = min((self.from_point(each * axis), each) for each in heights)
        return _Region(np.concatenate([ring + low * axis, ring + high * axis]), height * axis, radius)

    def shifted(self, one: Floats, other: Floats) -> _Region:
        """Return the region of all that a shift from one place to another sweeps."""
        corners = np.concatenate([self.corners + one, self.corners + other])
        return _Region(corners, self.centre + (one + other) / 2, self.radius + float(np.linalg.norm(other - one)) / 2)


def _across(points: Floats, axis: Floats) -> Floats:
    """Return the components of points that are perpendicular to an axis."""
    across: Floats = points - np.einsum("...i,i->...", points, axis)[..., None] * axis
    return across


def reach_of(chain: Chain, points: Sequence[Floats]) -> Floats:
    """Return the most that any point of each body moves per unit of each variable, shape (B, n); see `Arm.reach`.

    A point at the distance r from a revolute joint's axis moves by at most r per rad. The distance depends on the
    joints between the axis and the point. So a region that contains the body is carried inwards from joint to joint,
    and swept by each: by a full turn or by the range of a prismatic joint.

    Args:
        chain: the bodies.
        points: for each body points in its frame, (m, 3), whose hull contains all of the body; may be empty.
    """
    reach = np.zeros((len(chain.parents), len(chain.joints)))
    for body, own in enumerate(points):
        if not len(own):
            continue
        middle = (own.min(axis=0) + own.max(axis=0)) / 2
        region, joint = _Region(own, middle, float(np.linalg.norm(own - middle, axis=1).max())), body
        while joint > 0:
            variable, (multiplier, offset), axis = chain.variables[joint], chain.scales[joint], chain.axes[joint]
            if chain.kinds[joint] == PRISMATIC:
                most = 1.0
                region = region.shifted(*(chain.limits[variable] * multiplier + offset)[:, None] * axis)
            else:
                most = region.from_axis(axis)
                region = region.turned(axis)
            # Several joints that follow one variable add up.
            reach[body, variable] += abs(multiplier) * most * _SLACK
            region = region.moved(chain.placements[joint])
            joint = int(chain.parents[joint])
    return reach
