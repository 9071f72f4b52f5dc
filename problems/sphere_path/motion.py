"""The motion of a sphere-path solution: a vehicle in its world, or a place in a configuration space."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.motion import Body, Column, Floats, Limit, Motion, Pace, Track, Values, loop
from problems.plane import outlines
from problems.problem import Solution
from problems.profile import ride

if TYPE_CHECKING:
    from problems.sphere_path.model import SpherePathModel
    from problems.sphere_path.vehicle import Vehicle

_IN_THE_PLANE = ("x", "y", "heading")
_IN_SPACE = {3: ("x", "y", "z"), 4: ("x", "y", "z", "yaw"), 6: ("x", "y", "z", "roll", "pitch", "yaw")}


def motion(problem: SpherePathModel, solution: Solution, pace: Pace) -> Motion:
    """Return the motion at most at --speed, by the solution's lengths: angles count as arcs of the farthest point.

    A vehicle's turns may be limited further, by a turn speed and acceleration of the sum of its angles.

    Raises:
        BadInput: If the pace limits turns, but nothing turns.
    """
    speed, gain = pace.moving(problem.kind, "units of its axes" if problem.vehicle is None else "m")
    path = np.array(solution["path"], np.float64)
    steps = np.diff(path, axis=0)
    lengths = np.linalg.norm(steps * problem.space.scale, axis=1)
    limits, speeds, gains = [speed, gain], np.full(len(steps), speed.value), np.full(len(steps), gain.value)
    if problem.vehicle is None:
        none = "where nothing turns"
        pace.refuse(problem.kind, turn_speed=none, turn_acceleration=none)
    else:
        turns = np.abs(steps[:, 2 if problem.mesh is None else 3 :]).sum(axis=1)
        for most, given, unit, name in (
            (speeds, pace.turn_speed, "rad/s", "turn speed"),
            (gains, pace.turn_acceleration, "rad/s^2", "turn acceleration"),
        ):
            if given is not None:
                slow = np.divide(given * lengths, turns, out=np.full(len(turns), np.inf), where=turns > 0.0)
                np.minimum(most, slow, out=most)
                limits.append(Limit(name, (given,), unit, "--" + name.replace(" ", "-")))
    way = ride(path, lengths, speeds, gains, pace)
    return Motion(way.times, (_track(problem, way.rows),), outlines(problem.obstacles), tuple(limits), way.notes)


def _track(problem: SpherePathModel, rows: Floats) -> Track:
    if problem.vehicle is None:
        return Values("", tuple(Column(f"axis_{axis}", "", values) for axis, values in enumerate(rows.T, start=1)))
    dimensions = 2 if problem.mesh is None else 3
    names = _IN_THE_PLANE if dimensions == 2 else _IN_SPACE[rows.shape[1]]
    units = ["m"] * dimensions + ["rad"] * 3
    columns = tuple(Column(*each) for each in zip(names, units, rows.T, strict=False))
    places, angles = np.zeros((len(rows), 3)), np.zeros((len(rows), 3))
    places[:, :dimensions] = rows[:, :dimensions]
    turns = rows.shape[1] - dimensions  # the last of them is about z
    angles[:, 3 - turns :] = rows[:, dimensions:]
    return Body("", columns, places, angles, _outline(problem.vehicle))


def _outline(vehicle: Vehicle) -> Floats | None:
    """Return the outline of a polygon, disc or ball; None for a mesh."""
    if vehicle.mesh is not None:
        return None
    return loop(np.array(vehicle.vertices or [(0.0, 0.0)]), vehicle.radius or 0.0)
