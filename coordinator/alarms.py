"""Rings at given times: one thread for all of them, which lives only while there is something to wait for."""

import threading
import time
from collections.abc import Callable


class Alarms:
    """An alarm clock with a hand for each job.

    Args:
        ring: called with the job's number, on the clock's thread.
    """

    def __init__(self, ring: Callable[[int], None]) -> None:
        self._ring = ring
        self._due: dict[int, float] = {}  # on the monotonic clock
        self._changed = threading.Condition()
        self._runs = False

    def set(self, number: int, due: float) -> None:
        """Ring at that time, once, even if it has passed."""
        with self._changed:
            self._due[number] = due
            if not self._runs:
                self._runs = True
                threading.Thread(target=self._work, name="alarms", daemon=True).start()
            self._changed.notify_all()

    def forget(self, number: int) -> None:
        """Do not ring for this one. Harmless if it was never set."""
        with self._changed:
            self._due.pop(number, None)
            self._changed.notify_all()

    def _work(self) -> None:
        while (number := self._next()) is not None:
            self._ring(number)

    def _next(self) -> int | None:
        """The next one that is due, when it is; None if there is none."""
        with self._changed:
            while self._due:
                number = min(self._due, key=self._due.__getitem__)
                left = self._due[number] - time.monotonic()
                if left <= 0:
                    del self._due[number]
                    return number
                self._changed.wait(min(left, threading.TIMEOUT_MAX))
            self._runs = False
            return None
