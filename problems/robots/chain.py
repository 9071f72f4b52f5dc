"""The moving bodies of a robot: which joints are variables, where the others are welded, and the frames of all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput, did_you_mean
from problems.robots.arm import FIXED, PRISMATIC, REVOLUTE, Arm
from problems.robots.fields import Robot
from problems.robots.shapes import chained
from problems.robots.srdf import Srdf
from problems.robots.urdf import IDENTITY, MOVING, WHERE, Joint, Urdf

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

FULL_TURNS = (-2.0 * math.pi, 2.0 * math.pi)
"""The limits of continuous joints, rad."""
_ROUNDING = 1e-9  # rad or m


@dataclass(frozen=True, eq=False)
class Chain:
    """The kinematics of an `Arm`; see there for the fields."""

    joints: tuple[str, ...]
    bodies: tuple[str, ...]
    links: tuple[str, ...]
    link_body: Integers
    link_placements: Floats
    parents: Integers
    kinds: Integers
    variables: Integers
    scales: Floats
    placements: Floats
    axes: Floats
    limits: Floats
    velocity: Floats
    effort: Floats

    def frames(self, configurations: Floats) -> Floats:
        """Return the frame of each body in the world; see `frames_of`."""
        return frames_of(self, configurations)

    def random(self, count: int, seed: int) -> Floats:
        """Return configurations spread evenly over the limits, shape (count, n); a continuous joint turns once."""
        low, high = self.limits.T
        turns = (low <= FULL_TURNS[0]) & (high >= FULL_TURNS[1])
        low, high = np.where(turns, -np.pi, low), np.where(turns, np.pi, high)
        spread: Floats = low + (high - low) * np.random.default_rng(seed).random((count, len(low)))
        return spread


def frames_of(arm: Chain | Arm, configurations: Floats) -> Floats:
    """Return the frame of each body in the world: configurations (N, n) to placements (N, B, 12)."""
    frames = np.empty((len(configurations), len(arm.parents), 12))
    frames[:, 0] = arm.placements[0]
    for body in range(1, len(arm.parents)):
        multiplier, offset = arm.scales[body]
        values = configurations[:, arm.variables[body]] * multiplier + offset
        moved = _chained(arm.placements[body][None], _motions(int(arm.kinds[body]), arm.axes[body], values))
        frames[:, body] = _chained(frames[:, arm.parents[body]], moved)
    return frames


def variables_of(robot: Robot, urdf: Urdf, srdf: Srdf) -> list[str]:
    """Return the joints that are variables, in the order of configurations.

    Raises:
        BadInput: if the file names a joint or group that cannot move.
    """
    if robot.group is not None:
        return srdf.joints_of(robot.group, urdf)
    names = robot.joints if robot.joints is not None else urdf.movable
    if not names:
        raise BadInput(f"{WHERE}: expected joints that move, found none")
    for name in names:
        if name in urdf.movable:
            continue
        joint = urdf.joints.get(name)
        if joint is None:
            expected = f"a joint of the URDF, found {name!r}{did_you_mean(name, urdf.movable)}"
        elif joint.mimic is not None:
            expected = f"joints that move by themselves, found {name!r}, which follows {joint.mimic[0]!r}; leave it out"
        else:
            expected = f"joints that move, found {name!r} of type {joint.kind}"
        raise BadInput(f"robot.joints: expected {expected}")
    return names


def chain_of(urdf: Urdf, variables: Sequence[str], fixed: Mapping[str, float], base: Floats = IDENTITY) -> Chain:
    """Return the bodies that a choice of joints moves; all other joints are welded.

    Args:
        urdf: the robot.
        variables: the joints that move, in the order of configurations.
        fixed: where other joints stand, rad or m; 0 or the nearest limit for those that it does not name.
        base: the placement of the root link in the world, shape (12,).

    Raises:
        BadInput: if a joint cannot move as asked, or ``fixed`` names joints that are not there or move.
    """
    _refuse_wrong(fixed, urdf, variables)
    limits = [_limits_of(urdf.joints[name]) for name in variables]
    bodies, parents, kinds, numbers = ["world"], [-1], [FIXED], [-1]
    scales, placements, axes = [(1.0, 0.0)], [IDENTITY], [np.zeros(3)]
    at = {urdf.root: (0, base)}
    for joint in urdf.joints.values():
        parent, place = at[joint.parent]
        placement = chained(place, joint.placement)
        followed, multiplier, offset = _followed(joint, urdf)
        if joint.kind not in MOVING:
            at[joint.child] = (parent, _welded(joint, placement))
        elif followed.name not in variables:
            value = _value_of(followed, fixed) * multiplier + offset
            motion = _motions(_kind_of(joint), joint.axis, np.array([value]))[0]
            at[joint.child] = (parent, chained(placement, motion))
        else:
            at[joint.child] = (len(bodies), IDENTITY)
            bodies.append(joint.name)
            parents.append(parent)
            kinds.append(_kind_of(joint))
            numbers.append(list(variables).index(followed.name))
            scales.append((multiplier, offset))
            placements.append(placement)
            axes.append(joint.axis)
    moving = [urdf.joints[name] for name in variables]
    return Chain(
        joints=tuple(variables),
        bodies=tuple(bodies),
        links=tuple(urdf.links),
        link_body=np.array([at[link][0] for link in urdf.links], np.int64),
        link_placements=np.array([at[link][1] for link in urdf.links]),
        parents=np.array(parents, np.int64),
        kinds=np.array(kinds, np.int64),
        variables=np.array(numbers, np.int64),
        scales=np.array(scales),
        placements=np.array(placements),
        axes=np.array(axes),
        limits=np.array(limits, np.float64).reshape(-1, 2),
        velocity=np.array([joint.velocity for joint in moving]),
        effort=np.array([joint.effort for joint in moving]),
    )


def _kind_of(joint: Joint) -> int:
    return PRISMATIC if joint.kind == "prismatic" else REVOLUTE


def _limits_of(joint: Joint) -> tuple[float, float]:
    """Return the limits of a variable."""
    if joint.kind == "continuous":
        return FULL_TURNS
    at = f"{WHERE}: joint {joint.name!r}"
    mend = 'state <limit lower=".." upper=".."/> in the URDF'
    if joint.kind == "revolute":
        mend += ', or make it type="continuous"'
    if joint.limits is None:
        raise BadInput(f"{at}: expected limits of a joint that moves, found none; {mend}")
    low, high = joint.limits
    if not low < high:
        raise BadInput(
            f"{at}: expected lower < upper for a joint that moves, found {low:g} and {high:g}; {mend}, or leave it out "
            "of robot.joints"
        )
    return low, high


def _welded(joint: Joint, placement: Floats) -> Floats:
    """Return the placement of the link beyond a fixed joint."""
    if joint.kind != "fixed":
        raise BadInput(
            f"{WHERE}: joint {joint.name!r}: expected a joint of one axis, found type {joint.kind}; weld it by "
            'type="fixed", or replace it by joints of one axis each'
        )
    return placement


def _value_of(joint: Joint, fixed: Mapping[str, float]) -> float:
    """Return where a welded joint stands, rad or m."""
    if joint.name in fixed:
        return fixed[joint.name]
    if joint.limits is None or joint.kind == "continuous":
        return 0.0
    return max(joint.limits[0], min(0.0, joint.limits[1])) if joint.limits[0] <= joint.limits[1] else 0.0


def _followed(joint: Joint, urdf: Urdf) -> tuple[Joint, float, float]:
    """Return the joint whose value moves this one, multiplier and offset: itself, unless it mimics another."""
    multiplier, offset, seen = 1.0, 0.0, [joint.name]
    while joint.mimic is not None:
        name, factor, shift = joint.mimic
        offset += multiplier * shift
        multiplier *= factor
        if name not in urdf.joints or name in seen or urdf.joints[name].kind not in MOVING:
            found = "a circle" if name in seen else f"{name!r}{did_you_mean(name, urdf.movable)}"
            raise BadInput(f"{WHERE}: joint {joint.name!r}: expected to mimic a joint that moves, found {found}")
        seen.append(name)
        joint = urdf.joints[name]
    return joint, multiplier, offset


def _refuse_wrong(fixed: Mapping[str, float], urdf: Urdf, variables: Sequence[str]) -> None:
    welded = [name for name in urdf.movable if name not in variables]
    for name, value in fixed.items():
        joint = urdf.joints.get(name)
        if joint is not None and joint.kind in MOVING and joint.mimic is not None:
            _refuse_other(name, value, fixed, urdf, variables)
            continue
        if joint is None or name not in welded:
            why = "; it moves here" if name in variables else did_you_mean(name, welded)
            known = ", ".join(welded[:8]) or "none here"
            raise BadInput(f"robot.fixed: expected joints that do not move ({known}), found {name!r}{why}")
        if joint.limits is None or joint.kind == "continuous":
            continue
        low, high = joint.limits
        if low < high and not low - _ROUNDING <= value <= high + _ROUNDING:
            raise BadInput(f"robot.fixed.{name}: expected a value from {low:g} to {high:g}, found {value:g}")


def _refuse_other(name: str, value: float, fixed: Mapping[str, float], urdf: Urdf, variables: Sequence[str]) -> None:
    """Refuse a value for a joint that follows another, unless it is the one that it has anyway."""
    followed, multiplier, offset = _followed(urdf.joints[name], urdf)
    own = _value_of(followed, fixed) * multiplier + offset
    if followed.name in variables or abs(value - own) > _ROUNDING:
        raise BadInput(
            f"robot.fixed.{name}: expected no value, as this joint follows {followed.name!r}, found {value:g}; "
            "leave it out"
        )


# Placements -----------------------------------------------------------------------------------------------------------
def _motions(kind: int, axis: Floats, values: Floats) -> Floats:
    """Return the motion of a joint by each value, as placements (N, 12)."""
    motions = np.zeros((len(values), 3, 4))
    if kind == PRISMATIC:
        motions[:, :, :3] = np.eye(3)
        motions[:, :, 3] = values[:, None] * axis
        return motions.reshape(-1, 12)
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    outer = axis[:, None] * axis
    cosine, sine = np.cos(values)[:, None, None], np.sin(values)[:, None, None]
    motions[:, :, :3] = cosine * np.eye(3) + sine * skew + (1.0 - cosine) * outer
    return motions.reshape(-1, 12)


def _chained(one: Floats, other: Floats) -> Floats:
    """Return `chained` of many placements, (N, 12) each, or (1, 12) for all."""
    first, second = one.reshape(-1, 3, 4), other.reshape(-1, 3, 4)
    first = np.broadcast_to(first, (max(len(first), len(second)), 3, 4))
    second = np.broadcast_to(second, first.shape)
    turn = np.einsum("nij,njk->nik", first[:, :, :3], second[:, :, :3])
    place = np.einsum("nij,nj->ni", first[:, :, :3], second[:, :, 3]) + first[:, :, 3]
    return np.concatenate([turn, place[:, :, None]], axis=2).reshape(-1, 12)
