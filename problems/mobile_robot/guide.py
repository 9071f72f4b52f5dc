"""The guide of a scan that does not see its goal: a grid over the floor, and the price of a metre near obstacles.

The way around the obstacles is the cheapest one along the grid's edges to the goal. A metre costs 1 where there is room
to turn, more where it is tight, and so much where the robot cannot fit that no way leads through a wall unless there is
no other. The guide proves nothing: a way is proven by the closed forms of `contact`.

Prices are continuous in the clearance, so that two implementations that differ in rounding agree but for rounding.
`guide_kernels` computes the distances for `evaluate`, `guide_check` for `check`. They share the numbers of this module,
but no code.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from problems.mobile_robot.body import Body

PRICES = (1000.0, 3.0, 1.0)
"""The price of a metre where nothing fits, where the robot just fits, and where it has room; linear in between."""

_ROOMY = 1.25  # a metre costs 1 from a clearance of so many circumscribed radii on
_FEWEST_NODES = 1 << 12
_MOST_NODES = 1 << 15


class Guide(NamedTuple):
    """A grid of square cells with nodes in their middles, and the clearances to which `PRICES` belong."""

    west: float  # m, x of the first node
    south: float  # m, y of the first node
    spacing: float  # m
    columns: int
    rows: int
    blocked: float  # m
    tight: float
    roomy: float


def guide_of(bounds: Sequence[float], body: Body, clearance: float) -> Guide:
    """Return the grid over a floor for a robot.

    The cells are half as wide as the radius of the disc that the robot covers, unless there would be too few or too
    many of them.
    """
    x0, y0, x1, y1 = bounds
    area, covered = (x1 - x0) * (y1 - y0), body.covered_radius
    spacing = float(np.clip(covered / 2.0, np.sqrt(area / _MOST_NODES), np.sqrt(area / _FEWEST_NODES)))
    columns, rows = (max(2, int(np.ceil(side / spacing))) for side in (x1 - x0, y1 - y0))
    tight = covered + clearance
    roomy = max(_ROOMY * ((body.radius or body.circumscribed_radius) + clearance), tight + spacing)
    return Guide(x0 + spacing / 2.0, y0 + spacing / 2.0, spacing, columns, rows, tight - spacing, tight, roomy)
