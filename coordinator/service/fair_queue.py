"""A queue in which no client holds up another: their requests are taken in turns, however many one of them sends."""

import math
import threading
import time
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, NamedTuple, TypeVar

_Item = TypeVar("_Item")
_OWED = 10.0  # seconds: nobody waits longer, however much time a single item took
_SAVED = 2.0  # seconds: a client that was quiet may take its share of so long at once
_LEAST_PAUSE = 0.001  # seconds: a shorter one may be lost to rounding
_RECENT = 5.0  # seconds for which a client counts as one that asks


class Shares(NamedTuple):
    """How much of a processor's time may go into one client's items in the long run.

    Attributes:
        alone: the share while no other client asks.
        beside: the share while others ask too.
    """

    alone: float
    beside: float


_ALL = Shares(1.0, 1.0)


class FairQueue(Generic[_Item]):
    """Items of several clients, which are taken in turns; each client's in their order. Any thread may use it.

    Args:
        most: how many items of one client may wait.
        most_bytes: how many bytes they may hold; one alone may hold more.
        shares: how much processor time one client's items may take, as far as it is `charged`.
        is_limited: which clients ``shares`` and ``most_at_once`` hold for.
        most_at_once: how many items of one client may be under way, from `take` to the end of `charged`.
    """

    def __init__(
        self,
        most: int,
        most_bytes: int = 64 << 20,
        shares: Shares = _ALL,
        is_limited: Callable[[str], bool] = lambda _: True,
        most_at_once: float = math.inf,
    ) -> None:
        self._most = most
        self._most_bytes = most_bytes
        self._bytes: Counter[str] = Counter()  # of the items that wait, by client
        self._shares = shares
        self._is_limited = is_limited
        self._most_at_once = most_at_once
        self._under_way: Counter[str] = Counter()  # items that were taken and are not charged yet, by client
        self._heard: dict[str, float] = {}  # when each client asked last, if that was lately
        self._free_from: dict[str, float] = {}  # when each client's items may be taken again, if it was charged lately
        self._changed = threading.Condition()
        # By client, the next one first, their items and these items' sizes; none is empty.
        self._waiting: OrderedDict[str, deque[tuple[_Item, int]]] = OrderedDict()
        self._is_closed = False

    def put(self, client: str, item: _Item, size: int = 0) -> bool:
        """Add an item of ``size`` bytes; return False, and leave it out, if too many of the client's wait already."""
        with self._changed:
            self._heard[client] = time.monotonic()
            waiting = len(self._waiting.get(client, ()))
            if waiting >= self._most or (waiting and self._bytes[client] + size > self._most_bytes):
                return False
            self._waiting.setdefault(client, deque()).append((item, size))
            self._bytes[client] += size
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

    @contextmanager
    def charged(self, client: str) -> Iterator[None]:
        """Charge a client with the processor time that this thread uses while the context is open, for one item."""
        began = time.thread_time()
        try:
            yield
        finally:
            self.charge(client, time.thread_time() - began)
            with self._changed:
                self._under_way[client] -= 1
                if self._under_way[client] <= 0:
                    del self._under_way[client]
                self._changed.notify()

    def charge(self, client: str, seconds: float) -> None:
        """Count processor time that an item of a client took: its next one waits until its share allows that."""
        if not self._is_limited(client):
            return
        with self._changed:
            now = time.monotonic()
            self._heard = {each: at for each, at in self._heard.items() if now - at < _RECENT}
            self._free_from = {each: at for each, at in self._free_from.items() if now - at < _SAVED}
            share = self._shares.beside if self._heard.keys() - {client} else self._shares.alone
            free_from = max(self._free_from.get(client, 0.0), now - _SAVED) + seconds / share
            self._free_from[client] = min(free_from, now + _OWED)

    def close(self) -> None:
        """Let each `take` return None; items that wait are forgotten."""
        with self._changed:
            self._is_closed = True
            self._waiting.clear()
            self._bytes.clear()
            self._changed.notify_all()

    def _pause(self) -> float | None:
        """Bring a client to the front who may have an item taken now.

        Returns:
            0.0, or how many seconds no client may; None if nothing waits but for items that are under way.
        """
        least = None
        for client in list(self._waiting):
            if self._is_limited(client) and self._under_way[client] >= self._most_at_once:
                continue
            pause = self._pause_of(client)
            if pause == 0.0:
                self._waiting.move_to_end(client, last=False)
                return 0.0
            least = pause if least is None else min(least, pause)
        return least

    def _pause_of(self, client: str) -> float:
        """Return for how many seconds no item of a client may be taken."""
        pause = self._free_from.get(client, 0.0) - time.monotonic()
        return max(pause, _LEAST_PAUSE) if pause > 0.0 else 0.0

    def _pop(self) -> _Item:
        client, waiting = self._waiting.popitem(last=False)
        item, size = waiting.popleft()
        self._bytes[client] -= size
        self._under_way[client] += 1
        if waiting:
            self._waiting[client] = waiting  # behind all others
        else:
            del self._bytes[client]
        return item
