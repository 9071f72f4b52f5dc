"""Joint paths with rounded corners: straight pieces, joined by curves whose second derivative is continuous.

A corner is replaced by a curve from a point before it to a point behind it, both ``radius`` away. On the way its
direction changes from that of one piece to that of the other by the polynomial 3u² - 2u³, u from 0 to 1, so it leaves
either piece without a jump of velocity or acceleration, and never turns back. It passes the corner at a distance of
3/16 · radius · |difference of the unit directions|. Where the radius is 0 the robot must stop.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SHARE = 3.0 / 16.0  # of radius · |difference of directions|: the distance of the curve's middle from the corner
_REPEATED = 1e-9  # rad or m between two points that count as one: a direction needs some length
_STRAIGHT = 1e-9  # two directions count as equal if their unit vectors differ by no more
_LEAST_RADIUS = 1e-3  # a smaller curve costs as much time as a stop
_HALVINGS = 6  # of a curve that is not free, before the robot stops at its corner


@dataclass(frozen=True, eq=False)
class Stretch:
    """A part of a path from one stop to the next, over a parameter s from 0 to `length`.

    Attributes:
        corners: the points between which it is straight, shape (k, n), k at least 2.
        radii: of the curves at the inner corners, shape (k - 2,), greater than 0.
    """

    corners: Floats
    radii: Floats

    @property
    def lengths(self) -> Floats:
        """The lengths of the straight lines between the corners."""
        lengths: Floats = np.linalg.norm(np.diff(self.corners, axis=0), axis=1)
        return lengths

    @property
    def length(self) -> float:
        """The end of the parameter."""
        return float(self.lengths.sum())

    @property
    def ends(self) -> Floats:
        """The parameters at which straight pieces and curves begin and end, increasing, shape (2 k - 2,)."""
        at = np.concatenate([[0.0], np.cumsum(self.lengths)])
        curves = np.column_stack([at[1:-1] - self.radii, at[1:-1] + self.radii])
        return np.concatenate([[0.0], curves.ravel(), at[-1:]])

    def __call__(self, places: Floats, order: int = 0) -> Floats:
        """Return the positions at given parameters, or a derivative of the first or second order: (m,) to (m, n)."""
        lengths = self.lengths
        directions = np.diff(self.corners, axis=0) / lengths[:, None]
        begins = np.concatenate([[0.0], np.cumsum(lengths)])
        piece = np.clip(np.searchsorted(begins, places, side="right") - 1, 0, len(lengths) - 1)
        into = places - begins[piece]
        found: Floats
        match order:
            case 0:
                found = self.corners[piece] + into[:, None] * directions[piece]
            case 1:
                found = directions[piece]
            case _:
                found = np.zeros((len(places), self.corners.shape[1]))
        for corner, radius in enumerate(self.radii):
            away = places - begins[corner + 1]
            near = np.abs(away) < radius
            u = (away[near] / radius + 1.0) / 2.0
            turn = directions[corner + 1] - directions[corner]
            found[near] = _curve(self.corners[corner + 1], directions[corner], turn, radius, u, order)
        return found


def _curve(corner: Floats, direction: Floats, turn: Floats, radius: float, u: Floats, order: int) -> Floats:
    """Return points or derivatives of a rounded corner at u from 0 to 1, shape (m, n)."""
    u = u[:, None]
    found: Floats
    match order:
        case 0:
            found = corner + direction * (radius * (2.0 * u - 1.0)) + turn * (radius * u**3 * (2.0 - u))
        case 1:
            found = direction + turn * (u * u * (3.0 - 2.0 * u))
        case _:
            found = turn * (3.0 * u * (1.0 - u) / radius)
    return found


def simplified(path: Floats) -> Floats:
    """Return a path without repeated points, and without those between two pieces of the same direction."""
    kept = [path[0]]
    for row in path[1:]:
        if np.linalg.norm(row - kept[-1]) > _REPEATED:
            kept.append(row)
    if len(kept) > 1:
        kept[-1] = path[-1]
    corners = [kept[0]]
    for before, at, behind in zip(kept, kept[1:], kept[2:], strict=False):
        if np.linalg.norm(_unit(behind - at) - _unit(at - before)) > _STRAIGHT:
            corners.append(at)
    return np.array([*corners, kept[-1]] if len(kept) > 1 else corners)


def rounded(path: Floats, farthest: float, is_free: Callable[[Floats], bool], excess: float) -> list[Stretch]:
    """Return the stretches of a path, whose corners are rounded as far as that is free.

    A curve that is not free is halved, a few times; then the robot stops at that corner.

    Args:
        path: corners between straight pieces, which are free, shape (k, n).
        farthest: how far from a corner a curve may pass, rad or m; 0 to stop at each corner.
        is_free: whether a path of straight pieces is free, with some room for what is up to ``excess`` off it.
        excess: how far a curve may be from the chords that are tested in its place, rad or m.
    """
    corners = simplified(path)
    if len(corners) < 2:
        return []
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    radii = np.zeros(len(corners))
    for number in range(1, len(corners) - 1):
        before, at, behind = corners[number - 1 : number + 2]
        turn = float(np.linalg.norm(_unit(behind - at) - _unit(at - before)))
        radius = min(lengths[number - 1] / 2.0, lengths[number] / 2.0, farthest / (_SHARE * turn))
        radii[number] = _free_radius(corners[number - 1 : number + 2], radius, is_free, excess)
    stops = [0, *(np.flatnonzero(radii[1:-1] == 0.0) + 1).tolist(), len(corners) - 1]
    return [Stretch(corners[one : other + 1], radii[one + 1 : other]) for one, other in itertools.pairwise(stops)]


def _free_radius(around: Floats, radius: float, is_free: Callable[[Floats], bool], excess: float) -> float:
    """Return the greatest of some radii whose curve is free; 0 if there is none."""
    for _ in range(_HALVINGS + 1):
        if radius < _LEAST_RADIUS:
            break
        if is_free(_chords(Stretch(around, np.array([radius])), excess)):
            return radius
        radius /= 2.0
    return 0.0


def _chords(stretch: Stretch, excess: float) -> Floats:
    """Return points of the only curve of a stretch; no chord between two is farther than ``excess`` from the curve."""
    _, begin, end, _ = stretch.ends
    turn = float(np.linalg.norm(stretch(np.array([(begin + end) / 2.0]), 2)))  # the greatest second derivative
    count = int(np.ceil((end - begin) * np.sqrt(turn / (8.0 * excess)))) + 1
    return stretch(np.linspace(begin, end, count + 1))


def _unit(vector: Floats) -> Floats:
    unit: Floats = vector / np.linalg.norm(vector)
    return unit
