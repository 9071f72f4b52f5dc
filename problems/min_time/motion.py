"""The motion of a min-time solution: its trajectory, which already has times."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.min_time.arm import LIMITS
from problems.motion import Joints, Limit, Motion, Pace, joint_names, planar_links
from problems.problem import Solution

if TYPE_CHECKING:
    from problems.min_time.model import MinTimeModel


_BETWEEN = "between rows the limits hold for the law of docs/min-time.md; a cubic through the rows may exceed torque"


def motion(problem: MinTimeModel, solution: Solution, pace: Pace) -> Motion:
    """Return the trajectory as a motion, row by row.

    Accelerations and torques of a row are those of the step that begins there. A pace is refused: another speed would
    no longer be the solution that was verified.

    Raises:
        BadInput: If the pace states a speed, an acceleration or a rate.
    """
    own = "which has times of its own"
    pace.refuse(problem.kind, speed=own, turn_speed=own, acceleration=own, turn_acceleration=own,
                rate="whose rows are those of the solution")  # fmt: skip
    arm, rows = problem.arm, solution["trajectory"]
    position, velocity, acceleration, effort = (
        np.array(rows[name], np.float64) for name in ("q", "qd", "qdd", "torque")
    )
    links = None if arm.lengths is None else planar_links(arm.lengths, (0.0, 0.0), position)
    names = joint_names(arm.size) if arm.is_planar else tuple(arm.names)
    track = Joints("", names, position, velocity, acceleration, effort, links)
    limits = tuple(
        Limit(name, tuple(values), unit.replace("²", "^2").replace("³", "^3"), f"arm.{name}")
        for name, unit in LIMITS.items()
        if (values := getattr(arm, name)) is not None
    )
    notes = (_BETWEEN,) if arm.velocity is not None else (_BETWEEN, "no limit of velocity is stated: arm.velocity")
    return Motion(np.array(rows["t"], np.float64), (track,), limits=limits, notes=notes)
