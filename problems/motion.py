"""Motions over time: what an exported solution is made of, whichever planner found it.

A planner says where its robots are at which moments; who writes a file needs to know no more. Rows of a motion are
moments; each of its tracks is what moves as one: an arm, a body, or numbers that are neither.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput

Floats = NDArray[np.float64]

MOST_ROWS = 1_000_000
RATE = 50.0  # rows a second, unless told
RAMP = 0.5  # s, after which a path's speed is reached unless told
_CORNERS = 48  # of the line that stands for a circle
_TICK = 1e-9  # s
_NEAR = 0.1  # of a period: an even moment so near to another row is left out


class Column(NamedTuple):
    """Some number over time, shape (rows,)."""

    name: str
    unit: str
    values: Floats


@dataclass(frozen=True)
class Values:
    """Numbers that are neither joint angles nor a pose, such as the place in an abstract configuration space."""

    name: str
    columns: tuple[Column, ...]


@dataclass(frozen=True)
class Joints:
    """An arm by its joints.

    Attributes:
        name: of the arm; empty if there is but one.
        joints: their names.
        position: rad, shape (rows, joints), as the following.
        velocity: rad/s, if known.
        acceleration: rad/s², if known.
        effort: N·m, if known.
        links: where the joints and the tip are, shape (rows, points, 3), m, if known.
    """

    name: str
    joints: tuple[str, ...]
    position: Floats
    velocity: Floats | None = None
    acceleration: Floats | None = None
    effort: Floats | None = None
    links: Floats | None = None

    @property
    def quantities(self) -> dict[str, tuple[str, Floats]]:
        """Unit and values of whatever is known of each joint."""
        known = {
            "position": ("rad", self.position),
            "velocity": ("rad/s", self.velocity),
            "acceleration": ("rad/s^2", self.acceleration),
            "effort": ("N m", self.effort),
        }
        return {name: (unit, values) for name, (unit, values) in known.items() if values is not None}

    @property
    def columns(self) -> tuple[Column, ...]:
        """One for each quantity of each joint."""
        return tuple(
            Column(f"{joint}.{name}", unit, values[:, number])
            for name, (unit, values) in self.quantities.items()
            for number, joint in enumerate(self.joints)
        )


@dataclass(frozen=True)
class Body:
    """A body that moves and turns.

    Attributes:
        name: of the body; empty if there is but one.
        columns: its pose as the planner's own solution tells it.
        places: x, y and z, shape (rows, 3).
        angles: roll, pitch and yaw, rad, about axes that stand still, x first; shape (rows, 3).
        outline: a closed line in its own frame, shape (corners, 3), if it has one.
    """

    name: str
    columns: tuple[Column, ...]
    places: Floats
    angles: Floats
    outline: Floats | None = None


Track = Values | Joints | Body


@dataclass(frozen=True)
class Limit:
    """What a motion keeps to.

    Attributes:
        name: of what is limited, such as ``"speed"``.
        values: the limit, or one for each joint.
        unit: of the values.
        source: who says so: an option, a field of the problem file, or a default.
    """

    name: str
    values: tuple[float, ...]
    unit: str
    source: str

    @property
    def value(self) -> float:
        """The limit, if it is one."""
        (value,) = self.values
        return value

    def __str__(self) -> str:
        shown = ", ".join(f"{value:.4g}" for value in self.values)
        return f"{self.name} {f'[{shown}]' if len(self.values) > 1 else shown} {self.unit} ({self.source})"


@dataclass(frozen=True)
class Motion:
    """What moves, and when.

    Attributes:
        times: of the rows, s, increasing, the first 0; shape (rows,).
        tracks: what moves.
        obstacles: closed lines around what stands still, each of shape (corners, 3), for a picture.
        limits: what the motion keeps to.
        notes: what else who drives it must know.
    """

    times: Floats
    tracks: tuple[Track, ...]
    obstacles: tuple[Floats, ...] = ()
    limits: tuple[Limit, ...] = ()
    notes: tuple[str, ...] = ()

    def columns(self) -> Iterator[Column]:
        """The time, and all that moves; names say of which track, if there are several."""
        yield Column("t", "s", self.times)
        for track in self.tracks:
            prefix = f"{track.name}." if track.name else ""
            for name, unit, values in track.columns:
                yield Column(prefix + name, unit, values)


@dataclass(frozen=True)
class Pace:
    """How quick a motion shall be, where the solution does not say, and how densely it is told.

    Attributes:
        speed: the greatest along a path without times, in the path's unit per second.
        turn_speed: the greatest of a body that turns, rad/s.
        acceleration: with which speed is gained and lost, in the path's unit per second².
        turn_acceleration: likewise of turns, rad/s².
        rate: rows a second, for motions that can be told at any moment.
    """

    speed: float | None = None
    turn_speed: float | None = None
    acceleration: float | None = None
    turn_acceleration: float | None = None
    rate: float | None = None

    def along(self, kind: str, unit: str) -> float:
        """The greatest speed along a path without times.

        Raises:
            BadInput: if there is none: to invent one would look like a plan.
        """
        if self.speed is None:
            raise BadInput(f"--speed: expected a speed in {unit}, as a path of {kind} has no times, found nothing")
        return self.speed

    def moving(self, kind: str, unit: str) -> tuple[Limit, Limit]:
        """Speed and acceleration along a path without times: full speed after `RAMP` unless told.

        Raises:
            BadInput: if there is no speed.
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
        """Speed and acceleration of turns on the spot.

        Unless told, no point within ``reach`` of the axis is quicker than ``speed``, and turns take as long as moves to
        reach their speed.
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
        """Complain of what is given, but means nothing for such a motion.

        Raises:
            BadInput: with the reason.
        """
        for name, reason in reasons.items():
            value = getattr(self, name)
            if value is not None:
                raise BadInput(f"--{name.replace('_', '-')}: expected none for {kind}, {reason}, found {value:g}")

    def moments(self, knots: Floats) -> Floats:
        """Moments to tell a motion at: evenly, and the knots (increasing, the first 0), at which something changes.

        Raises:
            BadInput: if they are too many.
        """
        knots = _apart(np.unique(knots))
        rate = RATE if self.rate is None else self.rate
        count = float(knots[-1]) * rate + len(knots)
        if not count <= MOST_ROWS:
            found = f"{count:.4g}: {rate:g} a second for {knots[-1]:g} s"
            raise BadInput(f"--rate: expected at most {MOST_ROWS:,} rows, found {found}")
        even = np.arange(int(knots[-1] * rate) + 1) / rate
        following = np.minimum(np.searchsorted(knots, even), len(knots) - 1)
        away = np.minimum(np.abs(knots[following] - even), np.abs(even - knots[following - 1]))
        return np.unique(np.concatenate([knots, even[away > _NEAR / rate]]))


def _apart(knots: Floats) -> Floats:
    """Increasing knots without those that a clock of nanoseconds cannot tell from the one before, or from the last."""
    first, inner, last = knots[:1], knots[1:-1], knots[-1:]
    return np.unique(np.concatenate([first, inner[(inner - knots[:-2] > _TICK) & (last - inner > _TICK)], last]))


def joint_names(count: int) -> tuple[str, ...]:
    """Of an arm whose joints have no names of their own."""
    return tuple(f"joint_{number}" for number in range(1, count + 1))


def planar_links(lengths: list[float], base: tuple[float, float], angles: Floats) -> Floats:
    """Where joints and tip of a planar arm are: angles of shape (rows, joints) to (rows, joints + 1, 3)."""
    headings = np.cumsum(angles, axis=1)
    links = np.zeros((len(angles), len(lengths) + 1, 3))
    links[:, :, :2] = base
    links[:, 1:, 0] += np.cumsum(lengths * np.cos(headings), axis=1)
    links[:, 1:, 1] += np.cumsum(lengths * np.sin(headings), axis=1)
    return links


def loop(corners: Floats, thickness: float = 0.0) -> Floats:
    """A closed line in the plane z = 0, shape (corners, 3); around a disc if there is one corner, and a thickness."""
    if len(corners) == 1:
        bearing = np.arange(_CORNERS) * (2.0 * np.pi / _CORNERS)
        corners = corners + thickness * np.column_stack([np.cos(bearing), np.sin(bearing)])
    return np.column_stack([corners, np.zeros(len(corners))])
