"""Convert a robot-path solution to a motion over time: retimed, or each straight segment from rest to rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.motion import Floats, Joints, Limit, Motion, Pace
from problems.problem import Solution
from problems.profile import ride
from problems.robots import scenery
from problems.robots.limits import Limits, limits_of, own_limits

if TYPE_CHECKING:
    from problems.robot_path.model import RobotPathModel

_AT_REST = 1e-9  # rad/s or m/s


def motion(problem: RobotPathModel, solution: Solution, pace: Pace) -> Motion:
    """Return the solution's trajectory if it has one, else the path with a stop at each corner.

    In the latter all joints move together, as fast as --speed, --acceleration and the robot's own limits allow.

    Raises:
        BadInput: if neither the command line nor the URDF states a speed of some joint, or an option does not apply.
    """
    if "trajectory" in solution:
        return _of_trajectory(problem, solution, pace)
    _refuse_turns(problem, pace)
    limits = limits_of(problem.robot, problem.scene.arm.joints, pace)
    path = np.array(solution["path"], np.float64)
    steps = np.diff(path, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    along = np.abs(steps) / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    way = ride(path, lengths, _slowest(limits.velocity, along), _slowest(limits.acceleration, along), pace)
    track = _joints(problem, limits, way.rows, way.velocities, way.accelerations)
    return _motion(problem, way.times, track, limits.stated()[:2], way.notes)


def retimed(problem: RobotPathModel, solution: Solution, pace: Pace) -> Solution:
    """Return the solution with the field ``trajectory``: the path over time, its corners rounded where it is free.

    Raises:
        BadInput: if a limit is missing, an option does not apply, or no motion keeps the limits.
    """
    from problems.robots import retiming, trajectory
    from problems.robots.dynamics import Dynamics
    from problems.robots.verifying import proof_of

    _refuse_turns(problem, pace)
    joints, proof = problem.scene.arm.joints, proof_of(problem)
    # What is off the proven chords moves no point of the robot farther than this; the check asks for `ROOM` besides.
    room = trajectory.reach_of(problem.robot, len(joints)) * retiming.EXCESS + 2.0 * trajectory.ROOM

    def is_free(path: Floats) -> bool:
        return not proof.of_path(path.tolist(), problem.clearance + room).objections

    limits = limits_of(problem.robot, joints, pace)
    dynamics = Dynamics.of(problem.robot, joints)
    rows = retiming.retime(np.array(solution["path"], np.float64), limits, dynamics, pace, is_free)
    return {**solution, "trajectory": rows.plain()}


def _of_trajectory(problem: RobotPathModel, solution: Solution, pace: Pace) -> Motion:
    """Return the rows of a trajectory as they are."""
    own = "whose trajectory has times of its own"
    if not pace.retime:
        pace.refuse(problem.kind, speed=own, turn_speed=own, acceleration=own, turn_acceleration=own, rate=own)
    found = solution["trajectory"]
    times, positions, velocities, accelerations = (
        np.array(found[name], np.float64) for name in ("t", "q", "qd", "qdd")
    )
    joints = problem.scene.arm.joints
    limits = limits_of(problem.robot, joints, pace) if pace.retime else own_limits(problem.robot, joints)
    torques = np.array(found["torque"], np.float64) if "torque" in found else None
    stated = tuple(each for each in limits.stated() if np.isfinite(each.values).all())
    notes = ["between two rows it is the cubic that has their positions and velocities"]
    resting = int(np.count_nonzero(np.abs(velocities[1:-1]).max(axis=1, initial=0.0) < _AT_REST))
    if resting:
        notes.append(f"it rests at {resting} corner{'s' if resting > 1 else ''} of the path")
    if torques is None:
        notes.append("the URDF states no mass beyond some joint: torques are unknown, and were not limited")
        stated = tuple(each for each in stated if each.name != "torque")
    track = _joints(problem, limits, positions, velocities, accelerations, torques)
    return _motion(problem, times, track, stated, tuple(notes))


def _motion(
    problem: RobotPathModel, times: Floats, track: Joints, limits: tuple[Limit, ...], notes: tuple[str, ...]
) -> Motion:
    frames = scenery.frames_over_time(problem.robot, track.joints, track.position)
    solids = scenery.solids_of(problem.robot, problem.obstacles, problem.attached)
    return Motion(times, (track,), (), limits, notes, frames, solids)


def _joints(
    problem: RobotPathModel,
    limits: Limits,
    positions: Floats,
    velocities: Floats,
    accelerations: Floats,
    torques: Floats | None = None,
) -> Joints:
    return Joints(
        "",
        limits.joints,
        positions,
        velocities,
        accelerations,
        torques,
        units=limits.units,
        urdf=problem.robot.urdf,
        standing=scenery.standing_joints(problem.robot, limits.joints),
    )


def _refuse_turns(problem: RobotPathModel, pace: Pace) -> None:
    none = "whose joints move at --speed"
    pace.refuse(problem.kind, turn_speed=none, turn_acceleration=none)


def _slowest(limit: Floats, along: Floats) -> Floats:
    """Return how fast each segment may be followed: no joint beyond its limit. ``along`` has the shares of joints."""
    with np.errstate(divide="ignore"):
        fastest: Floats = np.min(limit / along, axis=1, initial=1e9)
    return fastest
