"""The judge of min-time solutions: its own curve, and pinocchio's dynamics; nothing that `evaluate` uses.

Where pinocchio is not installed, rods in a plane are judged by Kane's equations in complex numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from problems.errors import BadInput, first_line
from problems.problem import Solution, Table, Verdict

if TYPE_CHECKING:
    from problems.min_time.arm import Arm
    from problems.min_time.problem import MinTime

Floats = NDArray[np.float64]

TOLERANCE = 0.01
"""By how much of its limit a torque may exceed it between two rows of a trajectory."""

_SAMPLES = 8  # between two rows
_ROUNDING = 1e-6
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)
_BASIS = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0


class Rows(Table):
    """A trajectory."""

    t: list[Annotated[float, Field(ge=0)]] = Field(min_length=1)
    q: list[list[float]]
    qd: list[list[float]]
    qdd: list[list[float]]
    torque: list[list[float]]


class Trip(Table):
    """What a solution of min-time is made of."""

    time: Annotated[float, Field(ge=0)]
    nodes: list[list[float]] = Field(min_length=2)
    trajectory: Rows


class Claim(NamedTuple):
    """A solution as arrays."""

    time: float
    nodes: Floats  # (nodes, joints)
    t: Floats  # (rows,)
    q: Floats  # (rows, joints), as the following
    qd: Floats
    qdd: Floats
    torque: Floats


def judge(problem: MinTime, solution: Solution) -> Verdict:
    """The time that the trajectory takes, and all that is wrong with it."""
    claim = _parsed(problem, solution)
    if len(claim.t) == 1:
        return _judge_standing(problem, claim)
    stretches, count = len(claim.nodes) - 1, len(claim.t) - 1
    length = stretches / count
    with np.errstate(all="ignore"):  # what becomes of nonsense is compared, and found wrong
        curve = _curve(claim.nodes, np.arange(count + 1) * length)
        steps = _steps(claim, curve, length)
        times = _times(steps, length)
        wrong = list(_wrong_rows(problem.arm, claim, curve, steps, times, length))
        between = _wrong_between(problem, claim, steps, length) if not wrong else ()
        objections = [*_wrong_ends(problem, claim), *wrong, *between]
    time = float(times.sum())
    return Verdict(time if np.isfinite(time) else np.inf, tuple(objections))


def worst_torque(problem: MinTime, solution: Solution) -> float:
    """The greatest torque of a trajectory as a share of its limit, at its rows and between them."""
    claim = _parsed(problem, solution)
    length = (len(claim.nodes) - 1) / (len(claim.t) - 1)
    steps = _steps(claim, _curve(claim.nodes, np.arange(len(claim.t)) * length), length)
    return float(_between(problem, claim, steps, length)[1].max())


def torques(arm: Arm, q: Floats, qd: Floats, qdd: Floats) -> Floats:
    """The torques of joint angles, speeds and accelerations, N·m: (n, joints) each to (n, joints).

    Raises:
        BadInput: if that takes pinocchio, and it is not installed.
    """
    try:
        import pinocchio
    except ImportError as error:
        if arm.is_planar:
            return kane(arm, q, qd, qdd)
        raise BadInput("solution: pinocchio is not installed: pip install 'supernode[dynamics]'") from error
    model = pinocchio_model(pinocchio, arm)
    data = model.createData()
    return np.array([pinocchio.rnea(model, data, *row) for row in zip(q, qd, qdd, strict=True)])


def pinocchio_model(pinocchio: Any, arm: Arm) -> Any:
    """The arm as pinocchio knows it."""
    model = pinocchio.Model()
    model.gravity.linear = arm.falling
    joint = 0
    for body in arm.chain:
        frame = pinocchio.SE3(np.array(body.rotation), np.array(body.place))
        turning = pinocchio.JointModelRevoluteUnaligned(*body.axis)
        joint = model.addJoint(joint, turning, frame, body.name)
        inertia = pinocchio.Inertia(body.mass, np.array(body.centre), np.array(body.inertia))
        model.appendBodyToJoint(joint, inertia, pinocchio.SE3.Identity())
    return model


def kane(arm: Arm, q: Floats, qd: Floats, qdd: Floats) -> Floats:
    """Kane's equations of rods in a plane: each body's inertial force times what a joint's turn moves it by."""
    along = np.exp(1j * np.cumsum(q, axis=1))
    swing = 1j * np.cumsum(qdd, axis=1) - np.cumsum(qd, axis=1) ** 2
    lengths = np.array(arm.lengths)
    ends = np.cumsum(lengths * along, axis=1)
    rising = np.cumsum(lengths * along * swing, axis=1)
    joints = np.concatenate([np.zeros((len(q), 1)), ends[:, :-1]], axis=1)
    before = np.concatenate([np.zeros((len(q), 1)), rising[:, :-1]], axis=1)
    torque = np.zeros(q.shape)
    for link, body in enumerate(arm.chain):
        centre = joints[:, link] + body.centre[0] * along[:, link]
        inertial = body.mass * (before[:, link] + body.centre[0] * (along * swing)[:, link] - 1j * arm.falling[1])
        turned = 1j * (centre[:, None] - joints[:, : link + 1])
        torque[:, : link + 1] += (inertial[:, None] * turned.conj()).real
        torque[:, : link + 1] += body.inertia[2][2] * np.cumsum(qdd, axis=1)[:, link, None]
    return torque


def _parsed(problem: MinTime, solution: Solution) -> Claim:
    try:
        trip = Trip.model_validate(solution, strict=True)
    except ValidationError as error:
        raise first_line(error, Trip, "solution") from error
    rows, joints = trip.trajectory, problem.arm.size
    for name, table, count in (
        ("nodes", trip.nodes, len(trip.nodes)),
        *((f"trajectory.{name}", getattr(rows, name), len(rows.t)) for name in ("q", "qd", "qdd", "torque")),
    ):
        if len(table) != count or any(len(row) != joints for row in table):
            raise BadInput(f"solution: {name}: expected {count} rows of {joints} numbers, found others")
    arrays = [np.array(table) for table in (trip.nodes, rows.t, rows.q, rows.qd, rows.qdd, rows.torque)]
    return Claim(trip.time, *arrays)


def _judge_standing(problem: MinTime, claim: Claim) -> Verdict:
    """A trajectory of one row: of an arm that is at its goal."""
    torque = torques(problem.arm, claim.q, claim.qd, claim.qdd)
    ends = np.array([problem.start, problem.goal])
    stands = not np.any(claim.qd) and not np.any(claim.qdd) and claim.t[0] == claim.time == 0.0
    if stands and _near(claim.nodes, ends) and _near(claim.q, ends) and _near(claim.torque, torque):
        return Verdict(0.0)
    return Verdict(np.inf, ("it does not lead from start to goal",))


def _near(one: Floats, other: Floats, scale: float = 1.0) -> bool:
    return bool(one.shape == other.shape or len(one) == 1) and bool(np.all(np.abs(one - other) <= _ROUNDING * scale))


def _curve(nodes: Floats, places: NDArray[np.floating[Any]]) -> Floats:
    """The uniform cubic B-spline and its first two derivatives at some places: shape (3, places, joints)."""
    points = np.concatenate([[2 * nodes[0] - nodes[1]], nodes, [2 * nodes[-1] - nodes[-2]]])
    stretch = np.minimum(places.astype(np.int64), len(nodes) - 2)
    part = (places - stretch)[:, None]
    curve = np.empty((3, len(places), nodes.shape[1]))
    around = points[stretch[:, None] + np.arange(4)]
    for order, powers in enumerate(
        (
            np.hstack([part**0, part, part**2, part**3]),
            np.hstack([0 * part, part**0, 2 * part, 3 * part**2]),
            np.hstack([0 * part, 0 * part, 2 * part**0, 6 * part]),
        )
    ):
        weights = powers @ _BASIS
        curve[order] = np.einsum("pc,pcj->pj", weights, around)
    return curve


def _steps(claim: Claim, curve: Floats, length: float) -> Floats:
    """The squared speed along the curve on each step, a parabola by its three Bézier points: shape (3, steps).

    It follows from the rows' speeds and accelerations.
    """
    _, slope, bend = curve
    steepness = np.sum(slope**2, axis=1)
    squared = np.sum(claim.qd * slope, axis=1) ** 2 / steepness**2
    push = np.sum((claim.qdd - bend * squared[:, None]) * slope, axis=1) / steepness
    return np.array([squared[:-1], squared[:-1] + length * push[:-1], squared[1:]])


def _times(steps: Floats, length: float) -> Floats:
    """What each step takes, s: the integral of 1 / speed, in an angle that makes it smooth where the speed is 0."""
    angles, weights = (_NODES + 1) * np.pi / 4, _WEIGHTS * np.pi / 4
    speed = np.sqrt(_squared(steps, np.sin(angles) ** 2))
    times: Floats = (2 * length * np.sin(angles) * np.cos(angles) / speed) @ weights
    return times


def _squared(steps: Floats, shares: Floats) -> Floats:
    """The squared speeds at shares of each step: (3, steps) and (shares,) to (steps, shares)."""
    first, middle, last = steps[:, :, None]
    squared: Floats = first * (1 - shares) ** 2 + 2 * middle * shares * (1 - shares) + last * shares**2
    return squared


def _wrong_ends(problem: MinTime, claim: Claim) -> Iterator[str]:
    for name, angles, row in (("start", problem.start, 0), ("goal", problem.goal, -1)):
        if not (_near(claim.nodes[row], np.array(angles)) and _near(claim.q[row], np.array(angles))):
            yield f"it does not begin and end at start and goal: {claim.q[row].tolist()} is not the {name}"
        if np.any(np.abs(claim.qd[row]) > _ROUNDING):
            yield f"the arm is not at rest at the {name}"


def _wrong_rows(arm: Arm, claim: Claim, curve: Floats, steps: Floats, times: Floats, length: float) -> Iterator[str]:
    """Rows that are not what follows from the nodes and the speed along the curve."""
    squared = np.append(steps[0], steps[2, -1])[:, None]
    push = np.append(steps[1] - steps[0], steps[2, -1] - steps[1, -1])[:, None] / length
    speeds, due = np.sqrt(squared) * curve[1], push * curve[1] + squared * curve[2]
    scale = 1.0 + np.abs(due).max()
    expected = {
        "q": (claim.q, curve[0], 1.0),
        "qd": (claim.qd, speeds, 1.0 + np.abs(speeds).max()),
        "qdd": (claim.qdd, due, scale),
        "torque": (claim.torque, torques(arm, claim.q, claim.qd, claim.qdd), 1.0 + arm.limits.max()),
        "t": (claim.t[:, None], np.append(0.0, np.cumsum(times))[:, None], 1.0),
        "time": (np.array([claim.time]), times.sum(keepdims=True), 1.0),
    }
    for name, (found, right, allowed) in expected.items():
        if not _near(found, right, allowed):
            yield f"{name} is not what follows from the nodes and the speed along the curve"


def _wrong_between(problem: MinTime, claim: Claim, steps: Floats, length: float) -> Iterator[str]:
    """Torques beyond their limits, and a curve that leaves the box, looked for between the rows too."""
    q, shares = _between(problem, claim, steps, length)
    worst = shares.max()
    if not worst <= 1.0 + TOLERANCE:
        yield f"a torque is {worst:.4f} of its limit"
    low, high = np.minimum(problem.start, problem.goal), np.maximum(problem.start, problem.goal)
    if not np.all((q >= low - _ROUNDING) & (q <= high + _ROUNDING)):
        yield "the curve leaves the box between start and goal"


def _between(problem: MinTime, claim: Claim, steps: Floats, length: float) -> tuple[Floats, Floats]:
    """Angles and torques, these as shares of their limits, at the rows and between: shape (samples, joints) each."""
    shares = np.arange(_SAMPLES + 1) / _SAMPLES
    places = ((np.arange(steps.shape[1])[:, None] + shares) * length).ravel()
    q, slope, bend = _curve(claim.nodes, np.minimum(places, len(claim.nodes) - 1))
    squared = _squared(steps, shares).reshape(-1, 1)
    begin, end = (steps[1:] - steps[:-1])[:, :, None] / length
    push = (begin * (1 - shares) + end * shares).reshape(-1, 1)
    torque = torques(problem.arm, q, slope * np.sqrt(squared), slope * push + bend * squared)
    return q, np.abs(torque) / problem.arm.limits
