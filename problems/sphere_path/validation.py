"""Validate the fields of a sphere-path problem against each other, beyond their types."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from problems.angles import plausible
from problems.plane import CONTACT
from problems.sphere_path.vehicle import dimensions_of

if TYPE_CHECKING:
    from problems.sphere_path.model import SpherePathModel
    from problems.sphere_path.random_world import Random
    from problems.sphere_path.vehicle import Vehicle

_FULL_TURN = 2.0 * np.pi
_ANGLES = {(2, 2): 0, (2, 3): 1, (3, 3): 0, (3, 4): 1, (3, 6): 3}  # a vehicle's angles, by (dimensions, axes)


def validate(problem: SpherePathModel) -> None:
    """Raise a `ValueError` that names the first field that does not fit the others."""
    _one_number_an_axis(problem)
    _one_kind_of_obstacles(problem)
    if problem.vehicle is not None:
        _fits_its_world(problem, problem.vehicle)
    if problem.random is not None:
        _leaves_room(problem, problem.random)
    _spheres_wrap_once(problem)
    # Last, since the spheres of a vehicle are made for it, which needs fields that fit and may take long.
    _ends_are_free(problem)


def _one_number_an_axis(problem: SpherePathModel) -> None:
    count = len(problem.start)
    for name, each in (("goal", problem.goal), ("bounds", problem.bounds), ("periodic", problem.periodic)):
        if each is not None and len(each) != count:
            raise ValueError(f"{name}: expected {count}, as many as start has, found {len(each)}")
    for axis, (low, high) in enumerate(problem.bounds):
        if not low < high:
            raise ValueError(f"bounds[{axis}]: expected least < greatest, found {[low, high]}")
        for name, place in (("start", problem.start), ("goal", problem.goal)):
            if not low <= place[axis] <= high:
                raise ValueError(f"{name}[{axis}]: expected {low:g} to {high:g}, found {place[axis]:g}")
    for number, sphere in enumerate(problem.spheres or []):
        if len(sphere) != count + 1:
            raise ValueError(f"spheres[{number}]: expected {count} numbers and a radius, found {len(sphere)} in all")
        if sphere[-1] <= 0.0:
            raise ValueError(f"spheres[{number}]: expected a radius greater than 0, found {sphere[-1]:g}")


def _one_kind_of_obstacles(problem: SpherePathModel) -> None:
    given = [name for name in ("spheres", "random", "vehicle") if getattr(problem, name) is not None]
    if len(given) != 1:
        raise ValueError(f"expected one of spheres, random and vehicle, found {' and '.join(given) or 'none'}")
    if problem.vehicle is None and (problem.obstacles or problem.mesh or problem.hierarchy):
        raise ValueError(f"vehicle: expected a vehicle, since obstacles or a mesh are given, found {given[0]} instead")


def _fits_its_world(problem: SpherePathModel, vehicle: Vehicle) -> None:
    """Raise if the vehicle's shape, its obstacles and its axes are not all of the plane, or all of space."""
    dimensions = dimensions_of(problem.mesh, vehicle.mesh)
    if dimensions == 3 and (vehicle.vertices is not None or problem.obstacles):
        raise ValueError("vehicle: expected a radius or a mesh, and no obstacles of the plane, beside a mesh")
    if dimensions == 3 and problem.mesh is None:
        raise ValueError("mesh: expected the obstacle of a vehicle in space, found nothing")
    # A turn changes nothing about a disc or ball.
    turns = (0, 1, 3) if vehicle.radius is None else (0,)
    fitting = [axes for (world, axes), angles in _ANGLES.items() if world == dimensions and angles in turns]
    if len(problem.start) not in fitting:
        raise ValueError(
            f"start: expected {' or '.join(map(str, fitting))} numbers for such a vehicle, found {len(problem.start)}"
        )
    for axis, (low, high) in enumerate(problem.bounds):
        if problem.periodic is not None and problem.periodic[axis]:
            if axis < dimensions:
                raise ValueError(f"periodic[{axis}]: expected false, as axis {axis + 1} is no angle, found true")
            if abs(high - low - _FULL_TURN) > 1e-6:
                raise ValueError(f"bounds[{axis}]: expected a full turn, as it is periodic, found {[low, high]}")
    _turns_within_reason(problem, dimensions)


def _turns_within_reason(problem: SpherePathModel, first: int) -> None:
    """Raise if an angle is implausibly large; the axes from the ``first`` on are angles."""
    for name in ("start", "goal", "bounds"):
        for axis, each in enumerate(getattr(problem, name)[first:], first):
            try:
                for angle in np.atleast_1d(each):
                    plausible(float(angle))
            except ValueError as error:
                raise ValueError(f"{name}[{axis}]: {error}") from error


def _leaves_room(problem: SpherePathModel, random: Random) -> None:
    """Raise if a random world's corridor has more places than a path has nodes, or less clearance than it keeps."""
    if random.corridor > problem.nodes:
        raise ValueError(
            f"random.corridor: expected at most nodes, {problem.nodes}, which bounds a path, found {random.corridor}"
        )
    if random.clearance < problem.clearance:
        raise ValueError(
            f"random.clearance: expected at least clearance, {problem.clearance:g}, which a path keeps from start to"
            f" goal, found {random.clearance:g}"
        )


def _spheres_wrap_once(problem: SpherePathModel) -> None:
    """Raise if a sphere with its clearance meets its own image along a periodic axis.

    The kernels look at three images only, which is enough for spheres no wider than a period.
    """
    shortest = problem.space.periods[problem.space.periodic].min(initial=np.inf)
    radii = [(f"spheres[{number}]", sphere[-1]) for number, sphere in enumerate(problem.spheres or [])]
    radii += [("random.radius", problem.random.radius[1])] if problem.random is not None else []
    for name, radius in radii:
        if 2.0 * (radius + problem.clearance) > shortest:
            less = f" less the clearance {problem.clearance:g}" if problem.clearance else ""
            raise ValueError(
                f"{name}: expected a radius of at most half a period, {shortest / 2:g}{less}, found {radius:g}"
            )


def _ends_are_free(problem: SpherePathModel) -> None:
    # With the same spheres and the same contact as the fitness, so that a valid file never starts with a crossing.
    obstacles = problem.forbidden_spheres
    for name, place, written in (("start", problem.ends[0], problem.start), ("goal", problem.ends[1], problem.goal)):
        depth = obstacles[:, -1] - CONTACT - problem.space.clearances(place[None], obstacles[:, :-1])
        if np.any(depth > 0.0):
            found = _too_near(problem, depth) if problem.spheres else _why_blocked(problem, written)
            raise ValueError(f"{name}: expected a place clear of all obstacles, found {written} {found}")


def _too_near(problem: SpherePathModel, depth: NDArray[np.float64]) -> str:
    """Return, as the end of an error, the sphere that a place is deepest in; ``depth`` includes the clearance, (n,)."""
    worst = int(np.argmax(depth))
    is_in = depth[worst] > problem.clearance
    return f"{'in' if is_in else f'nearer than the clearance {problem.clearance:g} to'} spheres[{worst}]"


def _why_blocked(problem: SpherePathModel, place: list[float]) -> str:
    """Return, as the end of an error, whether the vehicle is too near to an obstacle, or only `accuracy` blocks it."""
    gap = float(problem.gaps(np.array([place]))[0])
    if gap <= 0.0:
        return "in collision"
    if gap <= problem.clearance:
        return f"{gap:.3g} m from an obstacle, no more than the clearance {problem.clearance:g}"
    too_near = f"what the clearance {problem.clearance:g} forbids" if problem.clearance else "a collision"
    spare = gap - problem.clearance
    return (
        f"nearer than `accuracy` to {too_near}, though {spare:.3g} m away from {'it' if problem.clearance else 'one'}:"
        f" a finer accuracy may free it, such as {min(spare, problem.accuracy) / 2:.2g} instead of {problem.accuracy:g}"
    )
