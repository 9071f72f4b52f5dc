"""Cover a vehicle's configurations in collision with spheres, coarse to fine, conservative to an accuracy.

The box of all configurations is halved again and again along its longest side. Each cell is treated by its centre:

- Free, if the vehicle's gap to all obstacles is greater than any point of it moves within the cell.
- Else closed by the sphere that encloses it, if that sphere lies within ``accuracy`` of a configuration in collision.
- Else halved.

So every configuration in collision is in some sphere, and every configuration in a sphere is within ``accuracy`` of one
in collision. The first makes a path that crosses no sphere free; the second bounds how much free space is lost.

Cells deep inside are not closed by larger spheres: the deeper a path goes through an obstacle, the more spheres it
crosses, which is what the fitness counts. (Pitt-Francis and Featherstone, to whom the paper refers, make hierarchies of
spheres for solids; the forbidden part of a configuration space need not be a solid.)

The kinds of all cells, level by level, determine the spheres. They are what travels to the nodes, as a text.
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
"""A function from configurations, (n, axes) in their own units, to the gaps between vehicle and obstacles, (n,) m.

A gap is 0 in collision. To keep a clearance, subtract it from the gap, and take 0 where nothing is left.
"""

FREE, CLOSED, HALVED = 0, 1, 2
MOST_SPHERES = 1 << 17
_MOST_CELLS = 1 << 18  # on one level


@dataclass(frozen=True)
class _Level:
    """Cells of one size: their centres and half sides as lengths, shape (cells, axes) and (axes,)."""

    centres: Floats
    half: Floats

    def halved(self, which: NDArray[np.bool_]) -> "_Level":
        """Return the level of both halves of the chosen cells, which are halved along their longest side."""
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
    """Return the code of all cells: their kinds in order, compressed, as text.

    Args:
        space: The configuration space; its first axes are translations, all others are angles.
        translations: The number of axes that are translations.
        accuracy: How far beyond configurations in collision the spheres may reach, m.
        clearance: The gaps of the vehicle.

    Raises:
        ValueError: If there would be more spheres than nodes can hold.
    """
    level, kinds, spheres = _whole(space), list[Kinds](), 0
    while len(level.centres):
        gaps = clearance(level.centres / space.scale)
        kinds.append(_kinds(level, gaps, translations, accuracy))
        halved = kinds[-1] == HALVED
        spheres += int(np.count_nonzero(kinds[-1] == CLOSED))
        needed = spheres + _least_spheres(level, accuracy) * int(np.count_nonzero(halved & (gaps == 0.0)))
        level = level.halved(halved)
        # Checked on every level, so that a too fine accuracy fails before it costs minutes.
        if needed > MOST_SPHERES or len(level.centres) > _MOST_CELLS:
            raise ValueError(f"accuracy: expected one that needs at most {MOST_SPHERES:,} spheres, found {accuracy:g}")
    return base64.b64encode(zlib.compress(np.concatenate(kinds).tobytes(), 9)).decode()


def _least_spheres(level: _Level, accuracy: float) -> int:
    """Return how many spheres a cell of this level needs at least if its centre is in collision.

    Cells are halved until they are small. The pieces after the first halving along each axis all touch the centre, so
    none of them is free.
    """
    half, halved = level.half.copy(), set[int]()
    while np.linalg.norm(half) > accuracy:
        axis = int(np.argmax(half))
        half[axis] /= 2.0
        halved.add(axis)
    return 1 << len(halved)


def _kinds(level: _Level, gaps: Floats, translations: int, accuracy: float) -> Kinds:
    radius = float(np.linalg.norm(level.half))
    # How far any point of the vehicle can move between the cell's centre and a place in the cell. Angles count as arcs
    # of the vehicle's farthest point; no point is farther from an axis of rotation than that one is from the origin.
    moved = float(np.linalg.norm(level.half[:translations]) + level.half[translations:].sum())
    free = gaps > moved
    # A translation by the gap brings the vehicle into contact, so a configuration in collision is that near the centre.
    close = radius + gaps <= accuracy
    kinds: Kinds = np.where(free, FREE, np.where(close, CLOSED, HALVED)).astype(np.uint8)
    return kinds


def spheres_of(code: str, space: Space) -> Floats:
    """Return the spheres of all closed cells, shape (n, axes + 1): centre and radius, as lengths.

    Raises:
        ValueError: If the text is no code of cells.
    """
    kinds = _unpacked(code)
    level, place = _whole(space), 0
    spheres = [np.empty((0, len(space.scale) + 1))]
    while len(level.centres):
        # The same walk as in `subdivide`: the kinds of a level say which of its cells the next level halves.
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
        # The bound keeps a small text from unfolding into all of the memory: codes may come over the network.
        unpacked = zlib.decompressobj().decompress(base64.b64decode(code, validate=True), 64 * _MOST_CELLS)
    except (ValueError, zlib.error) as error:
        raise ValueError("expected a code of cells, found another text") from error
    return np.frombuffer(unpacked, np.uint8)
