"""The oracle of sphere-path: exact answers for the cases that have a closed form, else a lower bound."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from problems.problem import Answer
from problems.sphere_path.checker import crossed_by
from problems.sphere_path.random_world import corridor_of
from problems.sphere_path.space import length_of

if TYPE_CHECKING:
    from problems.sphere_path.model import SpherePathModel

Floats = NDArray[np.float64]


def solve_exactly(problem: SpherePathModel) -> Answer:
    """Return what is known about the best path.

    A path that crosses nothing gives an upper bound. No path crosses fewer than none or is shorter than the straight
    one, so 0 is always a lower bound.
    """
    straight = problem.straight
    if crossed_by(problem, straight) == 0:
        return _of_path(problem, straight, "the straight way, which is free")
    if problem.random is not None and problem.random.corridor:
        start, goal = problem.ends
        corridor = corridor_of(problem.random, problem.space, start, goal)
        return _of_path(problem, corridor, "the corridor that the random spheres leave free")
    obstacles = problem.forbidden_spheres
    if len(obstacles) == 1 and not problem.space.periodic.any():
        centre = obstacles[0, :-1]
        # An end may touch the sphere. Rounding must not put it inside, so the radius is cut to the ends' distances.
        radius = min(float(obstacles[0, -1]), *(float(np.linalg.norm(end - centre)) for end in straight))
        length = around(straight[0], straight[-1], centre, radius)
        detour = length - length_of(straight)
        method = "the shortest way around one sphere, by two tangents and an arc, bounds aside"
        fitness = problem.length_weight * detour / (detour + problem.space.diagonal)
        return Answer("lower bound", fitness, method, figures={"length": length})
    method = "the straight way, which is not free: no path crosses fewer than no obstacles, and none is shorter"
    return Answer("lower bound", 0.0, method, figures={"length": length_of(straight)})


def _of_path(problem: SpherePathModel, places: Floats, method: str) -> Answer:
    """Return a path that crosses nothing: it is optimal, unless it has a detour and length counts."""
    length = length_of(places)
    fitness = problem.length_weight * problem.space.detour(places)
    solution = {"path": (places / problem.space.scale).tolist(), "crossed": 0, "length": length}
    return Answer("upper bound" if fitness else "optimum", fitness, method, solution, {"length": length})


def around(start: Floats, goal: Floats, centre: Floats, radius: float) -> float:
    """Return the length of the shortest way from start to goal around a sphere, in any number of dimensions.

    It lies in the plane of start, goal and centre: two tangents and the arc between them, if the straight way is
    blocked.

    Raises:
        ValueError: If start or goal lie within the sphere.
    """
    one, other = start - centre, goal - centre
    first, second = float(np.linalg.norm(one)), float(np.linalg.norm(other))
    if min(first, second) < radius:
        raise ValueError("expected a start and a goal outside the sphere")
    # arctan2 is exact for small angles too, where arccos of the cosine would lose digits.
    between = np.arctan2(_cross_size(one, other), float(one @ other))
    # Each tangent takes its angle at the centre; what is left between the points of contact is the arc.
    arc = between - np.arccos(radius / first) - np.arccos(radius / second)
    if arc <= 0.0:
        return float(np.linalg.norm(goal - start))
    return float(np.sqrt(first**2 - radius**2) + np.sqrt(second**2 - radius**2) + radius * arc)


def _cross_size(one: Floats, other: Floats) -> float:
    """Return |one| |other| sin(the angle between them), in any number of dimensions (Lagrange's identity)."""
    return float(np.sqrt(np.maximum(0.0, (one @ one) * (other @ other) - (one @ other) ** 2)))
