"""From a vehicle among obstacles to spheres in configuration space, coarse to fine, conservative to an accuracy.

The box of all configurations is halved again and again along its longest side. A cell at whose centre the vehicle has a
greater gap to all obstacles than any point of it moves within the cell is free. A cell that is not, and whose enclosing
sphere lies within ``accuracy`` of a configuration in collision, is closed by that sphere. So every configuration in
collision is in some sphere, and no configuration farther than ``accuracy`` from all of those is. What is deep inside is
not closed by larger spheres: the deeper a path goes through, the more it crosses. (Pitt-Francis and Featherstone, to
whom the paper refers, make hierarchies of spheres of solids; a configuration space need not be that of a solid.)

What becomes of each cell, level by level, is all that need be kept: that is what travels to the nodes, as a text.
"""

import base64
import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from problems.sphere_path.space import Space

Floats = NDArray[np.float64]
Kinds = NDArray[np.uint8]  # (cells,)
Clearance = Callable[[Floats], Floats]
"""The gap between vehicle and obstacles, (n,) m, 0 in collision, at configurations (n, axes) in their own units.

To keep a distance from obstacles, take the gap less that distance, and 0 where there is none left.
"""

FREE, CLOSED, HALVED = 0, 1, 2
MOST_SPHERES = 1 << 17
_MOST_CELLS = 1 << 18  # of one size


@dataclass(frozen=True)
class _Level:
    """Cells of one size, as lengths: centres and half sides, shape (cells, axes) and (axes,)."""

    centres: Floats
    half: Floats

    def halved(self, which: NDArray[np.bool_]) -> "_Level":
        """Both halves of each of some cells."""
        axis = int(np.argmax(self.half))
        half = self.half.copy()
        half[axis] /= 2.0
        move = np.zeros(len(half))
        move[axis] = half[axis]
        kept = self.centres[which]
        return _Level(np.stack([kept - move, kept + move], axis=1).reshape(-1, len(half)), half)


def _whole(space: Space) -> _Level:
    half = space.span / 2.0
    return _Level((space.low + half)[None], half)


def subdivide(space: Space, translations: int, accuracy: float, clearance: Clearance) -> str:
    """The code of all cells.

    Args:
        space: whose first axes are translations, and whose others are angles.
        translations: how many.
        accuracy: m.
        clearance: of the vehicle.

    Raises:
        ValueError: if there would be more spheres than nodes can well hold.
    """
    level, kinds, spheres = _whole(space), list[Kinds](), 0
    while len(level.centres):
        kinds.append(_kinds(level, space, translations, accuracy, clearance))
        spheres += int(np.count_nonzero(kinds[-1] == CLOSED))
        level = level.halved(kinds[-1] == HALVED)
        if spheres > MOST_SPHERES or len(level.centres) > _MOST_CELLS:
            raise ValueError(f"accuracy: expected one that needs at most {MOST_SPHERES:,} spheres, found {accuracy:g}")
    return base64.b64encode(zlib.compress(np.concatenate(kinds).tobytes(), 9)).decode()


def _kinds(level: _Level, space: Space, translations: int, accuracy: float, clearance: Clearance) -> Kinds:
    gap = clearance(level.centres / space.scale)
    radius = float(np.linalg.norm(level.half))
    # No point of the vehicle is farther from any of its axes of rotation than the radius that angles are scaled by.
    moved = float(np.linalg.norm(level.half[:translations]) + level.half[translations:].sum())
    free = gap > moved
    close = radius + gap <= accuracy
    kinds: Kinds = np.where(free, FREE, np.where(close, CLOSED, HALVED)).astype(np.uint8)
    return kinds


def spheres_of(code: str, space: Space) -> Floats:
    """The spheres of all closed cells, shape (n, axes + 1): centre and radius, as lengths.

    Raises:
        ValueError: if that is no code of cells.
    """
    kinds = _unpacked(code)
    level, place = _whole(space), 0
    spheres = [np.empty((0, len(space.scale) + 1))]
    while len(level.centres):
        own = kinds[place : place + len(level.centres)]
        place += len(own)
        if len(own) < len(level.centres):
            break
        closed = level.centres[own == CLOSED]
        radii = np.full((len(closed), 1), np.linalg.norm(level.half))
        spheres.append(np.concatenate([closed, radii], axis=1))
        level = level.halved(own == HALVED)
    if len(level.centres) or place != len(kinds):
        raise ValueError("expected a code of cells, found another text")
    return np.concatenate(spheres)


def _unpacked(code: str) -> Kinds:
    try:
        unpacked = zlib.decompressobj().decompress(base64.b64decode(code, validate=True), 64 * _MOST_CELLS)
    except (ValueError, zlib.error) as error:
        raise ValueError("expected a code of cells, found another text") from error
    return np.frombuffer(unpacked, np.uint8)
