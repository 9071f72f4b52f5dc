"""The oracle of mobile-robot: is there a way, and how long is the shortest?

It shares no code with `evaluate`, and knows nothing of commands: its answers hold for any number of them.

A disc's centre may be anywhere on the floor outside of the obstacles grown by the disc's radius. The shortest way there
is a path in the visibility graph of the corners (`oracle_ways`).

For a polygon there are two proofs of a way and two of none. Two discs about the reference point serve for one of each.
The disc that encloses the robot: inside it the robot turns freely, so where that disc gets through, so does the robot.
The disc that the robot covers: where that one does not get through, neither does the robot.

Where these do not decide, `oracle_drives` looks for a way by turns and drives; `checker` verifies what it finds, so an
error there cannot become a wrong answer. And `_best_in_slices` tries to prove that there is no way, with slices of the
headings. In each slice the robot is shrunk to what it covers at all headings of the slice, and may slide in any
direction. Neighbouring slices are connected where their free places overlap. This robot can do all that the true one
can, and more, so where it has no way, the true one has none. If no proof succeeds, the bound is 0: the oracle cannot
tell.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from problems.mobile_robot import checker, oracle_drives
from problems.mobile_robot.checker import TOLERANCE
from problems.mobile_robot.oracle_shapes import (
    ARC,
    Floats,
    Points,
    convex,
    forbidden,
    free_of_disc,
    part_at,
    parts,
    room_for,
    shorter,
    turned,
)
from problems.mobile_robot.oracle_ways import length_of, shortest_way
from problems.problem import Answer, Solution

if TYPE_CHECKING:
    from problems.mobile_robot.model import MobileRobotModel

_SLICES = 120  # the number of slices of the headings
_HALF_SLICE = np.pi / _SLICES
_HEADINGS = 2.0 * _HALF_SLICE * np.arange(_SLICES)  # rad: the middle of each slice


def solve_exactly(problem: MobileRobotModel) -> Answer:
    """Return whether the goal can be reached, and bounds of the shortest way's length.

    An optimum of 0 means that there is a way, a lower bound above 0 that there is none: no robot gets nearer to the
    goal than that. A lower bound of 0 means that the oracle cannot tell.
    """
    # A robot that keeps a clearance is one that is thicker by it. If it covers no disc about its reference point, that
    # point may be anywhere, even over an obstacle, so the inner radius stays 0 and excludes nothing.
    outer, inner = (radius + problem.clearance if radius > 0.0 else 0.0 for radius in _discs(problem))
    # First the proof that there is no way, which also gives the lower bound of the length.
    least, away = _least(problem, inner)
    if away > 0.0:
        method = "visibility graph of a disc that the robot covers" if problem.robot.vertices else "visibility graph"
        return Answer("lower bound", away, f"{method}: the goal is out of reach")
    figures = {"shortest_length_at_least": least}
    # Then the proof that there is one.
    roomy = free_of_disc(problem, outer, surely=True)
    way = shortest_way(roomy, problem.start[:2], problem.goal[:2])
    if way is not None:
        method = "visibility graph of the enclosing disc" if problem.robot.vertices else "visibility graph"
        return _proven(f"{method}, for any number of commands", _solution(_turning_anywhere(problem, way)), figures)
    if problem.robot.vertices is None:
        method = "visibility graph, which cannot tell whether the robot gets through"
        return Answer("lower bound", 0.0, method, None, figures)
    return _of_a_polygon(problem, roomy, figures)


def _of_a_polygon(problem: MobileRobotModel, roomy: shapely.Geometry, figures: dict[str, float]) -> Answer:
    """Return the answer for a polygon whose enclosing disc does not get through."""
    # Before the search for a way, which would run to its end in vain if there is none.
    away = _best_in_slices(problem)
    if away > 0.0:
        return Answer("lower bound", away, f"{_SLICES} slices of the headings: the goal is out of reach")
    poses = oracle_drives.find_way(problem, roomy)
    if poses is not None:
        solution = _solution(poses)
        if checker.verify(problem, solution).feasible:
            return _proven("turns and drives, for any number of commands", solution, figures)
    method = "slices of the headings, turns and drives, which cannot tell whether the robot gets through"
    return Answer("lower bound", 0.0, method, None, figures)


def _proven(method: str, solution: Solution, figures: dict[str, float]) -> Answer:
    return Answer("optimum", 0.0, method, solution, figures | {"shortest_length_at_most": solution["length"]})


def _solution(poses: Floats) -> Solution:
    """Return the solution of poses between which the robot turns and drives alternately; headings are unwrapped."""
    steps = np.diff(poses, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    commands: list[list[str | float]] = [
        ["move", float(length)] if number % 2 else ["rotate", float(turn)]
        for number, (length, turn) in enumerate(zip(lengths, steps[:, 2], strict=True))
    ]
    return {"commands": commands, "path": poses.tolist(), "length": float(lengths.sum())}


def _turning_anywhere(problem: MobileRobotModel, way: Points) -> Floats:
    """Return the poses along a way on which the robot can turn anywhere."""
    poses = [np.array(problem.start)]
    for here, there in pairwise(way):
        step = there - here
        heading = poses[-1][2] + shorter(np.arctan2(step[1], step[0]) - poses[-1][2])
        poses += [np.array([*here, heading]), np.array([*there, heading])]
    return np.array([*poses, [*way[-1], poses[-1][2] + shorter(problem.goal[2] - poses[-1][2])]])


# Discs ----------------------------------------------------------------------------------------------------------------
def _discs(problem: MobileRobotModel) -> tuple[float, float]:
    """Return the radii of the discs about the reference point that enclose the robot, and that it covers.

    The second is 0 if the robot covers no such disc: if the reference point is not within its outline.
    """
    robot = problem.robot
    if robot.vertices is None:
        assert robot.radius is not None, "a robot is a polygon or a disc"
        return robot.radius, robot.radius
    outline, reference = shapely.Polygon(robot.vertices), shapely.Point(0.0, 0.0)
    covered = float(outline.exterior.distance(reference)) if outline.contains(reference) else 0.0
    return robot.circumscribed_radius, covered


def _least(problem: MobileRobotModel, radius: float) -> tuple[float, float]:
    """Return a lower bound of the length of a disc's way, and how near to the goal it gets at best, m.

    The shapes are the ones that are surely not too large. So the true disc's free places are part of these, and neither
    figure is greater than the true one.
    """
    start, goal = problem.start[:2], problem.goal[:2]
    straight = float(np.hypot(*np.subtract(start, goal)))
    if radius == 0.0:
        return straight, 0.0
    free = free_of_disc(problem, radius, surely=False)
    part = part_at(free, start)
    # An empty part means that rounding puts the start outside the free places: then nothing is proven.
    if not part.is_empty and not part.covers(shapely.Point(goal)):
        return np.inf, float(part.distance(shapely.Point(goal)))
    way = shortest_way(free, start, goal)
    return straight if way is None else length_of(way), 0.0


# Slices of the headings of a polygon ----------------------------------------------------------------------------------
def _best_in_slices(problem: MobileRobotModel) -> float:
    """Return a lower bound of the fitness of all poses that can be reached from slice to slice.

    It is 0 if the goal is among them, or in doubt; otherwise it is above 0, and the goal is out of reach. A motion that
    goes on turning passes from a slice to the next at one place, which must be free in both slices: hence the graph of
    parts that intersect.
    """
    # Nodes of the graph are the connected free parts of all slices, numbered slice by slice from ``firsts`` on.
    covered = _covered_in_a_slice(problem)
    pieces = [list(parts(_free_in_slice(problem, [piece @ turned(each) for piece in covered]))) for each in _HEADINGS]
    firsts = np.cumsum([0, *map(len, pieces)])
    pairs = [
        (firsts[number] + one, firsts[(number + 1) % _SLICES] + other)
        for number in range(_SLICES)
        for one, here in enumerate(pieces[number])
        for other, there in enumerate(pieces[(number + 1) % _SLICES])
        if here.intersects(there)
    ]
    rows, columns = np.array(pairs, np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(firsts[-1], firsts[-1]))
    _, labels = connected_components(graph, directed=False)
    start, goal = (_number_at(pose, pieces, firsts) for pose in (problem.start, problem.goal))
    if start is None or (goal is not None and labels[start] == labels[goal]):
        return 0.0
    place, radius = shapely.Point(problem.goal[:2]), problem.robot.circumscribed_radius
    fitness = [
        part.distance(place) + radius * max(0.0, abs(shorter(heading - problem.goal[2])) - _HALF_SLICE)
        for heading, several in zip(_HEADINGS, pieces, strict=True)
        for part in several
    ]
    # Above 0 even where a reached part comes as near as 0: the goal's pose is in none of them.
    return float(max(np.min(np.array(fitness)[labels == labels[start]]), np.nextafter(0.0, 1.0)))


def _number_at(pose: tuple[float, float, float], pieces: list[list[shapely.Polygon]], firsts: Floats) -> int | None:
    """Return the number of the free part, counted over all slices, that a pose is in; None if it is in none."""
    number = round(pose[2] / (2.0 * _HALF_SLICE)) % _SLICES
    for place, part in enumerate(pieces[number]):
        if part.covers(shapely.Point(pose[:2])):
            return int(firsts[number] + place)
    return None


def _covered_in_a_slice(problem: MobileRobotModel) -> list[Points]:
    """Return convex pieces of what the robot covers at all headings of a slice, in its frame at the middle heading.

    A turn by half a slice moves no point farther than that angle times the circumscribed radius. So a point that deep
    within the outline is covered at all headings. The checker's tolerance is taken off too, so that no path that it
    accepts contradicts a proof.
    """
    outline = shapely.Polygon(problem.robot.vertices)
    return convex(outline.buffer(-_HALF_SLICE * problem.robot.circumscribed_radius - TOLERANCE, join_style="mitre"))


def _free_in_slice(problem: MobileRobotModel, covered: list[Points]) -> shapely.Geometry:
    """Return a superset of where the reference point may be if the robot contains the ``covered`` pieces.

    The pieces are already turned to the slice's heading.
    """
    if not covered:  # a robot too slim for its shrunken outline: any place may be free
        return shapely.box(*problem.bounds).buffer(problem.robot.circumscribed_radius)
    (x0, y0), (x1, y1) = room_for(problem, np.concatenate(covered), problem.clearance)
    if x0 > x1 or y0 > y1:
        return shapely.Polygon()
    # The checker measures clearance with that tolerance, so a proof must grant it.
    gap = max(problem.clearance - TOLERANCE, 0.0)
    solids = [
        solid.buffer(gap, quad_segs=ARC)
        for obstacle in problem.obstacles
        for piece in covered
        for solid in forbidden(obstacle, piece, surely=False)
    ]
    return shapely.box(x0, y0, x1, y1).difference(shapely.union_all(solids))
