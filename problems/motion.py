"""Motions over time: the common format of exported solutions, whichever planner found them.

A planner converts its solution to a `Motion`, and the writers of file formats know nothing else. The rows of a motion
are moments. Each track describes one thing that moves: an arm, a rigid body, or plain numbers that are neither.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput

Floats = NDArray[np.float64]

WORLD = "world"  # the frame of all that stands still
MOST_ROWS = 1_000_000
RATE = 50.0  # rows per second by default
RAMP = 0.5  # s, the default time to reach full speed
_CORNERS = 48  # of the polygon that approximates a circle
_TICK = 1e-9  # s, the least time between two rows
_NEAR = 0.1  # share of a period: an evenly spaced row that is this close to a knot is left out


class Column(NamedTuple):
    """One quantity over time; ``values`` has the shape (rows,)."""

    name: str
    unit: str
    values: Floats


@dataclass(frozen=True)
class Values:
    """Numbers that are neither joint angles nor a pose, such as a point in an abstract configuration space."""

    name: str
    columns: tuple[Column, ...]


@dataclass(frozen=True)
class Joints:
    """The motion of an arm, by its joints. All arrays of joint values have the shape (rows, joints).

    Attributes:
        name: the arm's name; empty if there is only one arm.
        joints: the names of the joints.
        position: rad, or m where ``units`` says so; the following accordingly.
        velocity: rad/s, if known.
        acceleration: rad/s², if known.
        effort: N·m, if known.
        links: the positions of the joints and the tip, m, shape (rows, points, 3), if known.
        units: ``"rad"`` or ``"m"`` for each joint; empty if all are in rad.
        urdf: the robot's description as XML, if there is one.
        standing: names and values of the robot's other joints, which could move but stand still.
    """

    name: str
    joints: tuple[str, ...]
    position: Floats
    velocity: Floats | None = None
    acceleration: Floats | None = None
    effort: Floats | None = None
    links: Floats | None = None
    units: tuple[str, ...] = ()
    urdf: str | None = None
    standing: tuple[tuple[str, float], ...] = ()

    @property
    def quantities(self) -> dict[str, tuple[str, Floats]]:
        """The unit (of a joint in rad) and the values of each known quantity, by its name."""
        known = {
            "position": ("rad", self.position),
            "velocity": ("rad/s", self.velocity),
            "acceleration": ("rad/s^2", self.acceleration),
            "effort": ("N m", self.effort),
        }
        return {name: (unit, values) for name, (unit, values) in known.items() if values is not None}

    @property
    def columns(self) -> tuple[Column, ...]:
        """One column for each known quantity of each joint."""
        return tuple(
            Column(f"{joint}.{name}", self._unit(number, unit), values[:, number])
            for name, (unit, values) in self.quantities.items()
            for number, joint in enumerate(self.joints)
        )

    def _unit(self, joint: int, unit: str) -> str:
        """Return the unit of a quantity of a joint, given that of a joint in rad."""
        is_sliding = bool(self.units) and self.units[joint] == "m"
        return unit.replace("rad", "m").replace("N m", "N") if is_sliding else unit


@dataclass(frozen=True)
class Body:
    """The motion of a rigid body.

    Attributes:
        name: the body's name; empty if there is only one body.
        columns: the body's pose in the coordinates of the planner's solution.
        places: x, y and z, shape (rows, 3).
        angles: roll, pitch and yaw about fixed axes, in this order, rad; shape (rows, 3).
        outline: the body's outline in its own frame, a closed line of shape (corners, 3), if it has one.
    """

    name: str
    columns: tuple[Column, ...]
    places: Floats
    angles: Floats
    outline: Floats | None = None


Track = Values | Joints | Body


@dataclass(frozen=True)
class Limit:
    """A limit that a motion respects.

    Attributes:
        name: the limited quantity, such as ``"speed"``.
        values: one value, or one for each joint.
        unit: the unit of the values.
        source: where the limit comes from: an option, a field of the problem file, or a default.
    """

    name: str
    values: tuple[float, ...]
    unit: str
    source: str

    @property
    def value(self) -> float:
        """The value of a limit that has only one.

        Raises:
            ValueError: if there is one for each of several joints.
        """
        (value,) = self.values
        return value

    def __str__(self) -> str:
        shown = ", ".join(f"{value:.4g}" for value in self.values)
        return f"{self.name} {f'[{shown}]' if len(self.values) > 1 else shown} {self.unit} ({self.source})"


@dataclass(frozen=True)
class Frame:
    """A frame over time, such as that of a robot's link.

    Attributes:
        parent: the frame that it is placed in, such as `WORLD`.
        name: its name.
        places: its origin, m, shape (rows, 3), or (1, 3) if it stands still in its parent.
        quaternions: its rotation x, y, z, w, shape (rows, 4) or (1, 4).
    """

    parent: str
    name: str
    places: Floats
    quaternions: Floats


@dataclass(frozen=True)
class Solid:
    """A shape in space, for pictures.

    Attributes:
        name: the name of what it is, unique in the motion.
        frame: the frame that it stands still in.
        shape: ``"box"``, ``"cylinder"`` (along z), ``"sphere"`` or ``"mesh"``.
        size: full lengths along its axes, m; empty for a mesh.
        place: its centre in the frame, m, shape (3,).
        quaternion: its rotation x, y, z, w, shape (4,).
        triangles: the triangles of a mesh, m, shape (triangles, 3, 3).
    """

    name: str
    frame: str
    shape: str
    size: tuple[float, ...]
    place: Floats
    quaternion: Floats
    triangles: Floats | None = None


@dataclass(frozen=True)
class Motion:
    """Everything that moves, and when.

    Attributes:
        times: the moments of the rows, s, strictly increasing from 0; shape (rows,).
        tracks: what moves.
        obstacles: outlines of what stands still, closed lines of shape (corners, 3), for pictures.
        limits: the limits that the motion respects.
        notes: further remarks for the user of the motion, such as where it stops.
        frames: the frames of links, for pictures in space.
        solids: shapes in these frames and in the world.
    """

    times: Floats
    tracks: tuple[Track, ...]
    obstacles: tuple[Floats, ...] = ()
    limits: tuple[Limit, ...] = ()
    notes: tuple[str, ...] = ()
    frames: tuple[Frame, ...] = ()
    solids: tuple[Solid, ...] = ()

    def columns(self) -> Iterator[Column]:
        """Yield the column of times, then those of all tracks, their names prefixed with the track's name if any."""
        yield Column("t", "s", self.times)
        for track in self.tracks:
            prefix = f"{track.name}." if track.name else ""
            for name, unit, values in track.columns:
                yield Column(prefix + name, unit, values)


@dataclass(frozen=True)
class Pace:
    """The user's options for a motion: speeds where the solution has no times, and the sampling rate.

    Attributes:
        speed: the greatest speed along a path without times, in the path's unit per second.
        turn_speed: the greatest speed of a body that turns, rad/s.
        acceleration: the acceleration and deceleration along the path, in the path's unit per second².
        turn_acceleration: the acceleration and deceleration of turns, rad/s².
        rate: rows per second, for motions that can be sampled at any moment.
        blend: how far from a corner a retimed motion may pass, rad or m.
        retime: whether the solution was retimed with these options just now.
    """

    speed: float | None = None
    turn_speed: float | None = None
    acceleration: float | None = None
    turn_acceleration: float | None = None
    rate: float | None = None
    blend: float | None = None
    retime: bool = False

    def along(self, kind: str, unit: str) -> float:
        """Return the greatest speed along a path without times.

        Raises:
            BadInput: if the user gave none. There is no default: an invented speed would look like part of the plan.
        """
        if self.speed is None:
            raise BadInput(f"--speed: expected a speed in {unit}, as a path of {kind} has no times, found nothing")
        return self.speed

    def moving(self, kind: str, unit: str) -> tuple[Limit, Limit]:
        """Return the limits of speed and acceleration along a path without times; by default full speed after `RAMP`.

        Raises:
            BadInput: if the user gave no speed.
        """
        speed = self.along(kind, unit + "/s")
        gain, source = self.acceleration, "--acceleration"
        if gain is None:
            gain, source = speed / RAMP, f"default: full speed after {RAMP:g} s"
        return (
            Limit("speed", (speed,), unit + "/s", "--speed"),
            Limit("acceleration", (gain,), unit + "/s^2", source),
        )

    def turning(self, speed: float, gain: float, reach: float) -> tuple[Limit, Limit]:
        """Return the limits of speed and acceleration of turns on the spot.

        By default no point of the body is faster than ``speed`` while it turns, and a turn reaches full speed as soon
        as a move does.

        Args:
            speed: the greatest speed along the path, in its unit per second.
            gain: the acceleration along the path.
            reach: the greatest distance of a point of the body from its axis, in the path's unit.
        """
        turn, source = self.turn_speed, "--turn-speed"
        if turn is None:
            turn, source = (
                speed / reach,
                f"default: no point of it, {reach:.4g} from the axis at most, exceeds the speed",
            )
        turn_gain, gain_source = self.turn_acceleration, "--turn-acceleration"
        if turn_gain is None:
            turn_gain, gain_source = turn * (gain / speed), "default: as soon at full speed as along the path"
        return (
            Limit("turn speed", (turn,), "rad/s", source),
            Limit("turn acceleration", (turn_gain,), "rad/s^2", gain_source),
        )

    def refuse(self, kind: str, **reasons: str) -> None:
        """Refuse options that mean nothing for a motion.

        Args:
            kind: the kind of problem, for the message.
            reasons: for each meaningless option of this class, why it is meaningless.

        Raises:
            BadInput: if one of these options was given; the message names the reason.
        """
        for name, reason in reasons.items():
            value = getattr(self, name)
            if value is not None:
                raise BadInput(f"--{name.replace('_', '-')}: expected none for {kind}, {reason}, found {value:g}")

    def moments(self, knots: Floats) -> Floats:
        """Return the moments of a motion's rows, s: all knots, and evenly spaced moments between them.

        Args:
            knots: the moments at which an acceleration changes, s; the least is 0.

        Raises:
            BadInput: if there would be more than `MOST_ROWS`.
        """
        knots = _apart(np.unique(knots))
        rate = RATE if self.rate is None else self.rate
        # Count before allocating: a tiny speed makes a motion of years.
        count = float(knots[-1]) * rate + len(knots)
        if not count <= MOST_ROWS:  # written so that NaN and infinity are refused, too
            found = f"{count:.4g}: {rate:g} a second for {knots[-1]:g} s"
            raise BadInput(f"--rate: expected at most {MOST_ROWS:,} rows, found {found}")
        even = np.arange(int(knots[-1] * rate) + 1) / rate
        # The distance of each even moment from the nearest knot; too close ones would give very short steps.
        following = np.minimum(np.searchsorted(knots, even), len(knots) - 1)
        away = np.minimum(np.abs(knots[following] - even), np.abs(even - knots[following - 1]))
        return np.unique(np.concatenate([knots, even[away > _NEAR / rate]]))


def _apart(knots: Floats) -> Floats:
    """Return increasing knots without those that are within `_TICK` of the one before, or of the last."""
    first, inner, last = knots[:1], knots[1:-1], knots[-1:]
    return np.unique(np.concatenate([first, inner[(inner - knots[:-2] > _TICK) & (last - inner > _TICK)], last]))


def joint_names(count: int) -> tuple[str, ...]:
    """Return names for the joints of an arm whose problem file does not name them."""
    return tuple(f"joint_{number}" for number in range(1, count + 1))


def planar_links(lengths: list[float], base: tuple[float, float], angles: Floats) -> Floats:
    """Return the positions of a planar arm's joints and tip, m: angles (rows, joints), rad, to (rows, joints + 1, 3).

    Each angle is relative to the link before; z is 0.
    """
    headings = np.cumsum(angles, axis=1)
    links = np.zeros((len(angles), len(lengths) + 1, 3))
    links[:, :, :2] = base
    links[:, 1:, 0] += np.cumsum(lengths * np.cos(headings), axis=1)
    links[:, 1:, 1] += np.cumsum(lengths * np.sin(headings), axis=1)
    return links


def loop(corners: Floats, thickness: float = 0.0) -> Floats:
    """Return the outline of a shape in the plane z = 0, shape (corners, 3).

    A single corner with a thickness is a disc, whose outline is approximated by a polygon.
    """
    if len(corners) == 1:
        bearing = np.arange(_CORNERS) * (2.0 * np.pi / _CORNERS)
        corners = corners + thickness * np.column_stack([np.cos(bearing), np.sin(bearing)])
    return np.column_stack([corners, np.zeros(len(corners))])
