"""A coordination solution over time: between two synchronisation points each robot goes from rest to rest, and waits.

It gains speed evenly, keeps it, and loses it evenly, as §2 has it; the check holds the times of all moves to that.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from problems.coordination import arms
from problems.coordination.diagram import move_times
from problems.errors import BadInput
from problems.motion import Column, Floats, Joints, Motion, Pace, Track, Values, joint_names
from problems.problem import Solution

if TYPE_CHECKING:
    from problems.coordination.arms import Robot
    from problems.coordination.problem import Coordination


class Moves(NamedTuple):
    """One robot's moves between synchronisation points, shape (moves,) each."""

    origins: Floats  # cells
    cells: Floats
    seconds: Floats
    ramps: Floats  # s, of gaining speed, and of losing it
    peaks: Floats  # cells/s


def motion(problem: Coordination, solution: Solution, pace: Pace) -> Motion:
    """Both robots; rows are also where one begins or ends to gain or lose speed, or waits."""
    own = "which has times of its own"
    pace.refuse(problem.kind, speed=own, turn_speed=own)
    corners = np.array([(0, 0), *solution["points"], problem.last])
    both = [
        _moves(along, problem.world.cells[robot], problem.world.times[robot]) for robot, along in enumerate(corners.T)
    ]
    ends = np.cumsum(np.maximum(both[0].seconds, both[1].seconds))
    starts = np.concatenate([[0.0], ends[:-1]])
    phases = [starts + part for m in both for part in (m.ramps, m.seconds - m.ramps, m.seconds)]
    times = pace.moments(np.concatenate([[0.0], ends, *phases]))
    if len(times) == 1 and np.any(corners[-1]):
        raise BadInput("solution: expected one that takes some time, found 0 s, as the problem's `times` have it")
    tracks = []
    for number, moves in enumerate(both):
        robot = None if problem.robots is None else problem.robots[number]
        tracks.append(_track(f"robot_{number + 1}", robot, *_at(times, starts, moves)))
    return Motion(times, tuple(tracks))


def _moves(along: Floats, cells: int, times: tuple[float, float]) -> Moves:
    counts = np.diff(along)
    seconds = move_times(cells, times)[counts]
    ramps = np.minimum(times[1], seconds / 2.0)
    peaks = np.divide(counts, seconds - ramps, out=np.zeros(len(counts)), where=seconds > 0.0)
    return Moves(along[:-1].astype(np.float64), counts.astype(np.float64), seconds, ramps, peaks)


def _at(times: Floats, starts: Floats, moves: Moves) -> tuple[Floats, Floats]:
    """Where a robot is, cells, and how quick, cells/s; at a synchronisation point it has arrived."""
    move = np.maximum(np.searchsorted(starts, times, side="left") - 1, 0)
    origin, cells, seconds, ramp, peak = (part[move] for part in moves)
    elapsed = times - starts[move]
    left = np.where(times < starts[move] + seconds, seconds - elapsed, 0.0)
    gained = _from_rest(np.minimum(elapsed, seconds / 2.0), ramp)
    lost = _from_rest(np.minimum(left, seconds / 2.0), ramp)
    place = np.where(elapsed < left, origin + peak * gained, origin + cells - peak * lost)
    share = np.divide(np.minimum(elapsed, left), ramp, out=(left > 0.0).astype(np.float64), where=ramp > 0.0)
    return np.where(elapsed > 0.0, place, origin), peak * np.minimum(share, 1.0)


def _from_rest(elapsed: Floats, ramp: Floats) -> Floats:
    """The way after some seconds, for a peak of 1."""
    rising = np.minimum(elapsed, ramp)
    way: Floats = np.divide(rising**2, 2.0 * ramp, out=np.zeros(len(ramp)), where=ramp > 0.0) + elapsed - rising
    return way


def _track(name: str, robot: Robot | None, cells: Floats, speeds: Floats) -> Track:
    if robot is None:
        return Values(name, (Column("cell", "cells", cells), Column("speed", "cells/s", speeds)))
    angles, directions = arms.places(robot, cells), arms.directions(robot, cells)
    links = arms.origins(robot, angles)
    return Joints(name, joint_names(angles.shape[1]), angles, directions * speeds[:, None], links=links)
