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
class Motion:
    """What moves, and when.

    Attributes:
        times: of the rows, s, increasing, the first 0; shape (rows,).
        tracks: what moves.
        obstacles: closed lines around what stands still, each of shape (corners, 3), for a picture.
    """

    times: Floats
    tracks: tuple[Track, ...]
    obstacles: tuple[Floats, ...] = ()

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
        speed: along a path without times, in the path's unit per second.
        turn_speed: of a body that turns on the spot, rad/s.
        rate: rows a second, for motions that can be told at any moment.
    """

    speed: float | None = None
    turn_speed: float | None = None
    rate: float | None = None

    def along(self, kind: str, unit: str) -> float:
        """The speed along a path without times.

        Raises:
            BadInput: if there is none: to invent one would look like a plan.
        """
        if self.speed is None:
            raise BadInput(f"--speed: expected a speed in {unit}, as a path of {kind} has no times, found nothing")
        return self.speed

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


def straight(path: Floats, seconds: Floats, pace: Pace) -> tuple[Floats, Floats]:
    """A path whose rows are reached one after another, straight in between, at an even speed.

    Args:
        path: shape (corners, numbers).
        seconds: from each corner to the next, shape (corners − 1,).
        pace: how densely.

    Returns:
        The moments, (rows,), and where the path is then, (rows, numbers); all corners are among them.
    """
    knots = np.concatenate([[0.0], np.cumsum(seconds)])
    times = pace.moments(knots)
    return times, np.column_stack([np.interp(times, knots, column) for column in path.T])


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
