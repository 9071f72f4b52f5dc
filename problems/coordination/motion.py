"""Convert a coordination solution to a motion over time.

Between two synchronisation points each robot moves from rest to rest and then waits for the other. Its speed rises
linearly, stays constant and falls linearly (§2), which the check verifies by the time of each move. An arm also stops
where its own path has a corner, because its joints' velocities would jump there. That takes longer than planned, but is
as safe: between two synchronisation points the robots may move in any way.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from problems.coordination import arms
from problems.errors import BadInput
from problems.motion import Column, Floats, Joints, Limit, Motion, Pace, Track, Values, joint_names
from problems.problem import Solution
from problems.profile import Profile

if TYPE_CHECKING:
    from problems.coordination.arms import Robot
    from problems.coordination.model import CoordinationModel

_SAME = 1e-9  # cells: places that are no farther apart are the same


class Law(NamedTuple):
    """The motion law of a robot (§2)."""

    robot: Robot | None
    speed: float  # cells/s
    acceleration: float  # cells/s²
    corners: Floats  # of its own path, where it must stop, cells, increasing


def motion(problem: CoordinationModel, solution: Solution, pace: Pace) -> Motion:
    """Return the motion of both robots. Its rows include all moments at which an acceleration of either changes.

    Raises:
        BadInput: if an option sets a speed or acceleration, or if a robot's speed would jump.
    """
    own = "which has times of its own"
    pace.refuse(problem.kind, speed=own, turn_speed=own, acceleration=own, turn_acceleration=own)
    laws = [_law(problem, number) for number in (0, 1)]
    timed = _timed(laws, [(0, 0), *solution["points"], problem.last])
    times = pace.moments(np.concatenate([each.knots for each in timed]))
    tracks = (_track(f"robot_{number}", *each, times) for number, each in enumerate(zip(laws, timed, strict=True), 1))
    late = float(times[-1]) - solution["time"]
    notes = (f"it takes {late:.4g} s longer than the plan, as the arms rest at the corners of their own paths",)
    return Motion(
        times,
        tuple(tracks),
        limits=tuple(limit for number, law in enumerate(laws) for limit in _limits(problem, number, law)),
        notes=notes if late > 1e-6 else (),
    )


def _law(problem: CoordinationModel, number: int) -> Law:
    """Return the motion law of a robot, 0 or 1.

    Raises:
        BadInput: if it moves or reaches full speed in no time, so that its speed would jump.
    """
    robot = None if problem.robots is None else problem.robots[number]
    per_cell, to_speed = problem.world.times[number]
    if robot is not None and per_cell == 0.0:  # its path is a single point, so any speed will do
        per_cell, to_speed = 1e-3, 1e-3
    if per_cell == 0.0 or to_speed == 0.0:
        where = f"the times of robot {number + 1}" if robot is None else f"robots[{number}].acceleration"
        raise BadInput(
            f"{where}: expected more than 0 s for a cell and more than 0 s to reach full speed, as speed would jump "
            f"otherwise, found {per_cell:g} and {to_speed:g}"
        )
    return Law(robot, 1.0 / per_cell, 1.0 / per_cell / to_speed, np.empty(0) if robot is None else arms.corners(robot))


def _timed(laws: list[Law], points: list[tuple[int, int]]) -> list[Profile]:
    """Return the pieces of both robots' motions; those after a point begin when both robots have reached it."""
    lengths: tuple[list[float], ...] = ([], [])
    starts: tuple[list[float], ...] = ([], [])
    clock = 0.0
    for point, following in pairwise(points):
        arrivals = []
        for robot, law in enumerate(laws):
            first, last = point[robot], following[robot]
            inner = law.corners[(law.corners > first + _SAME) & (law.corners < last - _SAME)]
            rests = np.array([first, *inner, last], np.float64)
            pieces = np.diff(rests) if last > first else np.empty(0)
            alone = _profile(law, pieces)
            lengths[robot].extend(pieces)
            starts[robot].extend(clock + alone.begins)
            arrivals.append(clock + alone.seconds.sum())
        clock = max(arrivals)
    return [_profile(law, np.array(lengths[robot]), np.array(starts[robot])) for robot, law in enumerate(laws)]


def _profile(law: Law, lengths: Floats, starts: Floats | None = None) -> Profile:
    return Profile(lengths, np.full(len(lengths), law.speed), np.full(len(lengths), law.acceleration), starts)


def _track(name: str, law: Law, timed: Profile, times: Floats) -> Track:
    """Return a robot's track: the joints of an arm, or the cells of a diagram without arms."""
    cells, speeds, piece = timed.at(times)
    if law.robot is None:
        return Values(name, (Column("cell", "cells", cells), Column("speed", "cells/s", speeds)))
    gains, begun = timed.gains(times)
    middles = np.append(np.cumsum(timed.lengths) - timed.lengths / 2.0, 0.0)  # the 0 serves a robot without pieces
    ways = arms.directions(law.robot, middles)  # one for each piece, since no piece contains a corner
    angles = arms.places(law.robot, cells)
    links = arms.origins(law.robot, angles)
    velocity, acceleration = ways[piece] * speeds[:, None], ways[begun] * gains[:, None]
    return Joints(name, joint_names(angles.shape[1]), angles, velocity, acceleration, links=links)


def _limits(problem: CoordinationModel, number: int, law: Law) -> tuple[Limit, ...]:
    """Return the limits of a robot, which the problem file states."""
    name, to_speed = f"robot_{number + 1}", law.speed / law.acceleration
    if law.robot is None:
        source = "diagram.times" if problem.diagram is not None else "random.times"
        return (
            Limit(f"{name} speed", (law.speed,), "cells/s", source),
            Limit(f"{name} time to full speed", (to_speed,), "s", source),
        )
    return (
        Limit(f"{name} velocity", tuple(law.robot.speeds), "rad/s", f"robots[{number}].speeds"),
        Limit(f"{name} time to full speed", (to_speed,), "s", f"robots[{number}].acceleration"),
    )
