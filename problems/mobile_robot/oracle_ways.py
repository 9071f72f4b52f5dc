"""The shortest way of a point through polygons, by a visibility graph of the corners that it can bend around.

A shortest way is straight between corners, bends only around reflex corners of the free region, and is tangent to the
obstacle at each of them. So only such corners and pairs are in the graph, which leaves most pairs out before the costly
test whether a line stays in the region.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from problems.mobile_robot.oracle_shapes import Floats, Points, part_at


def length_of(way: Points) -> float:
    """Return the length of a way given by its corners, m."""
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def shortest_way(free: shapely.Geometry, start: tuple[float, float], goal: tuple[float, float]) -> Points | None:
    """Return the corners of the shortest way through polygons, both ends included, (n, 2); None if there is none."""
    part = part_at(free, start)
    if not part.covers(shapely.Point(goal)):
        return None
    if start == goal:
        return np.array([start])
    places, before, after = _corners(part, start, goal)
    pairs = _tangents(places, before, after)
    shapely.prepare(part)
    # What is left of the pairs must see each other.
    pairs = pairs[shapely.covers(part, shapely.linestrings(places[pairs]))]
    lengths = np.linalg.norm(places[pairs[:, 1]] - places[pairs[:, 0]], axis=1)
    graph = coo_array((lengths, (pairs[:, 0], pairs[:, 1])), shape=(len(places), len(places))).tocsr()
    _, previous = dijkstra(graph, directed=False, indices=0, return_predecessors=True)
    # Place 0 is the start, place 1 the goal; the way is read backwards from the goal.
    way = [1]
    while way[-1] != 0:
        if previous[way[-1]] < 0:
            return None
        way.append(int(previous[way[-1]]))
    found: Points = places[way[::-1]]
    return found


def _corners(part: shapely.Polygon, start: tuple[float, float], goal: tuple[float, float]) -> tuple[Points, ...]:
    """Return the start, the goal and all corners that a way can bend around, with the corners before and after each.

    The start and goal are their own neighbours, so `_tangents` excludes none of their lines.
    """
    ends = np.array([start, goal])
    columns = [(ends, ends, ends)]
    part = shapely.geometry.polygon.orient(part)  # what is free is on the left of each ring
    for ring in (part.exterior, *part.interiors):
        here = shapely.get_coordinates(ring)[:-1]
        before, after = np.roll(here, 1, axis=0), np.roll(here, -1, axis=0)
        # With the free region on the left, a turn to the right is a reflex corner of it.
        bends = _cross(here - before, after - here) < 0.0
        columns.append((here[bends], before[bends], after[bends]))
    return tuple(np.concatenate(column) for column in zip(*columns, strict=True))


def _tangents(places: Points, before: Points, after: Points) -> NDArray[np.int64]:
    """Return pairs of places whose line passes both corners without entering them, (pairs, 2).

    No other line is part of a shortest way. A line passes a corner if both neighbours of it are on the same side.
    """
    back, ahead, pairs = before - places, after - places, []
    for one in range(len(places)):
        along = places[one + 1 :] - places[one]
        here = _cross(along, back[one]) * _cross(along, ahead[one])
        there = _cross(along, back[one + 1 :]) * _cross(along, ahead[one + 1 :])
        others = one + 1 + np.flatnonzero((here >= 0.0) & (there >= 0.0))
        pairs.append(np.column_stack([np.full_like(others, one), others]))
    return np.concatenate(pairs)


def _cross(one: Points, other: Points) -> Floats:
    product: Floats = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
    return product
