"""Motions of limited jerk, compiled: a time-optimal motion, smoothed over time and slowed down until all limits hold.

`problems.min_time.scaling` finds ṡ(t), whose slope jumps. Its moving average over a window of time is a motion along
the same curve, rest to rest, that takes longer by the window, and whose s̈ is continuous, 0 at both ends. With ṡ linear
between even moments and a window of a whole number of them, s̈ is linear in between too. Then the whole motion is slowed
down (or sped up) evenly until velocities, accelerations, jerks and torques all hold. Of seven windows, the whole time
and halves of it, the one that takes the least time counts. One joint that jerk alone limits takes the least time so;
other motions may take longer than the quickest of their jerk.
"""

from typing import Any

import numpy as np

from lowlevel.compiled import subroutine
from problems.min_time.scaling import exceeded_at, step_time

_WINDOWS = 7
_FEW_PARTS, _PARTS = 1, 16  # of a time step, at whose ends limits are looked at: to choose a window, and for it
_MARGIN = 1e-4  # of speed, for what lies between


@subroutine
def sample_speeds(room: Any, points: Any, steps: Any) -> Any:
    """Fill ṡ at ``points`` + 1 even moments of the motion in the room; returns the time between two of them, s.

    It is taken as linear in time between grid points, and scaled so that the whole curve is gone through.
    """
    x, time = room.x, 0.0
    for point in range(points):
        time += step_time(x[2 * point], x[2 * point + 1], x[2 * point + 2], 1.0 / steps)
    period, point, begin, end, area = time / points, -1, 0.0, 0.0, 0.0
    for moment in range(points + 1):
        now = moment * period
        while point < 0 or (end < now and point < points - 1):
            point += 1
            begin = end
            end += step_time(x[2 * point], x[2 * point + 1], x[2 * point + 2], 1.0 / steps)
        share = min(1.0, (now - begin) / (end - begin))
        room.speeds[moment] = (1.0 - share) * np.sqrt(x[2 * point]) + share * np.sqrt(x[2 * point + 2])
    room.speeds[0], room.speeds[points] = 0.0, 0.0
    for moment in range(points):
        area += room.speeds[moment] * period
    room.speeds[: points + 1] *= (points // steps) / area
    return period


@subroutine
def smooth_push(room: Any, points: Any, period: Any, window: Any, moment: Any) -> Any:
    """The smoothed motion's s̈ at a moment, 0 to ``points`` + ``window``."""
    ahead = room.speeds[moment] if moment <= points else 0.0
    behind = room.speeds[moment - window] if moment >= window else 0.0
    return (ahead - behind) / (window * period)


@subroutine
def advance(place: Any, speed: Any, push: Any, surge: Any, time: Any) -> Any:
    """s, ṡ and s̈ after some time at a constant third derivative of s."""
    return (
        place + time * (speed + time * (push / 2.0 + time * surge / 6.0)),
        speed + time * (push + time * surge / 2.0),
        push + time * surge,
    )


@subroutine
def slowdown_of(task: Any, room: Any, points: Any, steps: Any, period: Any, window: Any, parts: Any) -> Any:
    """By what the times of a smoothed motion must be multiplied for all limits to hold, at parts of each time step."""
    place, speed, push, slowest = 0.0, 0.0, 0.0, 0.0
    for moment in range(points + window):
        surge = (smooth_push(room, points, period, window, moment + 1) - push) / period
        for part in range(parts + 1):
            at, fast, pushed = advance(place, speed, push, surge, period * part / parts)
            slowest = max(slowest, _slowdown_at(task, room, points, steps, at, max(fast, 0.0), pushed, surge))
        place, speed, push = advance(place, speed, push, surge, period)
    return slowest * (1.0 + _MARGIN)


@subroutine
def _slowdown_at(task: Any, room: Any, points: Any, steps: Any, place: Any, speed: Any, push: Any, surge: Any) -> Any:
    """By what times must be multiplied for the limits to hold at one place."""
    point = min(points - 1, max(0, np.int64(place * steps)))
    forced, fast, jerk = exceeded_at(task, room, point, place * steps - point, steps, push, speed * speed, surge)
    return max(np.sqrt(max(forced, fast)), jerk ** (1.0 / 3.0))


@subroutine
def best_window(task: Any, room: Any, points: Any, steps: Any) -> Any:
    """The quickest smoothed motion along the curve in the room: its window, its time step (s), and its slowdown.

    `sample_speeds` has filled the room then.
    """
    period = sample_speeds(room, points, steps)
    best, chosen = np.inf, 1
    for number in range(_WINDOWS):
        window = max(1, points >> number)
        slowdown = slowdown_of(task, room, points, steps, period, window, _FEW_PARTS)
        if slowdown * (points + window) < best:
            best, chosen = slowdown * (points + window), window
    slowdown = slowdown_of(task, room, points, steps, period, chosen, _PARTS)
    return chosen, period * slowdown, slowdown


@subroutine
def smooth_time(task: Any, room: Any, points: Any, steps: Any) -> Any:
    """The time of the quickest smoothed motion, s."""
    window, period, _ = best_window(task, room, points, steps)
    return period * (points + window)
