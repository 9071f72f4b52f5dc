"""Random spheres that leave the start, the goal and, if asked for, a hidden corridor free."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from problems.sphere_path import cells
from problems.tables import Table, quantity

if TYPE_CHECKING:
    from problems.sphere_path.space import Space

Floats = NDArray[np.float64]
Radius = Annotated[float, Field(gt=0, le=1e6)]

_BATCH = 256
_DRAWS_EACH = 1000  # the most spheres that are drawn for each one that is kept


class Random(Table):
    """Random spheres, clear of start and goal."""

    seed: int = quantity("", "the same seed gives the same spheres", ge=0, lt=1 << 63)
    count: int = quantity("", "number of spheres", ge=0, le=cells.MOST_SPHERES)
    radius: tuple[Radius, Radius] = quantity("as the axes", "[least, greatest] radius")
    corridor: int = quantity(
        "", "places of a hidden path that the spheres leave free; 0: there is none", default=0, ge=0, le=100
    )
    clearance: float = quantity(
        "as the axes", "how far spheres stay from start, goal and hidden path", default=0.0, ge=0, le=1e6
    )

    @field_validator("radius")
    @classmethod
    def _in_order(cls, radius: tuple[float, float]) -> tuple[float, float]:
        if radius[0] > radius[1]:
            raise ValueError(f"expected [least, greatest], found {list(radius)}")
        return radius


def corridor_of(random: Random, space: Space, start: Floats, goal: Floats) -> Floats:
    """Return the hidden path from start to goal by random places, unwrapped, (corridor + 2, axes), as lengths."""
    # A generator of its own: the corridor depends on its number of places and the seed, not on the spheres.
    generator = np.random.default_rng([random.seed, 0])
    path = [start]
    for place in [*generator.uniform(space.low, space.low + space.span, (random.corridor, len(start))), goal]:
        path.append(path[-1] + space.shorter(place - path[-1]))
    return np.array(path)


def random_spheres(random: Random, space: Space, start: Floats, goal: Floats) -> Floats:
    """Return spheres with centres uniform in the box and radii uniform in their range, (count, axes + 1), as lengths.

    Spheres that come too near to the start, the goal or the hidden path are drawn again.

    Raises:
        ValueError: If there is no room for so many.
    """
    generator = np.random.default_rng([random.seed, 1])
    free = corridor_of(random, space, start, goal) if random.corridor else np.stack([start, goal])
    kept, found, drawn = [np.empty((0, len(start) + 1))], 0, 0
    while found < random.count:
        if drawn > _DRAWS_EACH * random.count:
            raise ValueError(f"random.count: expected at most {found}, the number that fits, found {random.count}")
        centres = generator.uniform(space.low, space.low + space.span, (_BATCH, len(start)))
        radii = generator.uniform(*random.radius, _BATCH)
        if random.corridor:
            away = space.clearances(free, centres)
        else:
            # Without a corridor only the ends must be free, not the straight way between them.
            away = np.minimum(*(space.clearances(place[None], centres) for place in free))
        clear = away >= radii + random.clearance
        kept.append(np.column_stack([centres, radii])[clear])
        found += int(np.count_nonzero(clear))
        drawn += _BATCH
    return np.concatenate(kept)[: random.count]
