"""The motion of a terrain solution: from the centre of one cell to that of the next, with turns on the spot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.motion import Body, Column, Floats, Motion, Pace, loop
from problems.problem import Solution
from problems.profile import drive

if TYPE_CHECKING:
    from problems.terrain.model import TerrainModel

_HALF_A_CELL = 0.5  # cells: the radius that limits the turns of a robot without a radius


def motion(problem: TerrainModel, solution: Solution, pace: Pace) -> Motion:
    """Return the motion at most at --speed, cells/s, whatever the difficulty, with turns by the shorter way.

    The robot starts with the heading of its first move. In space x is the column and y the negative row, so that
    headings are anticlockwise from x.
    """
    speed, gain = pace.moving(problem.kind, "cells")
    turn, turn_gain = pace.turning(speed.value, gain.value, problem.robot_radius or _HALF_A_CELL)
    poses = _with_turns(np.array(solution["path"], np.float64), solution["moves"])
    way = drive(poses, (speed.value, gain.value), (turn.value, turn_gain.value), pace)
    row, column, heading = way.rows.T
    still = np.zeros(len(way.times))
    robot = Body(
        "",
        (Column("row", "cells", row), Column("column", "cells", column), Column("heading", "rad", heading)),
        np.column_stack([column, -row, still]),
        np.column_stack([still, still, heading]),
        loop(np.zeros((1, 2)), problem.robot_radius) if problem.robot_radius > 0.0 else None,
    )
    return Motion(way.times, (robot,), limits=(speed, gain, turn, turn_gain), notes=way.notes)


def _with_turns(path: Floats, moves: list[tuple[float, int]]) -> Floats:
    """Return rows of row, column and heading (rad, unwrapped), with a turn on the spot wherever the heading changes."""
    headings = np.unwrap([heading for heading, cells in moves for _ in range(cells)] or [0.0])
    # Each inner cell twice: once with the heading of arrival, once with that of departure.
    places = np.repeat(path, 2, axis=0)[1:-1] if len(path) > 1 else path
    return np.column_stack([places, np.repeat(headings, 2)[: len(places)]])
