"""The verification of min-time solutions. It shares no code with `evaluate`.

The curve, the law of motion along it and the dynamics are worked out a second time in other ways: the spline by a basis
matrix, the times by numeric integration, the torques by pinocchio. Where pinocchio is not installed, rods in a plane
are verified by Kane's equations in complex numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from problems.errors import BadInput, first_line
from problems.min_time.arm import LIMITS
from problems.problem import Solution, Verdict
from problems.tables import Table

if TYPE_CHECKING:
    from problems.min_time.arm import Arm
    from problems.min_time.model import MinTimeModel

Floats = NDArray[np.float64]

TOLERANCE = 0.01
"""The share of its limit by which a torque, velocity, acceleration or jerk may exceed it."""

_SAMPLES = 8  # parts of the stretch between two rows, at whose ends the limits are looked at
_ROUNDING = 1e-6
# Gauss-Legendre nodes; 200 are too few where a step almost comes to rest between its ends.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(1000)
_BASIS = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0


class Rows(Table):
    """The trajectory of a solution, row by row; ``place`` is there if jerk is limited."""

    t: list[Annotated[float, Field(ge=0)]] = Field(min_length=1)
    q: list[list[float]]
    qd: list[list[float]]
    qdd: list[list[float]]
    torque: list[list[float]]
    place: list[float] | None = None


class Trip(Table):
    """A solution of min-time, as `MinTime.decode` writes it."""

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
    place: Floats | None  # (rows,): s along the curve, 1 a stretch; None if rows are equally spaced along the curve


class Law(NamedTuple):
    """The motion along a curve, as it follows from the accelerations that the rows claim."""

    times: Floats  # (rows,), s
    states: Floats  # (3, rows): place along the curve, and its first two derivatives by time
    between: Floats  # (4, samples): the same at the rows and between them, and the third derivative, inf if it jumps


def verify(problem: MinTimeModel, solution: Solution) -> Verdict:
    """Return the time that the trajectory takes, and all that is wrong with it."""
    claim = _parsed(problem, solution)
    if len(claim.t) == 1:
        return _verify_standing(problem, claim)
    # A nonsensical claim may divide by zero or overflow; the comparisons below then fail, as they should.
    with np.errstate(all="ignore"):
        law = _law(claim)
        wrong = list(_wrong_rows(problem.arm, claim, law))
        # Between rows the law is followed, which means something only if the rows agree with it.
        between = _wrong_between(problem, claim, law) if not wrong else ()
        objections = [*_wrong_ends(problem, claim), *wrong, *between]
    time = float(law.times[-1])
    return Verdict(time if np.isfinite(time) else np.inf, tuple(objections))


def greatest_shares(problem: MinTimeModel, solution: Solution) -> dict[str, Floats]:
    """Return for each limited quantity the greatest share of its limit, shape (joints,), at and between the rows."""
    claim = _parsed(problem, solution)
    shares = _shares(problem, _motion(problem, claim, _law(claim)))
    return {name: values.max(axis=0) for name, values in shares.items()}


def torques(arm: Arm, q: Floats, qd: Floats, qdd: Floats) -> Floats:
    """Return the torques of joint angles, speeds and accelerations, N·m: (n, joints) each to (n, joints).

    Raises:
        BadInput: If the arm needs pinocchio, which is not installed.
    """
    try:
        import pinocchio
    except ImportError as error:
        if arm.is_planar:
            return kane(arm, q, qd, qdd)
        raise BadInput("solution: check needs pinocchio for this arm: pip install 'supernode[dynamics]'") from error
    model = pinocchio_model(pinocchio, arm)
    data = model.createData()
    return np.array([pinocchio.rnea(model, data, *row) for row in zip(q, qd, qdd, strict=True)])


def pinocchio_model(pinocchio: Any, arm: Arm) -> Any:
    """Return the arm as a pinocchio model."""
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
    """Return the torques of rods in a plane by Kane's equations, N·m: (n, joints) each to (n, joints).

    The torque of a joint is the sum, over all bodies beyond it, of the body's inertial force times the velocity of its
    centre for a unit speed of that joint. Points of the plane are complex numbers; a factor 1j is a right angle.
    """
    along = np.exp(1j * np.cumsum(q, axis=1))
    swing = 1j * np.cumsum(qdd, axis=1) - np.cumsum(qd, axis=1) ** 2
    lengths = np.array(arm.lengths)
    ends = np.cumsum(lengths * along, axis=1)
    # Accelerations of the rods' ends, summed from the base outwards.
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


def _parsed(problem: MinTimeModel, solution: Solution) -> Claim:
    try:
        trip = Trip.model_validate(solution, strict=True)
    except ValidationError as error:
        raise first_line(error, Trip, "solution") from None
    rows, joints = trip.trajectory, problem.arm.size
    for name, table, count in (
        ("nodes", trip.nodes, len(trip.nodes)),
        *((f"trajectory.{name}", getattr(rows, name), len(rows.t)) for name in ("q", "qd", "qdd", "torque")),
    ):
        if len(table) != count or any(len(row) != joints for row in table):
            raise BadInput(f"solution: {name}: expected {count} rows of {joints} numbers, found others")
    if rows.place is not None and len(rows.place) != len(rows.t):
        raise BadInput(f"solution: trajectory.place: expected {len(rows.t)} numbers, found {len(rows.place)}")
    place = None if rows.place is None else np.array(rows.place)
    q, qd, qdd, torque = (np.array(each) for each in (rows.q, rows.qd, rows.qdd, rows.torque))
    return Claim(trip.time, np.array(trip.nodes), np.array(rows.t), q, qd, qdd, torque, place)


def _verify_standing(problem: MinTimeModel, claim: Claim) -> Verdict:
    """Verify a trajectory of one row, which only an arm that starts at its goal may have."""
    torque = torques(problem.arm, claim.q, claim.qd, claim.qdd)
    ends = np.array([problem.start, problem.goal])
    stands = not np.any(claim.qd) and not np.any(claim.qdd) and claim.t[0] == claim.time == 0.0
    if stands and _near(claim.nodes, ends) and _near(claim.q, ends) and _near(claim.torque, torque):
        return Verdict(0.0)
    return Verdict(np.inf, ("it does not lead from start to goal",))


def _near(one: Floats, other: Floats, scale: float = 1.0) -> bool:
    return bool(one.shape == other.shape or len(one) == 1) and bool(np.all(np.abs(one - other) <= _ROUNDING * scale))


def _curve(nodes: Floats, places: NDArray[np.floating[Any]]) -> Floats:
    """Return the uniform cubic B-spline and its first three derivatives at some places, shape (4, places, joints)."""
    # Phantom ends, as docs/min-time.md defines the curve.
    points = np.concatenate([[2 * nodes[0] - nodes[1]], nodes, [2 * nodes[-1] - nodes[-2]]])
    # A nonsensical claim may have any places; it is refused later, but must not fail here.
    places = np.clip(np.nan_to_num(places), 0.0, len(nodes) - 1.0)
    stretch = np.minimum(places.astype(np.int64), len(nodes) - 2)
    part = (places - stretch)[:, None]
    curve = np.empty((4, len(places), nodes.shape[1]))
    around = points[stretch[:, None] + np.arange(4)]
    for order, powers in enumerate(
        (
            np.hstack([part**0, part, part**2, part**3]),
            np.hstack([0 * part, part**0, 2 * part, 3 * part**2]),
            np.hstack([0 * part, 0 * part, 2 * part**0, 6 * part]),
            np.hstack([0 * part, 0 * part, 0 * part, 6 * part**0]),
        )
    ):
        weights = powers @ _BASIS
        curve[order] = np.einsum("pc,pcj->pj", weights, around)
    return curve


# How the curve is gone along ------------------------------------------------------------------------------------------
def _law(claim: Claim) -> Law:
    return _by_steps(claim) if claim.place is None else _by_moments(claim, claim.place)


def _along(claim: Claim, curve: Floats) -> tuple[Floats, Floats]:
    """Return the first two derivatives of the place by time, (rows,) each, from the rows' speeds and accelerations.

    The claimed vectors are projected onto the curve's tangent. What they have besides is found by `_wrong_rows`.
    """
    _, slope, bend, _ = curve
    steepness = np.sum(slope**2, axis=1)
    speeds = np.sum(claim.qd * slope, axis=1) / steepness
    return speeds, np.sum((claim.qdd - bend * speeds[:, None] ** 2) * slope, axis=1) / steepness


def _by_steps(claim: Claim) -> Law:
    """Return the law of rows equally spaced along the curve, without a limit of jerk.

    Between rows the squared speed is a parabola in s, given by three Bézier points. Accelerations of a row are those at
    the beginning of the step that begins there; of the last row, those at the end of the last step.
    """
    count = len(claim.t) - 1
    length = (len(claim.nodes) - 1) / count
    places = np.arange(count + 1) * length
    speeds, pushes = _along(claim, _curve(claim.nodes, places))
    # The middle Bézier point follows from the claimed acceleration at the step's beginning. If that is wrong, so are
    # the times, which are compared.
    steps = np.array([speeds[:-1] ** 2, speeds[:-1] ** 2 + length * pushes[:-1], speeds[1:] ** 2])
    ends = np.append(pushes[:-1], (steps[2, -1] - steps[1, -1]) / length)
    shares = np.arange(_SAMPLES + 1) / _SAMPLES
    begin, end = (steps[1:] - steps[:-1])[:, :, None] / length
    between = np.array(
        [
            places[:-1, None] + shares * length,
            np.sqrt(_squared(steps, shares)),
            begin * (1 - shares) + end * shares,
            np.full((count, len(shares)), np.inf),
        ]
    )
    times = np.append(0.0, np.cumsum(_times(steps, length)))
    return Law(times, np.array([places, np.abs(speeds), ends]), between.reshape(4, -1))


def _times(steps: Floats, length: float) -> Floats:
    """Return the time of each step, s: the integral of 1 / speed.

    Where the speed is 0 at an end of a step, the integrand is unbounded there. The substitution share = sin²(angle)
    makes it smooth, so that Gaussian quadrature converges.
    """
    angles, weights = (_NODES + 1) * np.pi / 4, _WEIGHTS * np.pi / 4
    speed = np.sqrt(_squared(steps, np.sin(angles) ** 2))
    times: Floats = (2 * length * np.sin(angles) * np.cos(angles) / speed) @ weights
    return times


def _squared(steps: Floats, shares: Floats) -> Floats:
    """Return the squared speeds at shares of each step: (3, steps) and (shares,) to (steps, shares)."""
    first, middle, last = steps[:, :, None]
    squared: Floats = first * (1 - shares) ** 2 + 2 * middle * shares * (1 - shares) + last * shares**2
    return squared


def _by_moments(claim: Claim, claimed: Floats) -> Law:
    """Return the law of rows that state their places, with a limit of jerk.

    Between rows the second derivative of the place is linear in time. It is integrated from rest at the start; the
    claimed places serve only to find it, and are compared with the result.
    """
    _, pushes = _along(claim, _curve(claim.nodes, claimed))
    seconds = np.diff(claim.t)
    # The trapezoidal rule is exact, since the second derivative is linear in time.
    speeds = np.append(0.0, np.cumsum((pushes[:-1] + pushes[1:]) / 2 * seconds))
    gained = speeds[:-1] * seconds + (2 * pushes[:-1] + pushes[1:]) * seconds**2 / 6
    places = np.append(0.0, np.cumsum(gained))
    shares = np.arange(_SAMPLES + 1) / _SAMPLES
    time, surge = seconds[:, None] * shares, (np.diff(pushes) / seconds)[:, None]
    first, speed, push = places[:-1, None], speeds[:-1, None], pushes[:-1, None]
    between = np.array(
        [
            first + time * (speed + time * (push / 2 + time * surge / 6)),
            speed + time * (push + time * surge / 2),
            push + time * surge,
            np.broadcast_to(surge, time.shape),
        ]
    )
    if max(abs(pushes[0]), abs(pushes[-1])) > _ROUNDING * np.abs(pushes).max():
        between[3] = np.inf  # the acceleration jumps from or to rest, which no jerk allows
    # Times are part of the claim here. Ones that do not increase from 0 become NaN, which no comparison accepts.
    times = claim.t if claim.t[0] == 0.0 and np.all(seconds > 0.0) else np.full(len(claim.t), np.nan)
    return Law(times, np.array([places, speeds, pushes]), between.reshape(4, -1))


# What may be wrong ----------------------------------------------------------------------------------------------------
def _wrong_ends(problem: MinTimeModel, claim: Claim) -> Iterator[str]:
    for name, angles, row in (("start", problem.start, 0), ("goal", problem.goal, -1)):
        if not (_near(claim.nodes[row], np.array(angles)) and _near(claim.q[row], np.array(angles))):
            yield f"it does not begin and end at start and goal: {claim.q[row].tolist()} is not the {name}"
        if np.any(np.abs(claim.qd[row]) > _ROUNDING):
            yield f"the arm is not at rest at the {name}"


def _wrong_rows(arm: Arm, claim: Claim, law: Law) -> Iterator[str]:
    """Yield what of the rows differs from what follows from the nodes and the speed along the curve."""
    places, speeds, pushes = law.states
    angles, slope, bend, _ = _curve(claim.nodes, places)
    turning = slope * speeds[:, None]
    due = slope * pushes[:, None] + bend * speeds[:, None] ** 2
    expected = {
        # Each: what is claimed, what is expected, and the scale of the allowed error.
        "place": (places if claim.place is None else claim.place, places, 1.0),
        "q": (claim.q, angles, 1.0),
        "qd": (claim.qd, turning, 1.0 + np.abs(turning).max()),
        "qdd": (claim.qdd, due, 1.0 + np.abs(due).max()),
        "torque": (claim.torque, torques(arm, claim.q, claim.qd, claim.qdd), 1.0 + arm.limit_of("torque").max()),
        "t": (claim.t, law.times, 1.0),
        "time": (np.array([claim.time]), law.times[-1:], 1.0),
    }
    for name, (found, right, allowed) in expected.items():
        if not _near(found, right, allowed):
            yield f"{name} is not what follows from the nodes and the speed along the curve"


def _wrong_between(problem: MinTimeModel, claim: Claim, law: Law) -> Iterator[str]:
    """Yield the limits that are exceeded at or between the rows, and whether the curve leaves the box or a range."""
    arm, motion = problem.arm, _motion(problem, claim, law)
    for name, shares in _shares(problem, motion).items():
        worst = shares.max(axis=0)
        joint = int(np.argmax(worst))
        if not worst[joint] <= 1.0 + TOLERANCE:
            limit = f"{arm.limit_of(name)[joint]:g} {LIMITS[name]}"
            found = (
                f"{worst[joint]:.4f} of its limit" if np.isfinite(worst[joint]) else "without bound, beyond its limit"
            )
            yield f"{'an' if name[0] == 'a' else 'a'} {name} is {found}, {limit} of {arm.names[joint]}"
    q = motion[0]
    low, high = np.minimum(problem.start, problem.goal), np.maximum(problem.start, problem.goal)
    if not np.all((q >= low - _ROUNDING) & (q <= high + _ROUNDING)):
        yield "the curve leaves the box between start and goal"
    for joint, body in enumerate(arm.chain):
        lowest, highest = body.limits or (-np.inf, np.inf)
        if not np.all((q[:, joint] >= lowest - _ROUNDING) & (q[:, joint] <= highest + _ROUNDING)):
            yield f"{body.name} leaves its range, {lowest:g} to {highest:g} rad"


def _motion(problem: MinTimeModel, claim: Claim, law: Law) -> Floats:
    """Return angles and their first three derivatives by time, at the rows and between: shape (4, samples, joints)."""
    places, speed, push, surge = (values[:, None] for values in law.between)
    q, slope, bend, third = _curve(claim.nodes, places[:, 0])
    jerk = third * speed**3 + 3 * bend * speed * push + slope * np.where(np.isinf(surge), 0.0, surge)
    jerk[np.isinf(surge[:, 0])] = np.inf
    return np.array([q, slope * speed, slope * push + bend * speed**2, jerk])


def _shares(problem: MinTimeModel, motion: Floats) -> dict[str, Floats]:
    """Return for each limited quantity its shares of the limits, shape (samples, joints)."""
    q, qd, qdd, jerk = motion
    found = {"velocity": qd, "acceleration": qdd, "jerk": jerk, "torque": torques(problem.arm, q, qd, qdd)}
    return {
        name: np.abs(values) / problem.arm.limit_of(name)
        for name, values in found.items()
        if getattr(problem.arm, name) is not None
    }
