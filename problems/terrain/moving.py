"""A terrain solution over time: from the centre of a cell to that of the next."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.motion import Body, Column, Motion, Pace, loop, straight
from problems.problem import Solution

if TYPE_CHECKING:
    from problems.terrain.problem import Terrain


def motion(problem: Terrain, solution: Solution, pace: Pace) -> Motion:
    """At an even speed, cells/s, whatever the difficulty; the heading of a row is that of the step that begins there.

    In space x is the column and y the row backwards, so that headings are anticlockwise from x.
    """
    speed = pace.along(problem.kind, "cells/s")
    pace.refuse(problem.kind, turn_speed="where turns take no time")
    path = np.array(solution["path"], np.float64)
    steps = np.diff(path, axis=0)
    seconds = np.hypot(steps[:, 0], steps[:, 1]) / speed
    times, places = straight(path, seconds, pace)
    row, column = places.T
    headings = np.array([heading for heading, cells in solution["moves"] for _ in range(cells)] or [0.0])
    begun = np.searchsorted(np.cumsum(seconds), times, side="right")
    heading = headings[np.minimum(begun, len(headings) - 1)]
    still = np.zeros(len(times))
    robot = Body(
        "",
        (Column("row", "cells", row), Column("column", "cells", column), Column("heading", "rad", heading)),
        np.column_stack([column, -row, still]),
        np.column_stack([still, still, heading]),
        loop(np.zeros((1, 2)), problem.robot_radius) if problem.robot_radius > 0.0 else None,
    )
    return Motion(times, (robot,))
