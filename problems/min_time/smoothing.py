"""Compiled motions of limited jerk: a time-optimal motion, smoothed over time and slowed down until all limits hold.

`problems.min_time.scaling` finds ṡ(t), whose slope jumps. Its moving average over a window of time is a motion along
the same curve, from rest to rest, that takes longer by the window; its s̈ is continuous, and 0 at both ends. If ṡ is
linear between equally spaced moments and the window is a whole number of periods, s̈ is linear between moments too.
Then the whole motion is slowed down (or sped up) evenly until velocities, accelerations, jerks and torques all hold.
Seven windows are tried: the whole time, a half of it, a quarter and so on; the quickest motion counts.

This is optimal for one joint that only jerk limits. Other motions may take longer than necessary: see docs/min-time.md.
"""

from typing import Any

import numpy as np

from lowlevel.compiled import subroutine
from problems.min_time.scaling import exceeded_at, step_time

_WINDOWS = 7
# Limits are checked at the ends of so many parts of each time step: few to choose a window, more for the chosen one.
_FEW_PARTS, _PARTS = 1, 16
_MARGIN = 1e-4  # the share by which the motion is slower still, for excesses between the checked moments


@subroutine
def sample_speeds(room: Any, points: Any, steps: Any) -> Any:
    """Fill ṡ at ``points`` + 1 equally spaced moments of the motion in the room; return the period between them, s.

    ṡ is taken as linear in time between grid points. It is then scaled so that its integral is the whole curve.
    """
    x, time = room.x, 0.0
    for point in range(points):
        time += step_time(x[2 * point], x[2 * point + 1], x[2 * point + 2], 1.0 / steps)
    period, point, begin, end, area = time / points, -1, 0.0, 0.0, 0.0
    for moment in range(points + 1):
        now = moment * period
        # Go on to the step that this moment lies in; both run forwards, so that takes one pass.
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
    """Return the smoothed motion's s̈ at a moment, 0 to ``points`` + ``window``.

    The derivative of a moving average is the difference of the values at the window's ends, over its length.
    """
    ahead = room.speeds[moment] if moment <= points else 0.0
    behind = room.speeds[moment - window] if moment >= window else 0.0
    return (ahead - behind) / (window * period)


@subroutine
def advance(place: Any, speed: Any, push: Any, surge: Any, time: Any) -> Any:
    """Return s, ṡ and s̈ after some time at a constant third derivative of s (``surge``)."""
    return (
        place + time * (speed + time * (push / 2.0 + time * surge / 6.0)),
        speed + time * (push + time * surge / 2.0),
        push + time * surge,
    )


@subroutine
def slowdown_of(task: Any, room: Any, points: Any, steps: Any, period: Any, window: Any, parts: Any) -> Any:
    """Return the factor of time with which all limits hold, at the ends of so many parts of each time step."""
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
    """Return the factor of time with which all limits hold at one place.

    Times longer by f make speeds f, accelerations f² and jerks f³ times smaller, hence the roots.
    """
    point = min(points - 1, max(0, np.int64(place * steps)))
    forced, fast, jerk = exceeded_at(task, room, point, place * steps - point, steps, push, speed * speed, surge)
    return max(np.sqrt(max(forced, fast)), jerk ** (1.0 / 3.0))


@subroutine
def best_window(task: Any, room: Any, points: Any, steps: Any) -> Any:
    """Return the window, the time step (s) and the slowdown of the quickest smoothed motion along the curve.

    It leaves the sampled speeds in the room, which `smooth_push` reads afterwards.
    """
    period = sample_speeds(room, points, steps)
    best, chosen = np.inf, 1
    for number in range(_WINDOWS):
        # The window is a whole number of periods, so that s̈ stays linear between moments.
        window = max(1, points >> number)
        slowdown = slowdown_of(task, room, points, steps, period, window, _FEW_PARTS)
        if slowdown * (points + window) < best:
            best, chosen = slowdown * (points + window), window
    slowdown = slowdown_of(task, room, points, steps, period, chosen, _PARTS)
    return chosen, period * slowdown, slowdown


@subroutine
def smooth_time(task: Any, room: Any, points: Any, steps: Any) -> Any:
    """Return the time of the quickest smoothed motion, s."""
    window, period, _ = best_window(task, room, points, steps)
    return period * (points + window)
