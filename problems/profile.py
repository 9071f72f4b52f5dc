"""Trapezoidal speed profiles along paths of straight pieces.

Each piece is travelled from rest to rest, so no velocity ever jumps. The speed rises linearly, stays constant and falls
linearly: a trapezoid, or a triangle if the piece is too short for full speed. Consecutive pieces in the same direction
are joined into one. Corners are not rounded: the robot stays exactly on the path that was checked for collisions, and
therefore stops at each corner.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from problems.motion import Floats, Pace

_STRAIGHT = 1e-9  # two directions count as equal if their unit vectors differ by no more


@dataclass(frozen=True)
class Profile:
    """A sequence of pieces, each travelled from rest to rest. All arrays have the shape (pieces,).

    Attributes:
        lengths: the lengths of the pieces in some unit, greater than 0.
        speeds: the greatest speed on each piece, units/s.
        accelerations: the acceleration and deceleration on each piece, units/s².
        starts: when each piece begins, s, not before the end of the previous one. If None, the pieces follow one
            another without a wait.
    """

    lengths: Floats
    speeds: Floats
    accelerations: Floats
    starts: Floats | None = None

    @cached_property
    def peaks(self) -> Floats:
        """The greatest speed that each piece reaches, units/s; less than its limit on a short piece."""
        # Accelerating up to the middle of the piece reaches v with v² / 2a = length / 2.
        return np.minimum(self.speeds, np.sqrt(self.lengths * self.accelerations))

    @cached_property
    def ramps(self) -> Floats:
        """The duration of the acceleration on each piece, s, which is also that of the deceleration."""
        return self.peaks / self.accelerations

    @cached_property
    def seconds(self) -> Floats:
        """The duration of each piece, s. A ramp covers half of the distance of full speed, so two ramps cost one."""
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
        """Return distance from the beginning, speed and number of the piece at each moment: (n,) to three arrays (n,).

        A moment at which one piece ends and the next begins belongs to the piece that ends.
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
        # Counting back from the end makes the end of a piece exact, where the robot then waits.
        way = np.where(gone < ramp, np.minimum(rising, far[piece]), np.where(left < ramp, falling, even))
        return way, np.minimum(peak, gain * np.minimum(gone, left)), piece

    def when(self, ways: Floats) -> Floats:
        """Return the moments at which given distances from the beginning are reached, s: (n,) to (n,)."""
        if len(self.lengths) == 0:
            return np.zeros(len(ways))
        far = np.cumsum(self.lengths)
        piece = np.minimum(np.searchsorted(far, ways, side="left"), len(far) - 1)
        left = np.maximum(far[piece] - ways, 0.0)
        gone = np.maximum(self.lengths[piece] - left, 0.0)
        peak, ramp, gain = self.peaks[piece], self.ramps[piece], self.accelerations[piece]
        on_ramp = gain * ramp**2 / 2.0  # the length of a ramp
        late = np.where(left < on_ramp, self.seconds[piece] - np.sqrt(2.0 * left / gain), ramp / 2.0 + gone / peak)
        moments: Floats = self.begins[piece] + np.where(gone < on_ramp, np.sqrt(2.0 * gone / gain), late)
        return moments

    def gains(self, times: Floats) -> tuple[Floats, NDArray[np.int64]]:
        """Return the acceleration along the path, units/s², and the number of the piece at each moment: (n,) each.

        Where the acceleration changes, the value is the one that begins; at the last moment, the one that ends.

        Args:
            times: increasing moments, s. They must include all `knots` between the first and the last.
        """
        if len(times) == 1 or len(self.lengths) == 0:
            return np.zeros(len(times)), np.zeros(len(times), np.int64)
        # Between two moments nothing changes, so the middle decides which acceleration begins at the first of them.
        middles = np.append(times[:-1] + times[1:], times[-2] + times[-1]) / 2.0
        piece = np.maximum(np.searchsorted(self.begins, middles, side="left") - 1, 0)
        gone, left, ramp = middles - self.begins[piece], self.ends[piece] - middles, self.ramps[piece]
        sign = np.where(gone < ramp, 1.0, np.where(left < ramp, -1.0, 0.0))
        sign[(gone < 0.0) | (left < 0.0)] = 0.0  # it waits between two pieces
        return sign * self.accelerations[piece], piece


@dataclass(frozen=True)
class Ride:
    """A path over time. All arrays but ``times`` have the shape (rows, numbers).

    Attributes:
        times: the moments of the rows, s, shape (rows,).
        rows: the positions at these moments; the rows of the path are among them.
        velocities: the velocities, per second.
        accelerations: the accelerations, per second²; where they change, those that begin.
        stops: how often the motion stops between its beginning and its end.
    """

    times: Floats
    rows: Floats
    velocities: Floats
    accelerations: Floats
    stops: int

    @property
    def notes(self) -> tuple[str, ...]:
        """A remark about the stops, for `Motion.notes`, if there are any."""
        return (f"it rests at {self.stops} corner{'s' if self.stops > 1 else ''} of the path",) if self.stops else ()


def ride(path: Floats, lengths: Floats, speeds: Floats, accelerations: Floats, pace: Pace) -> Ride:
    """Return the fastest motion along a path that stops at the path's corners.

    Args:
        path: the corners, with straight lines between them, shape (corners, numbers).
        lengths: the distance from each row to the next in some unit, shape (corners - 1,); 0 only if they are equal.
        speeds: the greatest speed between two rows, units/s, shape (corners - 1,) or ().
        accelerations: the acceleration between two rows, units/s², with the shape of ``speeds``.
        pace: the sampling rate.

    Raises:
        BadInput: if the motion would have too many rows.
    """
    moving = np.flatnonzero(lengths > 0.0)
    directions = np.diff(path, axis=0)[moving] / lengths[moving, None]
    speeds, accelerations = (np.broadcast_to(each, lengths.shape)[moving] for each in (speeds, accelerations))
    ways = np.concatenate([[0.0], np.cumsum(lengths[moving])])
    # One piece of the profile for each run of the same direction; the first speed of a run holds for all of it.
    firsts = _turns(directions)
    profile = Profile(np.diff(ways[np.append(firsts, len(moving))]), speeds[firsts], accelerations[firsts])
    times = pace.moments(np.unique(np.concatenate([profile.knots, profile.when(ways[1:-1])])))
    way, speed, piece = profile.at(times)
    corners = path[np.concatenate([[0], moving + 1])]
    rows = np.column_stack([np.interp(way, ways, column) for column in corners.T])
    rows[-1] = path[-1]  # exactly: the lengths are summed in two ways, which may differ in the last bit
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
    """Return the fastest motion of a body that alternately moves straight and turns on the spot, stopping in between.

    Args:
        poses: x, y and heading (rad), shape (poses, 3). From one pose to the next, either the position or the heading
            changes.
        moving: the greatest speed, units/s, and the acceleration, units/s², of moves.
        turning: the greatest speed, rad/s, and the acceleration, rad/s², of turns.
        pace: the sampling rate.

    Raises:
        BadInput: if the motion would have too many rows.
    """
    steps = np.abs(np.diff(poses, axis=0))
    moves = np.hypot(steps[:, 0], steps[:, 1])
    goes = moves > 0.0
    lengths = np.where(goes, moves, steps[:, 2])
    return ride(poses, lengths, np.where(goes, moving[0], turning[0]), np.where(goes, moving[1], turning[1]), pace)


def _turns(directions: Floats) -> NDArray[np.int64]:
    """Return the index of the first piece of each run of pieces with the same direction."""
    sizes = np.linalg.norm(directions, axis=1, keepdims=True)
    unit = directions / np.where(sizes > 0.0, sizes, 1.0)
    turns = np.linalg.norm(np.diff(unit, axis=0), axis=1) > _STRAIGHT
    return np.flatnonzero(np.concatenate([np.ones(min(1, len(unit)), np.bool_), turns]))
