"""The compiled way around obstacles: distances to the goal over a grid, as `problems.mobile_robot.guide` defines them.

Each process computes them once for a floor. A scan then only looks up the four nodes around a place.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lowlevel.compiled import kernel, subroutine
from problems.mobile_robot.guide import PRICES, Guide

Floats = NDArray[np.float64]

_MOST, _TIGHT, _LEAST = PRICES


class Field(NamedTuple):
    """Distances to the goal at the nodes of a grid."""

    west: Any  # m, x of the first node
    south: Any  # m, y of the first node
    spacing: Any  # m
    distances: Any  # (columns, rows), m


@subroutine
def _to_edge(x: Any, y: Any, ax: Any, ay: Any, bx: Any, by: Any) -> Any:
    """Return the distance of a point to the segment between a and b."""
    run, rise = bx - ax, by - ay
    squared = run * run + rise * rise
    # A disc is a single corner, whose edge to itself has no length.
    share = 0.0 if squared == 0.0 else min(1.0, max(0.0, ((x - ax) * run + (y - ay) * rise) / squared))
    return np.hypot(ax + share * run - x, ay + share * rise - y)


@subroutine
def _clearance(x: Any, y: Any, corners: Any, first: Any, last: Any, thickness: Any) -> Any:
    """Return the distance of a point to one shape; within the shape, the negative distance to its outline.

    A point is inside if a ray from it to the right crosses the outline an odd number of times.
    """
    inside, nearest = False, np.inf
    ax, ay = corners[last - 1]
    for corner in range(first, last):
        bx, by = corners[corner]
        nearest = min(nearest, _to_edge(x, y, ax, ay, bx, by))
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            inside = not inside
        ax, ay = bx, by
    return (-nearest if inside else nearest) - thickness


@subroutine
def _price(clearance: Any, blocked: Any, tight: Any, roomy: Any) -> Any:
    """Return the price of a metre (see `PRICES`)."""
    if clearance >= roomy:
        return _LEAST
    if clearance >= tight:
        return _LEAST + (_TIGHT - _LEAST) * (roomy - clearance) / (roomy - tight)
    if clearance > blocked:
        return _TIGHT + (_MOST - _TIGHT) * (tight - clearance) / (tight - blocked)
    return _MOST


@subroutine
def _lower_by_shape(clearances: Any, grid: Any, box: Any, corners: Any, first: Any, last: Any, thickness: Any) -> Any:
    """Lower the clearances of the nodes near a shape; those beyond ``roomy`` (the grid's last) keep theirs."""
    west, south, spacing, roomy = grid
    columns, rows = clearances.shape
    left = max(0, int(np.floor((box[0] - roomy - west) / spacing)))
    right = min(columns, int(np.ceil((box[2] + roomy - west) / spacing)) + 1)
    low = max(0, int(np.floor((box[1] - roomy - south) / spacing)))
    high = min(rows, int(np.ceil((box[3] + roomy - south) / spacing)) + 1)
    for column in range(left, right):
        for row in range(low, high):
            x, y = west + column * spacing, south + row * spacing
            here = _clearance(x, y, corners, first, last, thickness)
            clearances[column, row] = min(clearances[column, row], here)


@subroutine
def _relax(distances: Any, prices: Any, spacing: Any, column: Any, row: Any) -> Any:
    """Lower the distance of one node to the least over its neighbours; return whether that changed it."""
    columns, rows = distances.shape
    before = distances[column, row]
    best = before
    for other in range(max(0, column - 1), min(columns, column + 2)):
        for beside in range(max(0, row - 1), min(rows, row + 2)):
            # The node itself is among the neighbours; its own distance plus something never wins.
            length = spacing * (1.0 if other == column or beside == row else np.sqrt(2.0))
            best = min(best, distances[other, beside] + length * (prices[column, row] + prices[other, beside]) / 2.0)
    distances[column, row] = best
    return best < before


@subroutine
def _spread(distances: Any, prices: Any, spacing: Any) -> None:
    """Spread the distances over the grid, sweep after sweep from each of its corners, until none gets shorter.

    The result is that of Dijkstra's algorithm. A sweep carries distances along any way that keeps to its directions, so
    few rounds are needed, and no priority queue.
    """
    columns, rows = distances.shape
    changed = True
    while changed:
        changed = False
        for corner in range(4):
            for i in range(columns):
                column = i if corner % 2 == 0 else columns - 1 - i
                for j in range(rows):
                    row = j if corner < 2 else rows - 1 - j
                    if _relax(distances, prices, spacing, column, row):
                        changed = True


@subroutine
def _cell_of(west: Any, south: Any, spacing: Any, columns: Any, rows: Any, x: Any, y: Any) -> Any:
    """Return column and row of the first of the four nodes around a place."""
    column = min(max(int(np.floor((x - west) / spacing)), 0), columns - 2)
    return column, min(max(int(np.floor((y - south) / spacing)), 0), rows - 2)


@subroutine
def _clearances(grid: Any, columns: Any, rows: Any, bounds: Any, shapes: Any) -> Any:
    """Return the clearances of all nodes from walls and obstacles, m; only those beyond ``roomy`` may be too large.

    That is enough, since all of these have the same price.
    """
    west, south, spacing, _ = grid
    corners, starts, thickness, boxes = shapes
    clearances = np.empty((columns, rows))
    for column in range(columns):
        for row in range(rows):
            x, y = west + column * spacing, south + row * spacing
            clearances[column, row] = min(x - bounds[0], bounds[2] - x, y - bounds[1], bounds[3] - y)
    for shape in range(thickness.size):
        first, last = starts[shape], starts[shape + 1]
        _lower_by_shape(clearances, grid, boxes[shape], corners, first, last, thickness[shape])
    return clearances


@kernel(
    "float64[:,::1](float64[::1], int64, int64, float64[::1], float64[:,::1], float64[::1], float64[:,::1], int64[::1],"
    "float64[::1], float64[:,::1])"
)
def _distances_to(
    grid: Floats,
    columns: int,
    rows: int,
    radii: Floats,
    sources: Floats,
    bounds: Floats,
    corners: Floats,
    starts: NDArray[np.int64],
    thickness: Floats,
    boxes: Floats,
) -> Floats:
    """Return what `distances` does; ``grid`` is west, south and spacing, ``radii`` are blocked, tight and roomy."""
    west, south, spacing = grid
    blocked, tight, roomy = radii
    shapes = (corners, starts, thickness, boxes)
    prices = _clearances((west, south, spacing, roomy), columns, rows, bounds, shapes)
    for column in range(columns):
        for row in range(rows):
            prices[column, row] = _price(prices[column, row], blocked, tight, roomy)
    distances = np.full((columns, rows), np.inf)
    for source in range(len(sources)):
        east, north, length = sources[source]
        first_column, first_row = _cell_of(west, south, spacing, columns, rows, east, north)
        for column in range(first_column, first_column + 2):
            for row in range(first_row, first_row + 2):
                x, y = west + column * spacing, south + row * spacing
                # The four nodes around a source know their distance to it; all others get theirs from neighbours.
                distances[column, row] = min(distances[column, row], length + np.hypot(east - x, north - y))
    _spread(distances, prices, spacing)
    return distances


def distances(guide: Guide, sources: Floats, floor: tuple[NDArray[Any], ...]) -> Floats:
    """Return the distance of each node to the goal, m, shape (columns, rows).

    ``sources`` are x and y of the goal and 0, or of each approach and its length; ``floor`` has the fields of
    `contact.Floor`.
    """
    bounds, corners, starts, thickness, boxes, _ = floor
    found: Floats = _distances_to(
        np.array(guide[:3]),
        guide.columns,
        guide.rows,
        np.array(guide[5:]),
        sources,
        bounds,
        corners,
        starts,
        thickness,
        boxes,
    )
    return found


@subroutine
def distance_at(field: Any, x: Any, y: Any) -> Any:
    """Return the distance of a place to the goal around the obstacles, over the best of the four nodes around it."""
    west, south, spacing, distances = field
    first_column, first_row = _cell_of(west, south, spacing, distances.shape[0], distances.shape[1], x, y)
    best = np.inf
    for column in range(first_column, first_column + 2):
        for row in range(first_row, first_row + 2):
            away = np.hypot(west + column * spacing - x, south + row * spacing - y)
            best = min(best, distances[column, row] + away)
    return best
