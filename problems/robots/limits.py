"""Limits of robots' motions: velocities and torques of the URDF, accelerations of the problem file or an option."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput
from problems.motion import RAMP, Limit, Pace
from problems.robots.fields import Robot
from problems.robots.urdf import Urdf, read_urdf

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of each variable, all of shape (n,).

    Attributes:
        joints: the names of the variables.
        units: the unit of each, ``"rad"`` or ``"m"``.
        velocity: rad/s or m/s.
        acceleration: rad/s² or m/s².
        effort: N m or N; +inf where there is no limit.
        sources: where the limits of velocity, acceleration and effort come from.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    velocity: Floats
    acceleration: Floats
    effort: Floats
    sources: tuple[str, str, str]

    def stated(self) -> tuple[Limit, ...]:
        """Return the limits for the user; that of effort only where each joint has one."""
        unit = self.units[0] if len(set(self.units)) == 1 else "rad or m"
        force = {"rad": "N m", "m": "N"}.get(unit, "N m or N")
        stated = [
            Limit("velocity", tuple(self.velocity.tolist()), f"{unit}/s", self.sources[0]),
            Limit("acceleration", tuple(self.acceleration.tolist()), f"{unit}/s^2", self.sources[1]),
        ]
        if np.isfinite(self.effort).all():
            stated.append(Limit("torque", tuple(self.effort.tolist()), force, self.sources[2]))
        return tuple(stated)


def units_of(urdf: Urdf, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the unit of each joint."""
    return tuple("m" if urdf.joints[name].kind == "prismatic" else "rad" for name in joints)


def own_limits(robot: Robot, joints: Sequence[str]) -> Limits:
    """Return the limits that the robot states itself: URDF and problem file; +inf where there is none."""
    urdf = read_urdf(robot.urdf)
    known = {name: np.array([getattr(urdf.joints[each], name) for each in joints]) for name in ("velocity", "effort")}
    velocity, effort = (np.where(np.isfinite(each), each, np.inf) for each in known.values())
    acceleration = np.full(len(joints), np.inf)
    if robot.acceleration is not None:
        stated = np.ravel(robot.acceleration)
        if len(stated) not in (1, len(joints)):
            raise BadInput(
                f"robot.acceleration: expected one value, or {len(joints)} ({', '.join(joints)}), found {len(stated)}"
            )
        acceleration = np.broadcast_to(stated, acceleration.shape).astype(np.float64)
    source = "robot.acceleration" if robot.acceleration is not None else ""
    return Limits(tuple(joints), units_of(urdf, joints), velocity, acceleration, effort, ("URDF", source, "URDF"))


def limits_of(robot: Robot, joints: Sequence[str], pace: Pace) -> Limits:
    """Return the limits of a motion: the lesser of what the robot and the options state.

    Without any limit of acceleration, full speed is reached after `RAMP`.

    Raises:
        BadInput: if neither states a velocity of some joint.
    """
    own = own_limits(robot, joints)
    velocity, source = _least(own.velocity, own.sources[0], pace.speed, "--speed")
    for name, value, unit in zip(joints, velocity, own.units, strict=True):
        if not np.isfinite(value):
            raise BadInput(
                f"--speed: expected a speed in {unit}/s, as the URDF states no velocity of {name!r}, found nothing"
            )
    gain, gain_source = _least(own.acceleration, own.sources[1], pace.acceleration, "--acceleration")
    if not np.isfinite(gain).all():
        gain = np.where(np.isfinite(gain), gain, velocity / RAMP)
        gain_source = " and ".join(filter(None, [gain_source, f"default: full speed after {RAMP:g} s"]))
    return Limits(own.joints, own.units, velocity, gain, own.effort, (source, gain_source, own.sources[2]))


def _least(own: Floats, source: str, option: float | None, name: str) -> tuple[Floats, str]:
    """Return the lesser of a robot's limits and an option, and the sources of both."""
    sources = [source] if np.isfinite(own).any() else []
    sources += [name] if option is not None else []
    return np.minimum(own, np.inf if option is None else option), " and ".join(sources)
