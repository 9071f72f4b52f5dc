"""A queue in which no client holds up another: their requests are taken in turns, however many one of them sends."""

import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from typing import Generic, TypeVar

_MOST_CLIENTS = 10_000  # whose rates are remembered
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
        self._a_second = a_second
        self._is_limited = is_limited
        self._changed = threading.Condition()
        self._waiting: OrderedDict[str, deque[_Item]] = OrderedDict()  # by client, the next one first; none is empty
        self._allowed: dict[str, tuple[float, float]] = {}  # by client, how many items were allowed, and when that was
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
        now, least = time.monotonic(), None
        for client in list(self._waiting):
            pause = self._pause_of(client, now)
            if pause == 0.0:
                self._waiting.move_to_end(client, last=False)
                return 0.0
            least = pause if least is None else min(least, pause)
        return least

    def _pause_of(self, client: str, now: float) -> float:
        """Return for how many seconds no item of a client may be taken: a bucket of tokens, which fills with time."""
        if self._a_second is None or not self._is_limited(client):
            return 0.0
        if len(self._allowed) > _MOST_CLIENTS:  # those without certificates may claim any names
            self._allowed.clear()
        allowed, then = self._allowed.get(client, (self._a_second, now))
        allowed = min(self._a_second, allowed + self._a_second * (now - then))
        self._allowed[client] = allowed, now
        return 0.0 if allowed >= 1.0 else (1.0 - allowed) / self._a_second

    def _pop(self) -> _Item:
        client, waiting = self._waiting.popitem(last=False)
        item = waiting.popleft()
        if waiting:
            self._waiting[client] = waiting  # behind all others
        if client in self._allowed:
            allowed, then = self._allowed[client]
            self._allowed[client] = allowed - 1.0, then
        return item
