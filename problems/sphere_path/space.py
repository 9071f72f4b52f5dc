"""Configuration spaces in which lengths make sense: metres along every axis.

An angle counts as an arc: it is multiplied by the distance of the vehicle's farthest point from its origin. Where
spheres are given directly, axes are taken as they are. Nothing here is compiled, and the compiled fitness calls none of
it, so that `check` may.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Space:
    """A box of configurations, some axes of which may be periodic.

    Attributes:
        bounds: The least and the greatest value of each axis, in its own unit, shape (axes, 2).
        scale: The length of a unit of each axis, shape (axes,).
        periodic: Whether each axis is periodic, shape (axes,).
    """

    bounds: Floats
    scale: Floats
    periodic: NDArray[np.bool_]

    @property
    def low(self) -> Floats:
        """The least value of each axis, as lengths."""
        return np.ascontiguousarray(self.bounds[:, 0] * self.scale)

    @property
    def span(self) -> Floats:
        """The size along each axis, as lengths."""
        return (self.bounds[:, 1] - self.bounds[:, 0]) * self.scale

    @property
    def periods(self) -> Floats:
        """The period of each axis, as a length; 0 if it has none."""
        return np.where(self.periodic, self.span, 0.0)

    @property
    def diagonal(self) -> float:
        """The length of the box's diagonal."""
        return float(np.linalg.norm(self.span))

    def detour(self, path: Floats) -> float:
        """Return how much longer a path, shape (rows, axes), is than the straight way, as a share in [0, 1).

        A detour of length x gives x / (x + diagonal), which is 1/2 if the detour is as long as the diagonal.
        """
        detour = max(0.0, length_of(path) - float(np.linalg.norm(self.shorter(path[-1] - path[0]))))
        return detour / (detour + self.diagonal)

    def shorter(self, step: Floats) -> Floats:
        """Return the same difference of places, (.., axes) lengths, but the shorter way along periodic axes."""
        # 1 stands in where there is no period, so that nothing is divided by 0; the result is not used there.
        periods = np.where(self.periodic, self.span, 1.0)
        return np.where(self.periodic, step - periods * np.floor(step / periods + 0.5), step)

    def clearances(self, path: Floats, centres: Floats) -> Floats:
        """Return how near a path, unwrapped, (rows, axes), comes to each centre, (n, axes), or an image of it: (n,).

        In closed form: the nearest point of each segment to each image of a centre that may be the nearest.
        """
        nearest = np.full(len(centres), np.inf)
        turns = [(-1, 0, 1) if periodic else (0,) for periodic in self.periodic]
        for begin, end in self._short_segments(path):
            along = end - begin
            length = float(np.linalg.norm(along))
            heading = along / length if length > 0.0 else along
            # The image nearest to the segment's beginning, then its neighbours: enough for segments of at most half a
            # period.
            offsets = self.shorter(centres - begin)
            for turn in product(*turns):
                away = offsets + np.array(turn) * self.periods
                foot = np.clip(away @ heading, 0.0, length)
                distance = np.linalg.norm(away - foot[:, None] * heading, axis=1)
                nearest = np.minimum(nearest, distance)
        return nearest

    def _short_segments(self, path: Floats) -> Iterator[tuple[Floats, Floats]]:
        """Yield the ends of segments that make up a path; none is longer than half a period along a periodic axis.

        The fitness makes only such segments, but a solution that is checked may have any. A path of one place is a
        segment of no length.
        """
        for begin, end in zip(path, path[1:] if len(path) > 1 else path, strict=False):
            halves = 2.0 * np.abs(end - begin)[self.periodic] / self.span[self.periodic]
            pieces = max(1, math.ceil(halves.max(initial=0.0)))
            yield from pairwise(np.linspace(begin, end, pieces + 1))


def length_of(path: Floats) -> float:
    """Return the length of a path, shape (rows, axes)."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
