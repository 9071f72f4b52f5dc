"""The exact answers that mobile-robot is held against: is there a way, and how long is the shortest?

Nothing here is used by `evaluate`. Where a disc's centre may be is the floor without the obstacles grown by its radius,
and the shortest way there leads from corner to corner that see each other. Round corners become polygons twice: drawn
around, so that whatever is free is surely free, and drawn within, so that whatever is out of reach is surely so.

A polygon turns freely inside the disc that encloses it. Where that does not get through, the headings are cut into
slices: in each the robot is swept over its headings, or shrunk to what it covers at all of them, and slices are
connected where their free places overlap. The one is surely free, the other surely not.

A slice lets the robot slide to any side, which it cannot: it turns and drives ahead. So a way through swept slices is
not proven where a start or goal is too tight to turn in, though `foretell` says so; that there is no way is proven.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

from problems.mobile_robot.checker import TOLERANCE
from problems.plane import Circle, Obstacle
from problems.problem import Answer, Solution

if TYPE_CHECKING:
    from problems.mobile_robot.problem import MobileRobot

Floats = NDArray[np.float64]
Points = NDArray[np.float64]  # (n, 2), m

_ARC = 32  # sides of a polygon that stand for a quarter of a circle; of shorter arcs a side may be half as long again
_AROUND = 1.0 / np.cos(1.5 * np.pi / 4.0 / _ARC)  # by this much larger, such a polygon encloses its circle
_SLICES = 120  # of the headings
_HALF_SLICE = np.pi / _SLICES
_HEADINGS = 2.0 * _HALF_SLICE * np.arange(_SLICES)  # in their middles


def foretell(problem: MobileRobot) -> Answer:
    """Whether the goal can be reached, and bounds of the shortest way's length."""
    outer, inner = (radius + problem.clearance if radius > 0.0 else 0.0 for radius in _discs(problem))
    least, away = _least(problem, inner)
    if away > 0.0:
        method = "visibility graph of a disc that the robot covers" if problem.robot.vertices else "visibility graph"
        return Answer("lower bound", away, f"{method}: the goal is out of reach")
    figures = {"shortest_length_at_least": least}
    way = shortest_way(_free(problem, outer, surely=True), problem.start[:2], problem.goal[:2])
    if way is not None:
        solution = _solution(problem, way)
        figures["shortest_length_at_most"] = solution["length"]
        method = "visibility graph of the enclosing disc" if problem.robot.vertices else "visibility graph"
        return Answer("optimum", 0.0, f"{method}, for any number of commands", solution, figures)
    if problem.robot.vertices is None:
        method = "visibility graph, which cannot tell whether the robot gets through"
        return Answer("lower bound", 0.0, method, None, figures)
    return _by_slices(problem, figures)


def _by_slices(problem: MobileRobot, figures: dict[str, float]) -> Answer:
    method = f"{_SLICES} slices of the headings"
    if _best_in_slices(problem, surely=True) == 0.0:
        return Answer("optimum", 0.0, f"{method}, for any number of commands", None, figures)
    away = _best_in_slices(problem, surely=False)
    if away > 0.0:
        return Answer("lower bound", away, f"{method}: the goal is out of reach")
    return Answer("lower bound", 0.0, f"{method}, which cannot tell whether the robot gets through", None, figures)


# Discs ----------------------------------------------------------------------------------------------------------------
def _discs(problem: MobileRobot) -> tuple[float, float]:
    """The radii of discs about the reference point that enclose the robot, and that it covers (0 if it covers none)."""
    robot = problem.robot
    if robot.vertices is None:
        assert robot.radius is not None, "a robot is a polygon or a disc"
        return robot.radius, robot.radius
    outline, reference = shapely.Polygon(robot.vertices), shapely.Point(0.0, 0.0)
    covered = float(outline.exterior.distance(reference)) if outline.contains(reference) else 0.0
    return robot.circumscribed_radius, covered


def _least(problem: MobileRobot, radius: float) -> tuple[float, float]:
    """A lower bound of the length of a disc's way, and how near to the goal it gets at best, m."""
    start, goal = problem.start[:2], problem.goal[:2]
    straight = float(np.hypot(*np.subtract(start, goal)))
    if radius == 0.0:
        return straight, 0.0
    free = _free(problem, radius, surely=False)
    part = _part_at(free, start)
    if not part.is_empty and not part.covers(shapely.Point(goal)):
        return np.inf, float(part.distance(shapely.Point(goal)))
    way = shortest_way(free, start, goal)
    return straight if way is None else _length(way), 0.0


def _free(problem: MobileRobot, radius: float, surely: bool) -> shapely.Geometry:
    """Where the centre of a disc may be: ``surely``, or at most."""
    x0, y0, x1, y1 = problem.bounds
    gap = radius if surely else radius - TOLERANCE
    if min(x1 - x0, y1 - y0) < 2.0 * gap:
        return shapely.Polygon()
    solids = [_grown(obstacle, radius, surely) for obstacle in problem.obstacles]
    return shapely.box(x0 + gap, y0 + gap, x1 - gap, y1 - gap).difference(shapely.union_all(solids))


def _grown(obstacle: Obstacle, radius: float, surely: bool) -> shapely.Geometry:
    """By at least the radius, or at most; piece by piece, since GEOS rounds what is hardly concave."""
    if isinstance(obstacle, Circle):
        pieces, radius = [shapely.Point(obstacle.center)], radius + obstacle.radius
    else:
        pieces = [shapely.Polygon(piece) for piece in _convex(obstacle.polygon)]
    by = radius * _AROUND if surely else radius - TOLERANCE
    return shapely.union_all([piece.buffer(by, quad_segs=_ARC) for piece in pieces])


def _part_at(free: shapely.Geometry, place: tuple[float, float]) -> shapely.Geometry:
    """The connected part of the free places that ``place`` is in; an empty one if it is in none."""
    point = shapely.Point(place)
    return next((part for part in _parts(free) if part.covers(point)), shapely.Polygon())


def _length(way: Points) -> float:
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


# The shortest way of a point ------------------------------------------------------------------------------------------
def shortest_way(free: shapely.Geometry, start: tuple[float, float], goal: tuple[float, float]) -> Points | None:
    """The corners of the shortest way through polygons, both ends included, shape (n, 2); None if there is none."""
    part = _part_at(free, start)
    if not part.covers(shapely.Point(goal)):
        return None
    if start == goal:
        return np.array([start])
    places, before, after = _corners(part, start, goal)
    pairs = _tangents(places, before, after)
    shapely.prepare(part)
    pairs = pairs[shapely.covers(part, shapely.linestrings(places[pairs]))]
    lengths = np.linalg.norm(places[pairs[:, 1]] - places[pairs[:, 0]], axis=1)
    graph = coo_array((lengths, (pairs[:, 0], pairs[:, 1])), shape=(len(places), len(places))).tocsr()
    _, previous = dijkstra(graph, directed=False, indices=0, return_predecessors=True)
    way = [1]
    while way[-1] != 0:
        if previous[way[-1]] < 0:
            return None
        way.append(int(previous[way[-1]]))
    found: Points = places[way[::-1]]
    return found


def _corners(part: shapely.Polygon, start: tuple[float, float], goal: tuple[float, float]) -> tuple[Points, ...]:
    """The start, the goal and all corners that a way can bend around, and the corners before and after each of them."""
    ends = np.array([start, goal])
    columns = [(ends, ends, ends)]
    part = shapely.geometry.polygon.orient(part)  # what is free is on the left of each ring
    for ring in (part.exterior, *part.interiors):
        here = shapely.get_coordinates(ring)[:-1]
        before, after = np.roll(here, 1, axis=0), np.roll(here, -1, axis=0)
        bends = _cross(here - before, after - here) < 0.0
        columns.append((here[bends], before[bends], after[bends]))
    return tuple(np.concatenate(column) for column in zip(*columns, strict=True))


def _tangents(places: Points, before: Points, after: Points) -> NDArray[np.int64]:
    """Pairs of places whose line passes both corners without entering them: no other is part of a shortest way."""
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


def _solution(problem: MobileRobot, way: Points) -> Solution:
    """The way as commands of a robot that can turn anywhere on it."""
    pose = np.array(problem.start)
    commands: list[list[str | float]] = []
    path = [pose.tolist()]

    def obey(name: str, value: float, following: Floats) -> None:
        commands.append([name, float(value)])
        path.append(following.tolist())

    for here, there in pairwise(way):
        step = there - here
        turn = _shorter(np.arctan2(step[1], step[0]) - pose[2])
        pose = np.array([*here, pose[2] + turn])
        obey("rotate", turn, pose)
        pose = np.array([*there, pose[2]])
        obey("move", float(np.hypot(*step)), pose)
    turn = _shorter(problem.goal[2] - pose[2])
    obey("rotate", turn, pose + np.array([0.0, 0.0, turn]))
    return {"commands": commands, "path": path, "length": _length(way)}


def _shorter(turn: float) -> float:
    return float((turn + np.pi) % (2.0 * np.pi) - np.pi)


# Slices of the headings of a polygon ----------------------------------------------------------------------------------
def _best_in_slices(problem: MobileRobot, surely: bool) -> float:
    """The least fitness of all poses that the robot gets to from slice to slice; 0 for the goal, or if in doubt."""
    parts = [list(_parts(_free_in_slice(problem, number, surely))) for number in range(_SLICES)]
    firsts = np.cumsum([0, *map(len, parts)])
    pairs = [
        (firsts[number] + one, firsts[(number + 1) % _SLICES] + other)
        for number in range(_SLICES)
        for one, here in enumerate(parts[number])
        for other, there in enumerate(parts[(number + 1) % _SLICES])
        if here.intersects(there)
    ]
    rows, columns = np.array(pairs, np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(firsts[-1], firsts[-1]))
    _, labels = connected_components(graph, directed=False)
    start, goal = (_number_at(pose, parts, firsts) for pose in (problem.start, problem.goal))
    if start is None:
        return np.inf if surely else 0.0
    if goal is not None and labels[start] == labels[goal]:
        return 0.0
    place, radius = shapely.Point(problem.goal[:2]), problem.robot.circumscribed_radius
    fitness = [
        part.distance(place) + radius * max(0.0, abs(_shorter(heading - problem.goal[2])) - _HALF_SLICE)
        for heading, several in zip(_HEADINGS, parts, strict=True)
        for part in several
    ]
    return float(max(np.min(np.array(fitness)[labels == labels[start]]), np.nextafter(0.0, 1.0)))


def _parts(free: shapely.Geometry) -> Iterator[shapely.Polygon]:
    return (part for part in shapely.get_parts(free) if part.geom_type == "Polygon" and not part.is_empty)


def _number_at(pose: tuple[float, float, float], parts: list[list[shapely.Polygon]], firsts: Floats) -> int | None:
    """Which part, of all slices, a pose is in."""
    number = round(pose[2] / (2.0 * _HALF_SLICE)) % _SLICES
    for place, part in enumerate(parts[number]):
        if part.covers(shapely.Point(pose[:2])):
            return int(firsts[number] + place)
    return None


def _free_in_slice(problem: MobileRobot, number: int, surely: bool) -> shapely.Geometry:
    """Where the reference point may be at all headings of a slice, or at most at any of them."""
    body = _body(problem, _HEADINGS[number], surely)
    if not body:
        return shapely.box(*problem.bounds).buffer(problem.robot.circumscribed_radius)
    corners = np.concatenate(body)
    gap = problem.clearance
    (x0, y0), (x1, y1) = problem.bounds[:2] - corners.min(axis=0) + gap, problem.bounds[2:] - corners.max(axis=0) - gap
    if x0 > x1 or y0 > y1:
        return shapely.Polygon()
    grown = gap * _AROUND if surely else max(gap - TOLERANCE, 0.0)
    solids = [
        _forbidden(obstacle, piece, surely).buffer(grown, quad_segs=_ARC)
        for obstacle in problem.obstacles
        for piece in body
    ]
    return shapely.box(x0, y0, x1, y1).difference(shapely.union_all(solids))


def _body(problem: MobileRobot, heading: float, surely: bool) -> list[Points]:
    """Convex pieces, by their corners, that cover the robot at all headings of a slice, or that it always covers."""
    outline = shapely.Polygon(problem.robot.vertices)
    if not surely:
        shrunk = outline.buffer(-_HALF_SLICE * problem.robot.circumscribed_radius - TOLERANCE, join_style="mitre")
        return [piece @ _turned(heading) for piece in _convex(shrunk)]
    turns = [(heading - _HALF_SLICE, 1.0), (heading + _HALF_SLICE, 1.0), (heading, 1.0 / np.cos(_HALF_SLICE))]
    # A corner runs along an arc, which lies between its ends and the point where the tangents there meet.
    return [np.concatenate([scale * piece @ _turned(turn) for turn, scale in turns]) for piece in _convex(outline)]


def _turned(angle: float) -> Floats:
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def _convex(shape: shapely.Geometry) -> list[Points]:
    """The corners of convex pieces that make up a shape; none of an empty one."""
    pieces: list[Points] = []
    for part in _parts(shape):
        whole = part.convex_hull.area <= part.area * (1.0 + 1e-12)
        solids = [part] if whole else shapely.get_parts(shapely.constrained_delaunay_triangles(part))
        pieces += [shapely.get_coordinates(solid)[:-1] for solid in solids]
    return pieces


def _forbidden(obstacle: Obstacle, piece: Points, surely: bool) -> shapely.Geometry:
    """Where the reference point must not be, lest a convex piece of the robot be in the obstacle."""
    if isinstance(obstacle, Circle):
        places = shapely.MultiPoint(obstacle.center - piece).convex_hull
        radius = obstacle.radius * _AROUND if surely else obstacle.radius - TOLERANCE
        return places.buffer(max(radius, 0.0), quad_segs=_ARC)
    sums = [(corners[:, None] - piece).reshape(-1, 2) for corners in _convex(obstacle.polygon)]
    return shapely.union_all([shapely.MultiPoint(each).convex_hull for each in sums])
