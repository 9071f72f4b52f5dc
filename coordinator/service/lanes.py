"""Queues of work: one after another within a lane, all lanes at the same time.

There is a lane for each job with changes. A change takes as long as the slowest of the job's nodes needs to prepare. It
must hold back the next change of the same job, but no other job.
"""

import threading
from collections import deque
from collections.abc import Callable

Work = Callable[[], None]


class Lanes:
    """Runs work on one thread for each lane that has any. Any thread may use it; work must not raise.

    A thread ends when its lane is empty, so lanes of jobs that have ended cost nothing.
    """

    def __init__(self) -> None:
        self._waiting: dict[str, deque[Work]] = {}  # by lane; a lane is here exactly as long as it has a thread
        self._lock = threading.Lock()

    def put(self, lane: str, work: Work) -> None:
        """Have ``work`` called after everything that was put into the same lane before."""
        with self._lock:
            if lane in self._waiting:
                self._waiting[lane].append(work)
                return
            self._waiting[lane] = deque([work])
        # Outside the lock: only this call has made the lane, so there is one thread for it.
        threading.Thread(target=self._drive, args=(lane,), name=f"lane {lane}", daemon=True).start()

    def _drive(self, lane: str) -> None:
        while (work := self._next(lane)) is not None:
            work()

    def _next(self, lane: str) -> Work | None:
        """Return the next work of a lane; if there is none, remove the lane and return None."""
        with self._lock:
            if self._waiting[lane]:
                return self._waiting[lane].popleft()
            del self._waiting[lane]
            return None
