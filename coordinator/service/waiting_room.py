"""Limit how many requests wait, and their memory, so that a flood of them neither fills memory nor shuts others out."""

import threading
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple


class Queue(NamedTuple):
    """A queue in which at most ``requests`` may wait, of at most ``bytes`` in total; one alone may be larger."""

    name: str
    requests: int
    bytes: int


class WaitingRoom:
    """Counts waiting requests by the names of their queues. Any thread may use it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._requests: Counter[str] = Counter()
        self._bytes: Counter[str] = Counter()

    def enter(self, queues: Iterable[Queue], size: int) -> Queue | None:
        """Count a request of ``size`` bytes in all ``queues``; if one is full, count it in none and return that one."""
        queues = tuple(queues)
        with self._lock:
            for queue in queues:
                waiting, held = self._requests[queue.name], self._bytes[queue.name]
                # An empty queue takes a request of any size, or one that is too large could never be answered.
                if waiting and (waiting >= queue.requests or held + size > queue.bytes):
                    return queue
            self._count(queues, 1, size)
        return None

    def leave(self, queues: Iterable[Queue], size: int) -> None:
        """Uncount a request; its arguments must be those of `enter`."""
        with self._lock:
            self._count(queues, -1, -size)

    def _count(self, queues: Iterable[Queue], requests: int, size: int) -> None:
        for queue in queues:
            self._requests[queue.name] += requests
            self._bytes[queue.name] += size
            if not self._requests[queue.name]:  # names of jobs come and go
                del self._requests[queue.name], self._bytes[queue.name]
