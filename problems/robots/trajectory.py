"""The field ``trajectory`` of a robot's solution, and its check: what a controller makes of the rows keeps all limits.

Between two rows the motion is the cubic that has their positions and velocities, as ROS's joint trajectory controller
makes it. Its acceleration is linear in time, so it is greatest at a row. Nothing here is used by what retimes paths,
but for the torques, which both have from pinocchio.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from problems.errors import BadInput
from problems.robots.dynamics import Dynamics
from problems.robots.fields import Robot
from problems.robots.limits import Limits, own_limits
from problems.robots.meshes import mesh_of
from problems.robots.urdf import Geometry, read_urdf
from problems.tables import Table

Floats = NDArray[np.float64]
Path = list[list[float]]

TOLERANCE = 1e-6  # of positions and velocities at the ends
OVER = 0.01  # share of a limit by which a motion may exceed it
ROOM = 2e-5  # m, the most that a point of the robot moves between the cubic and the chords that are proven
_WRONG = 0.02  # share of the greatest acceleration by which a stated one may differ from that of the cubics
_TORQUE = 1e-3  # share of a limit, or of the greatest torque, by which a stated torque may be wrong
_MOST_ROWS = 200_000
_MOST_HALVINGS = 12

Rows = Annotated[list[list[float]], Field(min_length=1, max_length=_MOST_ROWS)]


class Trajectory(Table):
    """A motion over time: rows of the joints in the order of configurations."""

    t: Annotated[list[float], Field(min_length=1, max_length=_MOST_ROWS)]
    q: Rows
    qd: Rows
    qdd: Rows
    torque: Rows | None = None


def objections_to(
    trajectory: Trajectory,
    path: Sequence[Sequence[float]],
    robot: Robot,
    joints: Sequence[str],
    proven: Callable[[Path, float], Sequence[str]],
) -> tuple[str, ...]:
    """Return why a trajectory is not acceptable.

    Args:
        trajectory: the rows.
        path: the path that it must follow from end to end, though it may round corners.
        robot: the robot, loaded.
        joints: the names of the variables.
        proven: why straight segments do not keep so many m more than the clearance from everything; empty if they do.

    Raises:
        BadInput: if the rows have the wrong shape, or pinocchio is missing.
    """
    times = np.array(trajectory.t)
    known = {name: getattr(trajectory, name) for name in ("q", "qd", "qdd", "torque")}
    rows = {name: _array(name, each, len(times), len(joints)) for name, each in known.items() if each is not None}
    if times[0] != 0.0 or np.any(np.diff(times) <= 0.0):
        return ("the trajectory's times do not increase from 0",)
    found = [*_wrong_ends(rows, np.array(path))]
    if len(times) > 1:
        limits = own_limits(robot, joints)
        found += [*_over(times, rows, limits, read_limits(robot, joints)), *_wrong_torques(times, rows, robot, limits)]
        room = ROOM / reach_of(robot, len(joints))
        found += [f"the trajectory: {each}" for each in proven(chords(times, rows["q"], rows["qd"], room), ROOM)]
    return tuple(found)


def _array(name: str, rows: Path, count: int, joints: int) -> Floats:
    if len(rows) != count or any(len(row) != joints for row in rows):
        raise BadInput(f"solution: trajectory.{name}: expected {count} rows of {joints} values, found others")
    return np.array(rows)


def read_limits(robot: Robot, joints: Sequence[str]) -> Floats:
    """Return the URDF's lowest and highest value of each joint, shape (n, 2); infinite for continuous joints."""
    found = (read_urdf(robot.urdf).joints[name] for name in joints)
    return np.array([(-np.inf, np.inf) if each.limits is None else each.limits for each in found])


def _wrong_ends(rows: dict[str, Floats], path: Floats) -> Iterator[str]:
    for name, row in (("starts", 0), ("ends", -1)):
        away = float(np.abs(rows["q"][row] - path[row]).max())
        if away > TOLERANCE:
            yield f"the trajectory {name} {away:.3g} from where the path does"
        if np.abs(rows["qd"][row]).max() > TOLERANCE:
            yield f"the trajectory {name} with a velocity of {np.abs(rows['qd'][row]).max():.3g}, not at rest"


def _over(times: Floats, rows: dict[str, Floats], limits: Limits, ranges: Floats) -> Iterator[str]:
    """Yield objections to positions, velocities and accelerations, and to rows that contradict each other."""
    _, fastest, begins, ends = _between(times, rows["q"], rows["qd"])
    outside = np.maximum(ranges[:, 0] - rows["q"], rows["q"] - ranges[:, 1])
    if (most := float(outside.max())) > TOLERANCE:
        yield f"the trajectory leaves a joint's range by {most:.3g}"
    for name, values, limit in (
        ("velocity", np.concatenate([rows["qd"], fastest]), limits.velocity),
        ("acceleration", np.concatenate([begins, ends, rows["qdd"]]), limits.acceleration),
    ):
        share = np.abs(values).max(axis=0) / limit
        joint = int(np.argmax(share))
        if share[joint] > 1.0 + OVER:
            yield f"the trajectory's {name} of {limits.joints[joint]} is {share[joint]:.4g} times its limit"
    # Where accelerations jump, a row holds the one that begins; the last row the one that ends.
    wrong = np.abs(np.concatenate([begins, ends[-1:]]) - rows["qdd"])
    if (most := float(wrong.max())) > _WRONG * max(1.0, float(np.abs(rows["qdd"]).max())):
        yield f"the trajectory's qdd differs by {most:.3g} from that of its q and qd"


def _between(times: Floats, q: Floats, qd: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return of each cubic: its middle, its velocity where that is greatest, its first and its last acceleration."""
    step = np.diff(times)[:, None]
    slope = np.diff(q, axis=0) / step
    first, last = qd[:-1], qd[1:]
    begins = (6.0 * slope - 4.0 * first - 2.0 * last) / step
    ends = (2.0 * first + 4.0 * last - 6.0 * slope) / step
    bend = ends - begins
    turning = np.clip(np.where(bend != 0.0, -begins / np.where(bend != 0.0, bend, 1.0), 0.0), 0.0, 1.0) * step
    fastest = first + begins * turning + bend / step * turning**2 / 2.0
    middles = (q[:-1] + q[1:]) / 2.0 + step * (first - last) / 8.0
    return middles, fastest, begins, ends


def _wrong_torques(times: Floats, rows: dict[str, Floats], robot: Robot, limits: Limits) -> Iterator[str]:
    """Yield objections to torques at both ends and in the middle of every cubic, and to those that the rows state."""
    dynamics = Dynamics.of(robot, limits.joints)
    if dynamics is None:
        if "torque" in rows:
            yield "the trajectory states torques of a robot without masses"
        return
    middles, _, begins, ends = _between(times, rows["q"], rows["qd"])
    step = np.diff(times)[:, None]
    speeds = 1.5 * np.diff(rows["q"], axis=0) / step - (rows["qd"][:-1] + rows["qd"][1:]) / 4.0
    sides = (
        dynamics.along(rows["q"][:-1], rows["qd"][:-1], begins),
        dynamics.along(rows["q"][1:], rows["qd"][1:], ends),
        dynamics.along(middles, speeds, (begins + ends) / 2.0),
    )
    share = np.abs(np.concatenate(sides)).max(axis=0) / limits.effort
    joint = int(np.argmax(share))
    if share[joint] > 1.0 + OVER:
        yield f"the trajectory's torque of {limits.joints[joint]} is {share[joint]:.4g} times its limit"
    if "torque" in rows:
        needed = dynamics.along(rows["q"], rows["qd"], rows["qdd"])
        wrong = float(np.abs(needed - rows["torque"]).max())
        if wrong > _TORQUE * max(1.0, float(np.abs(needed).max())):
            yield f"the trajectory states torques that are {wrong:.3g} N m from those that its motion needs"


def reach_of(robot: Robot, joints: int) -> float:
    """Return the most that a point of the robot moves if the joints move by 1 in all, rad or m, Euclidean; m.

    It is a coarse bound: as if all links were stretched out in line, with everything attached at the end.
    """
    urdf = read_urdf(robot.urdf)
    far = 1.0 + sum(_stretched(each.placement) for each in urdf.joints.values())  # 1 m for what may be attached
    far += sum(float(np.abs(each.limits or (0.0,)).max()) for each in urdf.joints.values() if each.kind == "prismatic")
    shapes = [each for link in urdf.links.values() for each in link.collisions]
    far += max((_stretched(each.placement) + _extent(robot, each) for each in shapes), default=0.0)
    return float(np.sqrt(joints)) * max(far, 1.0)


def _stretched(placement: Floats) -> float:
    return float(np.linalg.norm(placement.reshape(3, 4)[:, 3]))


def _extent(robot: Robot, shape: Geometry) -> float:
    """Return how far a point of a shape may be from the shape's origin, m."""
    if shape.shape == "mesh":
        vertices, _ = mesh_of(robot.meshes, shape.mesh, shape.scale)
        return float(np.linalg.norm(vertices, axis=1).max())
    return float(np.sum(shape.size))


def chords(times: Floats, q: Floats, qd: Floats, farthest: float) -> Path:
    """Return points on the cubics between rows; no chord between two is farther than ``farthest`` from its cubic.

    A cubic lies within the hull of its four control points, so it is halved until those are near the chord.
    """
    third = np.diff(times)[:, None] / 3.0
    curves = np.stack([q[:-1], q[:-1] + qd[:-1] * third, q[1:] - qd[1:] * third, q[1:]], axis=1)
    for _ in range(_MOST_HALVINGS):
        bent = _bends(curves) > farthest
        if not bent.any():
            break
        halves = np.repeat(curves, 1 + bent, axis=0)
        first = np.flatnonzero(bent) + np.arange(int(bent.sum()))  # where a first half is, its second follows
        halves[first], halves[first + 1] = _halved(curves[bent])
        curves = halves
    points: Path = np.concatenate([curves[:, 0], curves[-1:, 3]]).tolist()
    return points


def _bends(curves: Floats) -> Floats:
    """Return how far control points are from the chord of each cubic at most: shape (m, 4, n) to (m,)."""
    chord = curves[:, 3] - curves[:, 0]
    square = np.maximum((chord**2).sum(axis=1), 1e-300)
    inner = curves[:, 1:3] - curves[:, :1]
    share = np.clip((inner * chord[:, None]).sum(axis=2) / square[:, None], 0.0, 1.0)
    bends: Floats = np.linalg.norm(inner - share[:, :, None] * chord[:, None], axis=2).max(axis=1)
    return bends


def _halved(curves: Floats) -> tuple[Floats, Floats]:
    """Return the control points of both halves of each cubic (de Casteljau)."""
    a, b, c, d = curves.transpose(1, 0, 2)
    ab, bc, cd = (a + b) / 2.0, (b + c) / 2.0, (c + d) / 2.0
    abc, bcd = (ab + bc) / 2.0, (bc + cd) / 2.0
    middle = (abc + bcd) / 2.0
    return np.stack([a, ab, abc, middle], axis=1), np.stack([middle, bcd, cd, d], axis=1)
