"""Speeds over time along a path of straight pieces: from rest to rest, so that no velocity ever jumps.

On each piece speed rises evenly, stays, and falls evenly: a trapezium, or a triangle where the piece is too short for
full speed. Where the path goes straight on, pieces are one; where its direction changes, it rests. The path is not
rounded at its corners: what was checked for collisions is where the robot goes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from problems.motion import Floats, Pace

_STRAIGHT = 1e-9  # by how much unit vectors of two directions may differ that count as one


@dataclass(frozen=True)
class Profile:
    """Pieces that are gone through one after another, each from rest to rest.

    Attributes:
        lengths: of the pieces, in some unit, greater than 0; shape (pieces,), as the following.
        speeds: the greatest on each, units/s.
        accelerations: with which speed is gained and lost, units/s².
        starts: when each begins, s, not before the end of the one before; one upon the other if None.
    """

    lengths: Floats
    speeds: Floats
    accelerations: Floats
    starts: Floats | None = None

    @cached_property
    def peaks(self) -> Floats:
        """The speeds that are reached, units/s."""
        return np.minimum(self.speeds, np.sqrt(self.lengths * self.accelerations))

    @cached_property
    def ramps(self) -> Floats:
        """How long speed is gained, and lost, s."""
        return self.peaks / self.accelerations

    @cached_property
    def seconds(self) -> Floats:
        """How long each piece takes, s: each ramp goes half as far as full speed would."""
        return self.lengths / self.peaks + self.ramps

    @cached_property
    def begins(self) -> Floats:
        """When each piece begins, s."""
        if self.starts is not None:
            return self.starts
        return np.concatenate([[0.0], np.cumsum(self.seconds)[:-1]])[: len(self.seconds)]

    @cached_property
    def ends(self) -> Floats:
        """When each piece ends, s."""
        return self.begins + self.seconds

    @property
    def knots(self) -> Floats:
        """Moments at which an acceleration begins or ends, s, increasing, the first 0."""
        inner = (self.begins, self.begins + self.ramps, self.ends - self.ramps, self.ends)
        return np.unique(np.concatenate([[0.0], *inner]))

    def at(self, times: Floats) -> tuple[Floats, Floats, NDArray[np.int64]]:
        """How far it has gone from the beginning, how fast it goes, and on which piece: (n,) each.

        A moment at which one piece ends and another begins belongs to the one that ends.
        """
        if len(self.lengths) == 0:
            return np.zeros(len(times)), np.zeros(len(times)), np.zeros(len(times), np.int64)
        far = np.cumsum(self.lengths)
        piece = np.maximum(np.searchsorted(self.begins, times, side="left") - 1, 0)
        peak, ramp, gain = self.peaks[piece], self.ramps[piece], self.accelerations[piece]
        gone = np.maximum(times - self.begins[piece], 0.0)
        left = np.maximum(self.ends[piece] - times, 0.0)
        begun = np.concatenate([[0.0], far[:-1]])[piece]
        rising, falling = begun + gain * gone**2 / 2.0, far[piece] - gain * left**2 / 2.0
        even = begun + peak * (gone - ramp / 2.0)
        way = np.where(gone < ramp, np.minimum(rising, far[piece]), np.where(left < ramp, falling, even))
        return way, np.minimum(peak, gain * np.minimum(gone, left)), piece

    def when(self, ways: Floats) -> Floats:
        """At which moments places are passed, that far from the beginning: (n,) to (n,)."""
        if len(self.lengths) == 0:
            return np.zeros(len(ways))
        far = np.cumsum(self.lengths)
        piece = np.minimum(np.searchsorted(far, ways, side="left"), len(far) - 1)
        left = np.maximum(far[piece] - ways, 0.0)
        gone = np.maximum(self.lengths[piece] - left, 0.0)
        peak, ramp, gain = self.peaks[piece], self.ramps[piece], self.accelerations[piece]
        on_ramp = gain * ramp**2 / 2.0
        late = np.where(left < on_ramp, self.seconds[piece] - np.sqrt(2.0 * left / gain), ramp / 2.0 + gone / peak)
        moments: Floats = self.begins[piece] + np.where(gone < on_ramp, np.sqrt(2.0 * gone / gain), late)
        return moments

    def gains(self, times: Floats) -> tuple[Floats, NDArray[np.int64]]:
        """Accelerations along the path, units/s², and on which piece, (n,): at an instant of change what begins there.

        At the last moment, what ends there. No change may lie between two moments.
        """
        if len(times) == 1 or len(self.lengths) == 0:
            return np.zeros(len(times)), np.zeros(len(times), np.int64)
        middles = np.append(times[:-1] + times[1:], times[-2] + times[-1]) / 2.0
        piece = np.maximum(np.searchsorted(self.begins, middles, side="left") - 1, 0)
        gone, left, ramp = middles - self.begins[piece], self.ends[piece] - middles, self.ramps[piece]
        sign = np.where(gone < ramp, 1.0, np.where(left < ramp, -1.0, 0.0))
        sign[(gone < 0.0) | (left < 0.0)] = 0.0  # it waits
        return sign * self.accelerations[piece], piece


@dataclass(frozen=True)
class Ride:
    """A path over time.

    Attributes:
        times: of the rows, s; shape (rows,).
        rows: where the path is then, shape (rows, numbers), as the following; all of its own rows are among them.
        velocities: per second.
        accelerations: per second²; at an instant of change those that begin there.
        stops: how often it rests on the way.
    """

    times: Floats
    rows: Floats
    velocities: Floats
    accelerations: Floats
    stops: int

    @property
    def notes(self) -> tuple[str, ...]:
        """What else who drives it must know."""
        return (f"it rests at {self.stops} corner{'s' if self.stops > 1 else ''} of the path",) if self.stops else ()


def ride(path: Floats, lengths: Floats, speeds: Floats, accelerations: Floats, pace: Pace) -> Ride:
    """The quickest motion along a path that rests at its corners.

    Args:
        path: its rows, straight in between, shape (corners, numbers).
        lengths: from each row to the next, in some unit, 0 only where they are the same, shape (corners - 1,).
        speeds: the greatest between them, units/s, shape (corners - 1,) or ().
        accelerations: likewise, units/s².
        pace: how densely it is told.
    """
    moving = np.flatnonzero(lengths > 0.0)
    directions = np.diff(path, axis=0)[moving] / lengths[moving, None]
    speeds, accelerations = (np.broadcast_to(each, lengths.shape)[moving] for each in (speeds, accelerations))
    ways = np.concatenate([[0.0], np.cumsum(lengths[moving])])
    firsts = _turns(directions)
    profile = Profile(np.diff(ways[np.append(firsts, len(moving))]), speeds[firsts], accelerations[firsts])
    times = pace.moments(np.unique(np.concatenate([profile.knots, profile.when(ways[1:-1])])))
    way, speed, piece = profile.at(times)
    corners = path[np.concatenate([[0], moving + 1])]
    rows = np.column_stack([np.interp(way, ways, column) for column in corners.T])
    rows[-1] = path[-1]  # else a last bit off: the same lengths are added up in two ways
    if len(moving) == 0:
        return Ride(times, rows, np.zeros(rows.shape), np.zeros(rows.shape), 0)
    gains, begun = profile.gains(times)
    return Ride(
        times,
        rows,
        directions[firsts[piece]] * speed[:, None],
        directions[firsts[begun]] * gains[:, None],
        len(firsts) - 1,
    )


def drive(poses: Floats, moving: tuple[float, float], turning: tuple[float, float], pace: Pace) -> Ride:
    """The quickest motion of a body that moves ahead or turns on the spot, and rests between the two.

    Args:
        poses: two coordinates and a heading, rad; from each to the next one or the other changes; shape (poses, 3).
        moving: the greatest speed, units/s, and acceleration, units/s².
        turning: the greatest speed, rad/s, and acceleration, rad/s².
        pace: how densely it is told.
    """
    steps = np.abs(np.diff(poses, axis=0))
    moves = np.hypot(steps[:, 0], steps[:, 1])
    goes = moves > 0.0
    lengths = np.where(goes, moves, steps[:, 2])
    return ride(poses, lengths, np.where(goes, moving[0], turning[0]), np.where(goes, moving[1], turning[1]), pace)


def _turns(directions: Floats) -> NDArray[np.int64]:
    """The first of each run of directions that are the same."""
    sizes = np.linalg.norm(directions, axis=1, keepdims=True)
    unit = directions / np.where(sizes > 0.0, sizes, 1.0)
    turns = np.linalg.norm(np.diff(unit, axis=0), axis=1) > _STRAIGHT
    return np.flatnonzero(np.concatenate([np.ones(min(1, len(unit)), np.bool_), turns]))
