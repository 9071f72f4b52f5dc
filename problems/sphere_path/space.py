"""Configuration spaces as places between which lengths make sense: metres along every axis.

An angle counts as an arc: it is multiplied by the radius of the vehicle that turns. Where spheres are given directly,
axes are taken as they are. Nothing here is compiled, and the compiled fitness uses none of it.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Space:
    """A box of configurations, some of whose axes may close upon themselves.

    Attributes:
        bounds: the least and the greatest along each axis, in its own unit, shape (axes, 2).
        scale: what a unit of each axis is worth in lengths, shape (axes,).
        periodic: which axes close upon themselves, shape (axes,).
    """

    bounds: Floats
    scale: Floats
    periodic: NDArray[np.bool_]

    @property
    def low(self) -> Floats:
        """The least of each axis, as lengths."""
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
        """By how much a path, shape (rows, axes), is longer than the straight way, as a share in [0, 1).

        A length x is x / (x + diagonal): 1/2 if the detour is as long as the diagonal.
        """
        detour = max(0.0, length_of(path) - float(np.linalg.norm(self.shorter(path[-1] - path[0]))))
        return detour / (detour + self.diagonal)

    def shorter(self, step: Floats) -> Floats:
        """The same difference of places, (.., axes) lengths, but the shorter way along periodic axes."""
        periods = np.where(self.periodic, self.span, 1.0)
        return np.where(self.periodic, step - periods * np.floor(step / periods + 0.5), step)

    def clearances(self, path: Floats, centres: Floats) -> Floats:
        """How near a path, unwrapped, (rows, axes), comes to each centre, (n, axes), or an image of it: (n,) lengths.

        In closed form: the nearest point of each segment to each image of a centre that may count.
        """
        nearest = np.full(len(centres), np.inf)
        ends = path[1:] if len(path) > 1 else path
        turns = [(-1, 0, 1) if periodic else (0,) for periodic in self.periodic]
        for begin, end in zip(path, ends, strict=False):
            along = end - begin
            length = float(np.linalg.norm(along))
            heading = along / length if length > 0.0 else along
            offsets = self.shorter(centres - begin)
            for turn in product(*turns):
                away = offsets + np.array(turn) * self.periods
                foot = np.clip(away @ heading, 0.0, length)
                distance = np.linalg.norm(away - foot[:, None] * heading, axis=1)
                nearest = np.minimum(nearest, distance)
        return nearest


def length_of(path: Floats) -> float:
    """The length of a path, shape (rows, axes)."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
