"""How much may wait to be done, so that a flood of requests takes the memory of nobody, nor the turn of others."""

import threading
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple


class Queue(NamedTuple):
    """What waits together: at most ``requests``, of so many bytes in all (one alone may be larger)."""

    name: str
    requests: int
    bytes: int


class WaitingRoom:
    """Counts what waits. Any thread may use it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._requests: Counter[str] = Counter()
        self._bytes: Counter[str] = Counter()

    def enter(self, queues: Iterable[Queue], size: int) -> Queue | None:
        """A request of ``size`` bytes waits in all ``queues``, or in none of them: then the one that is full."""
        queues = tuple(queues)
        with self._lock:
            for queue in queues:
                waiting, held = self._requests[queue.name], self._bytes[queue.name]
                if waiting and (waiting >= queue.requests or held + size > queue.bytes):
                    return queue
            self._count(queues, 1, size)
        return None

    def leave(self, queues: Iterable[Queue], size: int) -> None:
        """It waits no longer."""
        with self._lock:
            self._count(queues, -1, -size)

    def _count(self, queues: Iterable[Queue], requests: int, size: int) -> None:
        for queue in queues:
            self._requests[queue.name] += requests
            self._bytes[queue.name] += size
            if not self._requests[queue.name]:
                del self._requests[queue.name], self._bytes[queue.name]
