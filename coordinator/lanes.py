"""Work that waits for others: in the order of its coming within a lane, all lanes at the same time.

A change of a job's world takes as long as the slowest of its nodes needs to prepare. It holds back the next change of
the same job, and nobody else.
"""

import threading
from collections import deque
from collections.abc import Callable

Work = Callable[[], None]


class Lanes:
    """A thread for each lane that has work, which must not raise."""

    def __init__(self) -> None:
        self._waiting: dict[str, deque[Work]] = {}  # of the lanes that have a thread
        self._lock = threading.Lock()

    def put(self, lane: str, work: Work) -> None:
        """Have this done after all that was put into the same lane before."""
        with self._lock:
            if lane in self._waiting:
                self._waiting[lane].append(work)
                return
            self._waiting[lane] = deque([work])
        threading.Thread(target=self._drive, args=(lane,), name=f"lane {lane}", daemon=True).start()

    def _drive(self, lane: str) -> None:
        while (work := self._next(lane)) is not None:
            work()

    def _next(self, lane: str) -> Work | None:
        """The next work of a lane, which ends if there is none."""
        with self._lock:
            if self._waiting[lane]:
                return self._waiting[lane].popleft()
            del self._waiting[lane]
            return None
