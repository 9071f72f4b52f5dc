"""The way around obstacles by shapely and scipy, for `check`: the fitness of a path that ends short of the goal.

It computes what `problems.mobile_robot.guide` defines, and shares no code with `guide_kernels`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray

from problems.mobile_robot.guide import PRICES
from problems.plane import Circle, Obstacle

if TYPE_CHECKING:
    from problems.mobile_robot.model import MobileRobotModel

Floats = NDArray[np.float64]

_STEPS = ((1, 0), (0, 1), (1, 1), (1, -1))  # columns and rows to half of a node's neighbours; edges are undirected


def distance_around(problem: MobileRobotModel, place: tuple[float, float]) -> float:
    """Return how far a place is from the goal around the obstacles, m."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    grid = problem.grid
    east = grid.west + grid.spacing * np.arange(grid.columns)
    north = grid.south + grid.spacing * np.arange(grid.rows)
    nodes = np.stack(np.meshgrid(east, north, indexing="ij"), axis=-1).reshape(-1, 2)
    goal = len(nodes)
    edges = [_edges(grid.spacing, _prices(problem, nodes).reshape(grid.columns, grid.rows), *step) for step in _STEPS]
    # The approaches are taken from the problem without a check: a path that uses them is swept like any other.
    for x, y, length in problem.sources:
        nodes_there = _around(problem, (x, y))
        # The goal is one more node, behind all sources: each source joins its four nodes with its own length.
        edges.append((nodes_there, np.full(4, goal), length + _away(nodes[nodes_there], (x, y))))
    one, other, lengths = (np.concatenate(each) for each in zip(*edges, strict=True))
    # Several approaches near a node make several edges to the goal. A sparse matrix would add them up, so only the
    # shortest is kept.
    order = np.lexsort((lengths, other, one))
    one, other, lengths = one[order], other[order], lengths[order]
    first = np.append(True, (np.diff(one) != 0) | (np.diff(other) != 0))
    graph = coo_array((lengths[first], (one[first], other[first])), shape=(goal + 1, goal + 1)).tocsr()
    distances = dijkstra(graph, directed=False, indices=goal)
    around_place = _around(problem, place)
    return float(np.min(distances[around_place] + _away(nodes[around_place], place)))


def _away(nodes: Floats, place: tuple[float, float]) -> Floats:
    lengths: Floats = np.linalg.norm(nodes - np.array(place), axis=1)
    return lengths


def _around(problem: MobileRobotModel, place: tuple[float, float]) -> NDArray[np.int64]:
    """Return the numbers of the four nodes around a place."""
    grid = problem.grid
    column = int(np.clip(np.floor((place[0] - grid.west) / grid.spacing), 0, grid.columns - 2))
    row = int(np.clip(np.floor((place[1] - grid.south) / grid.spacing), 0, grid.rows - 2))
    return np.array([(column + i) * grid.rows + row + j for i in (0, 1) for j in (0, 1)])


def _prices(problem: MobileRobotModel, nodes: Floats) -> Floats:
    """Return the price of a metre at each node."""
    grid = problem.grid
    return np.interp(_clearances(problem, nodes), [grid.blocked, grid.tight, grid.roomy], PRICES)


def _clearances(problem: MobileRobotModel, nodes: Floats) -> Floats:
    """Return the distance of each node to the nearest wall or obstacle, m; negative within one."""
    x0, y0, x1, y1 = problem.bounds
    clearances: Floats = np.min([nodes[:, 0] - x0, x1 - nodes[:, 0], nodes[:, 1] - y0, y1 - nodes[:, 1]], axis=0)
    for obstacle in problem.obstacles:
        near = _near(nodes, obstacle, problem.grid.roomy)
        if isinstance(obstacle, Circle):
            from_it = _away(nodes[near], obstacle.center) - obstacle.radius
        else:
            shapely.prepare(obstacle.polygon)
            from_it = shapely.distance(obstacle.polygon.exterior, shapely.points(nodes[near]))
            # The exterior ring gives distances on both sides; inside they count as negative.
            from_it[shapely.contains_xy(obstacle.polygon, nodes[near])] *= -1.0
        clearances[near] = np.minimum(clearances[near], from_it)
    return clearances


def _near(nodes: Floats, obstacle: Obstacle, reach: float) -> NDArray[np.bool_]:
    """Return which nodes may be nearer to an obstacle than ``reach``; farther away all prices are the same."""
    low, high = obstacle.corners.min(axis=0), obstacle.corners.max(axis=0)
    beyond = np.maximum(low - nodes, nodes - high).max(axis=1)
    near: NDArray[np.bool_] = beyond < reach + obstacle.thickness
    return near


def _edges(
    spacing: float, prices: Floats, east: int, north: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Return the edges from each node to its neighbour so many columns and rows away: both nodes, and the cost, m."""
    columns, rows = prices.shape
    numbers = np.arange(prices.size).reshape(prices.shape)
    one = numbers[: columns - east, max(0, -north) : rows - max(0, north)].ravel()
    other = numbers[east:, max(0, north) : rows - max(0, -north)].ravel()
    # The price of an edge is the mean of its ends' prices.
    lengths = spacing * np.hypot(east, north) * (prices.ravel()[one] + prices.ravel()[other]) / 2.0
    return one, other, lengths
