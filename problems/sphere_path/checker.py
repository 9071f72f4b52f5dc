"""The verification of sphere-path solutions. It shares no code with the kernels.

Crossed spheres are counted by distances in closed form. For a vehicle the path is also followed in its world, and only
a collision there makes it infeasible: the spheres cover more than the configurations in collision.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from problems.errors import BadInput, first_line
from problems.nearest import least_along
from problems.plane import CONTACT
from problems.problem import Clearance, Solution, Verdict
from problems.sphere_path.space import length_of
from problems.tables import Table

if TYPE_CHECKING:
    from problems.sphere_path.model import SpherePathModel
    from problems.sphere_path.world import World

Floats = NDArray[np.float64]

_ROUNDING = 1e-9  # allowed error of places, as a share of the box
_TOLERANCE = 1e-6  # allowed error of the length, as a share of it
_MOST_SPANS = 100  # of an axis that a path may go beyond one for each of its rows: checking takes time for each
_ACCURACY = 1e-3  # of a vehicle's clearance, as a share of the vehicle's size


class PathSolution(Table):
    """A solution of sphere-path, as `SpherePath.decode` writes it."""

    path: Annotated[list[list[Annotated[float, Field(ge=-1e9, le=1e9)]]], Field(min_length=2)]
    crossed: Annotated[int, Field(ge=0)]
    length: Annotated[float, Field(ge=0)]


def verify(problem: SpherePathModel, solution: Solution) -> Verdict:
    """Return the path's fitness, by the obstacles that it crosses and its detour, and all that is wrong with it."""
    claimed = _parsed(problem, solution)
    path = np.array(claimed.path)
    places = path * problem.space.scale
    # Places as lengths, as in the fitness: a vehicle's angles count as arcs.
    crossed, length = crossed_by(problem, places), length_of(places)
    if problem.vehicle is None:
        clearance, collisions = _clearance_of_spheres(problem, places), list(_crossings(crossed, problem.clearance))
    else:
        # Crossed spheres still count in the fitness, but only the world decides whether the path is feasible.
        clearance, collisions = _in_the_world(problem, path)
    objections = [
        *_wrong_ends(problem, path),
        *_beyond_bounds(problem, path),
        *_wrong_claims(claimed, crossed, length),
        *collisions,
    ]
    fitness = crossed + problem.length_weight * problem.space.detour(places)
    return Verdict(fitness, tuple(objections), clearance)


def crossed_by(problem: SpherePathModel, places: Floats) -> int:
    """Return how many obstacles a path crosses; its places are lengths, shape (rows, axes)."""
    obstacles = problem.forbidden_spheres
    away = problem.space.clearances(places, obstacles[:, :-1])
    return int(np.count_nonzero(away < obstacles[:, -1] - CONTACT))


def _parsed(problem: SpherePathModel, solution: Solution) -> PathSolution:
    try:
        claimed = PathSolution.model_validate_json(json.dumps(solution), strict=True)
    except ValidationError as error:
        raise first_line(error, PathSolution, "solution") from None
    for number, row in enumerate(claimed.path):
        if len(row) != len(problem.start):
            raise BadInput(f"solution: path[{number}]: expected {len(problem.start)} numbers, found {len(row)}")
    _refuse_a_long_way(problem, np.array(claimed.path))
    return claimed


def _refuse_a_long_way(problem: SpherePathModel, path: Floats) -> None:
    """Refuse a path that turns, or goes to and fro, for so long that checking it would not end."""
    low, high = problem.space.bounds.T
    spans, most = np.sum(np.abs(np.diff(path, axis=0)) / (high - low), axis=0), len(path) + _MOST_SPANS
    if max(spans) > most:
        axis = int(np.argmax(spans))
        raise BadInput(
            f"solution: path: expected at most {most} times the bounds' width along axis {axis + 1}, "
            f"found {spans[axis]:g}"
        )


def _wrong_ends(problem: SpherePathModel, path: Floats) -> Iterator[str]:
    """Yield which ends of the path are wrong; it may end a number of full periods away from the goal."""
    rounding = _ROUNDING * problem.space.span
    if np.any(np.abs(path[0] - problem.start) * problem.space.scale > rounding):
        yield f"the path starts at {path[0].tolist()}, not at {problem.start}"
    if np.any(np.abs(problem.space.shorter((path[-1] - problem.goal) * problem.space.scale)) > rounding):
        yield f"the path ends at {path[-1].tolist()}, not at {problem.goal}"


def _beyond_bounds(problem: SpherePathModel, path: Floats) -> Iterator[str]:
    # Rows are unwrapped along periodic axes, so only the other axes have bounds.
    low, high = problem.space.bounds.T
    rounding = _ROUNDING * (high - low)
    beyond = ((path < low - rounding) | (path > high + rounding)) & ~problem.space.periodic
    for row, axis in np.argwhere(beyond):
        yield f"row {row + 1} of the path leaves the bounds of axis {axis + 1}: {path[row, axis]:g}"


def _wrong_claims(claimed: PathSolution, crossed: int, length: float) -> Iterator[str]:
    if claimed.crossed != crossed:
        yield f"the path crosses {crossed} spheres, not {claimed.crossed}"
    if abs(claimed.length - length) > _TOLERANCE * max(1.0, length):
        yield f"the path is {length:g} long, not {claimed.length:g}"


def _crossings(crossed: int, clearance: float) -> Iterator[str]:
    if crossed:
        near = f", or comes nearer to them than the clearance {clearance:g}" if clearance else ""
        yield f"the path crosses {crossed} spheres{near}"


def _clearance_of_spheres(problem: SpherePathModel, places: Floats) -> Clearance:
    """Return the least gap between the path and the obstacles, in the unit of the axes; negative in a sphere."""
    obstacles = problem.obstacle_spheres
    if not len(obstacles):
        return Clearance(np.inf, unit="")
    gaps = [problem.space.clearances(np.stack(pair), obstacles[:, :-1]) - obstacles[:, -1] for pair in pairwise(places)]
    segment, sphere = np.unravel_index(np.argmin(gaps), (len(gaps), len(obstacles)))
    where = {"segment": int(segment) + 1, "sphere": int(sphere)}
    return Clearance(float(gaps[segment][sphere]), where, unit="")


# A vehicle in its world -----------------------------------------------------------------------------------------------
def _in_the_world(problem: SpherePathModel, path: Floats) -> tuple[Clearance, list[str]]:
    """Return the clearance of the vehicle on its path, and the places where it is less than it must be.

    A path that crosses spheres may still be free here, since the spheres reach up to ``accuracy`` farther.
    """
    from problems.sphere_path.world import TOLERANCE, World

    world = World(problem)
    clearance = _clearance_of_vehicle(world, path)
    objections = list(_collisions(problem, world, path))
    if not objections and clearance.least < problem.clearance - TOLERANCE:
        objections = [_objection(problem, clearance.where["segment"], clearance.where["configuration"])]
    return clearance, objections


def _clearance_of_vehicle(world: World, path: Floats) -> Clearance:
    """Return the least gap on the way, m, 0 in collision; it is too large by at most `_ACCURACY` of the vehicle's size.

    Between two moments no gap shrinks by more than the vehicle moves, which is what `least_along` needs.
    """
    moves = list(pairwise(path))

    def at(move: int, share: float) -> Floats:
        begin, end = moves[move]
        configuration: Floats = begin + share * (end - begin)
        return configuration

    # No gap changes by more than any point of the vehicle moves: that bounds what lies between measured places.
    ways = [world.way(begin, end) for begin, end in moves]
    accuracy = _ACCURACY * world.reach
    least, move, share = least_along(lambda *place: world.clearance(at(*place)), ways, accuracy)
    if np.isposinf(least):
        return Clearance(least)
    configuration = at(move, share)
    where = {"segment": move + 1, "obstacle": world.nearest(configuration), "configuration": configuration.tolist()}
    return Clearance(max(0.0, least), where)


def _collisions(problem: SpherePathModel, world: World, path: Floats) -> Iterator[str]:
    for number, (begin, end) in enumerate(pairwise(path), start=1):
        contact = world.contact(begin, end, problem.clearance)
        if contact is not None:
            yield _objection(problem, number, contact.tolist())


def _objection(problem: SpherePathModel, segment: int, configuration: list[float]) -> str:
    place = ", ".join(f"{each:.4g}" for each in configuration)
    near = f", or comes nearer to one than the clearance {problem.clearance:g} m," if problem.clearance else ""
    return f"segment {segment} of the path: the vehicle meets an obstacle{near} at [{place}]"
