"""Limit how often each client, or each address, may do something, by token buckets in bounded memory."""

import time
from collections.abc import Callable

_KEPT = 4096  # clients; one that is forgotten begins anew


class Limit:
    """Lets each client do something ``burst`` times at once, and ``rate`` times a second in the long run.

    Args:
        rate: times a second.
        burst: times at once.
        clock: returns the time in seconds; None for the monotonic clock.
    """

    def __init__(self, rate: float, burst: int, clock: Callable[[], float] | None = None) -> None:
        self._rate = rate
        self._burst = burst
        self._clock = time.monotonic if clock is None else clock
        self._left: dict[str, tuple[float, float]] = {}  # by client: how often, and when that was so; oldest first

    def wait(self, client: str) -> float:
        """Return the seconds until a client may do it again; 0 if it may now."""
        return max(0.0, (1.0 - self._left_now(client)) / self._rate)

    def count(self, client: str) -> None:
        """Count that a client has done it."""
        left = self._left_now(client) - 1.0
        self._left.pop(client, None)  # so that it becomes the newest
        self._left[client] = (max(0.0, left), self._clock())
        if len(self._left) > _KEPT:
            del self._left[next(iter(self._left))]

    def _left_now(self, client: str) -> float:
        left, at = self._left.get(client, (float(self._burst), 0.0))
        return min(float(self._burst), left + self._rate * (self._clock() - at))
