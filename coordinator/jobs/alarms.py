"""Call a function at given times, with one thread for all of them that runs only while there is a time to wait for."""

import threading
import time
from collections.abc import Callable

NO_JOB = 0  # the number of an alarm that is not for a job


class Alarms:
    """Alarms, at most one for each job, and one more. Any thread may use it.

    Args:
        ring: called with the job's number, on the alarms' thread, which holds no lock then. A slow call delays the
            other alarms.
    """

    def __init__(self, ring: Callable[[int], None]) -> None:
        self._ring = ring
        self._due: dict[int, float] = {}  # by job, on the monotonic clock
        self._changed = threading.Condition()
        self._runs = False  # whether there is a thread; changed only together with the decision to start or end it

    def set(self, number: int, due: float) -> None:
        """Ring once at the time ``due`` (monotonic clock); at once if it has passed."""
        with self._changed:
            self._due[number] = due
            if not self._runs:
                self._runs = True
                threading.Thread(target=self._work, name="alarms", daemon=True).start()
            self._changed.notify_all()

    def forget(self, number: int) -> None:
        """Cancel the alarm of a job. Harmless if there is none."""
        with self._changed:
            self._due.pop(number, None)
            self._changed.notify_all()

    def _work(self) -> None:
        while (number := self._next()) is not None:
            self._ring(number)

    def _next(self) -> int | None:
        """Wait for the next alarm and return its job; None, to end the thread, if there is no alarm left."""
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
