"""Convert an arm-path solution to a motion over time: one joint turns after another, each from rest to rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.errors import BadInput
from problems.motion import RAMP, Floats, Joints, Limit, Motion, Pace, joint_names, planar_links
from problems.plane import outlines
from problems.problem import Solution
from problems.profile import ride

if TYPE_CHECKING:
    from problems.arm_path.model import ArmPathModel


def motion(problem: ArmPathModel, solution: Solution, pace: Pace) -> Motion:
    """Return the motion in which each joint turns as fast as --speed and the arm's own limits allow.

    Raises:
        BadInput: if neither the command line nor the problem file states a speed, or an option does not apply.
    """
    none = "whose joints turn at --speed"
    pace.refuse(problem.kind, turn_speed=none, turn_acceleration=none)
    arm = problem.arm
    speeds, gains = _limits(problem, pace)
    path = np.array(solution["path"], np.float64)
    turns = np.abs(np.diff(path, axis=0))
    joint = np.argmax(turns, axis=1)  # of each move, the only one that turns
    way = ride(path, turns.sum(axis=1), np.array(speeds.values)[joint], np.array(gains.values)[joint], pace)
    links = planar_links(arm.links, arm.base, way.rows)
    track = Joints("", joint_names(len(arm.links)), way.rows, way.velocities, way.accelerations, links=links)
    return Motion(way.times, (track,), outlines(problem.obstacles), (speeds, gains), way.notes)


def _limits(problem: ArmPathModel, pace: Pace) -> tuple[Limit, Limit]:
    """Return the limits of speed and acceleration of each joint.

    Raises:
        BadInput: if neither the command line nor the problem file states a speed.
    """
    arm, joints = problem.arm, len(problem.arm.links)
    speed, speed_source = _least(pace.speed, arm.velocity, ("--speed", "arm.velocity"), joints)
    if speed is None:
        raise BadInput(
            f"--speed: expected a speed in rad/s, as a path of {problem.kind} has no times and its arm no `velocity`, "
            "found nothing"
        )
    gain, gain_source = _least(pace.acceleration, arm.acceleration, ("--acceleration", "arm.acceleration"), joints)
    if gain is None:
        gain, gain_source = speed / RAMP, f"default: full speed after {RAMP:g} s"
    return (
        Limit("velocity", tuple(speed.tolist()), "rad/s", speed_source),
        Limit("acceleration", tuple(gain.tolist()), "rad/s^2", gain_source),
    )


def _least(
    option: float | None, field: list[float] | None, names: tuple[str, str], joints: int
) -> tuple[Floats | None, str]:
    """Return the lesser of the command line's and the problem file's limit for each joint, and its sources.

    Return None and an empty text if neither states a limit.
    """
    known: list[tuple[str, Floats]] = []
    if option is not None:
        known.append((names[0], np.full(joints, option)))
    if field is not None:
        known.append((names[1], np.array(field)))
    if not known:
        return None, ""
    return np.min([values for _, values in known], axis=0), " and ".join(name for name, _ in known)
