"""Time-optimal motions along joint paths: TOPP-RA (Pham and Pham, IEEE T-RO 2018; PyPI ``toppra``) between stops.

Corners are rounded first, as far as the proof allows (`problems.robots.rounding`). The speed along the path is
then as high as the limits of velocity, acceleration and torque allow. The solver tests limits at the points of a grid;
a last step measures both ends and the middle of every interval, and slows the whole motion down until they hold.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput
from problems.motion import Pace
from problems.robots.dynamics import Dynamics
from problems.robots.limits import Limits
from problems.robots.rounding import Stretch, rounded

Floats = NDArray[np.float64]

BLEND = 0.1  # rad or m, the default of how far from a corner its curve may pass
EXCESS = 2e-5  # rad or m, between a curve and the chords that are proven in its place
_STEP = 0.04  # rad or m, of the grid on straight pieces
_ON_CURVES = 32  # intervals of the grid on a curve
_LEAST_INTERVALS = 16  # of the grid on a straight piece
_SLOWEST = 100.0  # times as slow as the solver's answer: beyond, gravity alone leaves no torque to spare
_SOON = 1e-10  # s
_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Timed:
    """A stretch of a path over time, with a constant acceleration s̈ of the parameter between two knots.

    Attributes:
        stretch: the path.
        places: s of the knots, increasing, shape (k,).
        speeds: ṡ of the knots, 1/s, shape (k,).
    """

    stretch: Stretch
    places: Floats
    speeds: Floats

    @property
    def pushes(self) -> Floats:
        """s̈ between two knots, 1/s², shape (k - 1,)."""
        pushes: Floats = np.diff(self.speeds**2) / (2.0 * np.diff(self.places))
        return pushes

    @property
    def knots(self) -> Floats:
        """The moments of the knots, s, the first 0, shape (k,)."""
        seconds = 2.0 * np.diff(self.places) / (self.speeds[1:] + self.speeds[:-1])
        return np.concatenate([[0.0], np.cumsum(seconds)])

    def at(self, times: Floats, late: bool = False) -> tuple[Floats, Floats, Floats]:
        """Return positions, velocities and accelerations at moments from 0 to the last knot: (m,) to (m, n) each.

        Args:
            times: s, increasing.
            late: which acceleration a knot has: that of the interval that ends there, or else the one that begins.
        """
        knots = self.knots
        # A moment that is a knot but for rounding is meant to be that knot.
        interval = np.searchsorted(knots, times + (-_SOON if late else _SOON)) - 1
        interval = np.clip(interval, 0, len(knots) - 2)
        gone, push = np.maximum(times - knots[interval], 0.0), self.pushes[interval]
        speed = self.speeds[interval] + push * gone
        place = self.places[interval] + self.speeds[interval] * gone + push * gone**2 / 2.0
        place = np.clip(place, 0.0, self.places[-1])
        slope, bend = self.stretch(place, 1), self.stretch(place, 2)
        return self.stretch(place), slope * speed[:, None], slope * push[:, None] + bend * (speed**2)[:, None]

    def slower(self, factor: float) -> Timed:
        """Return the same motion, taking ``factor`` times as long."""
        return Timed(self.stretch, self.places, self.speeds / factor)


@dataclass(frozen=True, eq=False)
class Rows:
    """A trajectory: rows over time, with a cubic between two of them; all but ``times`` of shape (rows, n).

    Attributes:
        times: s, increasing from 0, shape (rows,).
        positions: rad or m.
        velocities: per second.
        accelerations: per second²; where one changes, the one that begins.
        torques: N m or N, those of the accelerations; None if the robot's masses are unknown.
        stops: how often the robot stops at a corner on the way.
        curves: how many corners are rounded.
    """

    times: Floats
    positions: Floats
    velocities: Floats
    accelerations: Floats
    torques: Floats | None
    stops: int
    curves: int

    def plain(self) -> dict[str, Any]:
        """Return the field ``trajectory`` of a solution."""
        found = {"t": self.times, "q": self.positions, "qd": self.velocities, "qdd": self.accelerations}
        return {name: each.tolist() for name, each in found.items()} | (
            {} if self.torques is None else {"torque": self.torques.tolist()}
        )


def retime(
    path: Floats, limits: Limits, dynamics: Dynamics | None, pace: Pace, is_free: Callable[[Floats], bool]
) -> Rows:
    """Return a quick motion from rest to rest along a path, within all limits.

    Args:
        path: corners between straight pieces, which are free, shape (k, n).
        limits: what the joints can do.
        dynamics: the robot's masses; without them torques have no limits.
        pace: the sampling rate, and how far from a corner the motion may pass.
        is_free: whether a path of straight pieces is free, with some room for what is up to `EXCESS` off it.

    Raises:
        BadInput: if ``toppra`` is not installed, the robot cannot hold itself somewhere on the path, or there would be
            too many rows.
    """
    blend = BLEND if pace.blend is None else pace.blend
    stretches = rounded(path, blend, is_free, EXCESS)
    timed = [_timed(stretch, limits, dynamics) for stretch in stretches]
    if not timed:
        rest = np.zeros((1, path.shape[1]))
        return _rows(np.zeros(1), path[:1], rest, rest, dynamics, (0, 0))
    begins = np.concatenate([[0.0], np.cumsum([each.knots[-1] for each in timed])])
    times = pace.moments(np.concatenate([each.knots + begin for each, begin in zip(timed, begins, strict=False)]))
    # A moment at which one stretch ends belongs to the next; both are at rest there.
    numbers = np.clip(np.searchsorted(begins, times + _SOON) - 1, 0, len(timed) - 1)
    parts = [each.at(times[numbers == number] - begins[number]) for number, each in enumerate(timed)]
    positions, velocities, accelerations = (np.concatenate(each) for each in zip(*parts, strict=True))
    positions[[0, -1]], velocities[[0, -1]] = path[[0, -1]], 0.0
    curves = sum(len(each.radii) for each in stretches)
    return _rows(times, positions, velocities, accelerations, dynamics, (len(stretches) - 1, curves))


def _rows(
    times: Floats,
    positions: Floats,
    velocities: Floats,
    accelerations: Floats,
    dynamics: Dynamics | None,
    corners: tuple[int, int],
) -> Rows:
    torques = None if dynamics is None else dynamics.along(positions, velocities, accelerations)
    return Rows(times, positions, velocities, accelerations, torques, *corners)


def _timed(stretch: Stretch, limits: Limits, dynamics: Dynamics | None) -> Timed:
    """Return the motion along a stretch, from rest to rest."""
    places = _grid(stretch)
    if dynamics is not None:
        _refuse_too_weak(stretch(places), limits, dynamics)
    speeds = _solved(stretch, places, limits, dynamics)
    found = Timed(stretch, places, speeds)
    return found.slower(_slowdown(found, limits, dynamics))


def _grid(stretch: Stretch) -> Floats:
    """Return parameters from the beginning of a stretch to its end, among them those where curves begin and end."""
    parts = [np.zeros(1)]
    for number, (begin, end) in enumerate(zip(stretch.ends, stretch.ends[1:], strict=False)):
        if end - begin < _TINY * stretch.length:
            continue  # no straight piece between two curves
        count = _ON_CURVES if number % 2 else max(_LEAST_INTERVALS, int(np.ceil((end - begin) / _STEP)))
        parts.append(np.linspace(begin, end, count + 1)[1:])
    places = np.concatenate(parts)
    places[-1] = stretch.length  # toppra refuses a grid that ends elsewhere, even by rounding
    return places


def _refuse_too_weak(positions: Floats, limits: Limits, dynamics: Dynamics) -> None:
    """Refuse a path on which some joint cannot hold the robot at rest."""
    rest = np.zeros_like(positions)
    torques = np.abs(dynamics.along(positions, rest, rest))
    over = torques - limits.effort
    row, joint = np.unravel_index(int(np.argmax(over)), over.shape)
    if over[row, joint] >= 0.0:
        raise BadInput(
            "--retime: expected a path on which the joints can hold the robot, found one where "
            f"{limits.joints[joint]!r} needs {torques[row, joint]:.4g} N m at rest, more than its effort of "
            f"{limits.effort[joint]:.4g} N m; mend mass or effort in the URDF, or plan a path closer to the body"
        )


def _solved(stretch: Stretch, places: Floats, limits: Limits, dynamics: Dynamics | None) -> Floats:
    """Return the speeds ṡ at the points of the grid, by toppra."""
    try:
        import toppra
        from toppra import algorithm, constraint
    except ImportError as error:
        raise BadInput("--retime: toppra is not installed: pip install 'supernode[retime]'") from error
    logging.getLogger("toppra").setLevel(logging.CRITICAL)  # failure is reported below

    class Curve(toppra.interpolator.AbstractGeometricPath):  # type: ignore[misc]  # toppra has no types
        dof = stretch.corners.shape[1]
        path_interval = np.array([0.0, stretch.length])

        def __call__(self, at: Any, order: int = 0) -> Any:
            found = stretch(np.atleast_1d(at), order)
            return found if np.ndim(at) else found[0]

    scheme = constraint.DiscretizationType.Interpolation
    held = [
        constraint.JointVelocityConstraint(_both_ways(limits.velocity)),
        constraint.JointAccelerationConstraint(_both_ways(limits.acceleration), discretization_scheme=scheme),
    ]
    weak = np.flatnonzero(np.isfinite(limits.effort))
    if dynamics is not None and len(weak):
        sides = np.vstack([np.eye(len(limits.effort))[weak], -np.eye(len(limits.effort))[weak]])
        most = np.concatenate([limits.effort[weak], limits.effort[weak]])
        held.append(
            constraint.SecondOrderConstraint(
                dynamics.torques, lambda _: sides, lambda _: most, Curve.dof, discretization_scheme=scheme
            )
        )
    _, speeds, _ = algorithm.TOPPRA(held, Curve(), gridpoints=places).compute_parameterization(0.0, 0.0)
    if speeds is None or not np.isfinite(speeds).all() or np.any(speeds[1:-1] <= 0.0):
        raise BadInput(
            "--retime: expected a path that can be followed within the limits of torque, found one where gravity "
            "leaves too little to spare"
        )
    found: Floats = speeds
    return found


def _both_ways(limit: Floats) -> Floats:
    return np.column_stack([-limit, limit])


def _slowdown(timed: Timed, limits: Limits, dynamics: Dynamics | None) -> float:
    """Return how many times as slow the motion must be for all limits to hold; at least 1.

    k times as slow, velocities are 1/k of what they were, accelerations and what torques add to gravity 1/k².
    """
    knots = timed.knots
    ends = (timed.at(knots), timed.at(knots, late=True), timed.at((knots[1:] + knots[:-1]) / 2.0))
    positions, velocities, accelerations = (np.concatenate(each) for each in zip(*ends, strict=True))
    squares = [
        1.0,
        float(np.max(np.abs(velocities) / limits.velocity)) ** 2,
        float(np.max(np.abs(accelerations) / limits.acceleration)),
    ]
    if dynamics is not None:
        rest = np.zeros_like(positions)
        pull = dynamics.along(positions, rest, rest)
        added = dynamics.along(positions, velocities, accelerations) - pull
        spare = limits.effort - np.sign(added) * pull
        squares.append(float(np.max(np.abs(added) / np.maximum(spare, _TINY))))
    factor = float(np.sqrt(max(squares)))
    if factor > _SLOWEST:
        raise BadInput(
            "--retime: expected a path that can be followed within the limits of torque, found one where gravity "
            "leaves too little to spare"
        )
    return factor
