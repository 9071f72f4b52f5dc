"""A queue in which no client holds up another: their requests are taken in turns, however many one of them sends."""

import threading
from collections import OrderedDict, deque
from collections.abc import Callable
from typing import Generic, TypeVar

from coordinator.rate_limit import Limit

_Item = TypeVar("_Item")


class FairQueue(Generic[_Item]):
    """Items of several clients, which are taken in turns; each client's in their order. Any thread may use it.

    Args:
        most: how many items of one client may wait.
        a_second: how many items of one client are taken a second, after a first burst of as many; None for any number.
        is_limited: which clients ``a_second`` holds for.
    """

    def __init__(
        self, most: int, a_second: float | None = None, is_limited: Callable[[str], bool] = lambda _: True
    ) -> None:
        self._most = most
        self._rate = None if a_second is None else Limit(a_second, int(a_second))
        self._is_limited = is_limited
        self._changed = threading.Condition()
        self._waiting: OrderedDict[str, deque[_Item]] = OrderedDict()  # by client, the next one first; none is empty
        self._is_closed = False

    def put(self, client: str, item: _Item) -> bool:
        """Add an item; return False, and leave it out, if too many of the client's wait already."""
        with self._changed:
            waiting = self._waiting.setdefault(client, deque())
            if len(waiting) >= self._most:
                return False
            waiting.append(item)
            self._changed.notify()
            return True

    def take(self) -> _Item | None:
        """Return the next item, as soon as there is one; None once the queue is closed."""
        with self._changed:
            while not self._is_closed:
                pause = self._pause()
                if pause == 0.0:
                    return self._pop()
                self._changed.wait(pause)
            return None

    def close(self) -> None:
        """Let each `take` return None; items that wait are forgotten."""
        with self._changed:
            self._is_closed = True
            self._waiting.clear()
            self._changed.notify_all()

    def _pause(self) -> float | None:
        """Bring a client to the front who may have an item taken now.

        Returns:
            0.0, or how many seconds no client may; None if nothing waits.
        """
        least = None
        for client in list(self._waiting):
            pause = self._pause_of(client)
            if pause == 0.0:
                self._waiting.move_to_end(client, last=False)
                return 0.0
            least = pause if least is None else min(least, pause)
        return least

    def _pause_of(self, client: str) -> float:
        """Return for how many seconds no item of a client may be taken."""
        return 0.0 if self._rate is None or not self._is_limited(client) else self._rate.wait(client)

    def _pop(self) -> _Item:
        client, waiting = self._waiting.popitem(last=False)
        item = waiting.popleft()
        if waiting:
            self._waiting[client] = waiting  # behind all others
        if self._rate is not None and self._is_limited(client):
            self._rate.count(client)
        return item
