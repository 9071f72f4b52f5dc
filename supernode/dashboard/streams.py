"""Stream live updates to browsers as server-sent events.

Each message holds everything that is shown now, or all but the nodes (``nodes=0``). All browsers share one snapshot,
and no browser has a queue. One that reads slowly misses some messages; one that does not read at all is disconnected by
the socket's user timeout (`listen_address`). So memory does not grow with the number of browsers.

An event "improvement" before a message holds the latest improvement of a job, with its solution. It is sent once to
each browser. One that reads slowly misses improvements of a job, but never the latest.
"""

import asyncio
import json
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any
from urllib.parse import parse_qs

from starlette.responses import PlainTextResponse
from starlette.types import Receive, Scope, Send

from supernode.dashboard.limits import subscriber
from supernode.live.view import Heard

MOST = 100  # streams at once
MOST_OF_ONE = 60  # streams at once of one address, so that none takes up all
PERIOD = 1.0  # seconds between two events; nodes report their counters no more often
_KEPT = 64  # encoded improvements that are kept for the other browsers
_HEADERS = [
    (b"content-type", b"text/event-stream"),
    (b"cache-control", b"no-store"),
    (b"x-accel-buffering", b"no"),  # a proxy such as nginx must not hold events back
]


class Streams:
    """All live streams; an ASGI application whose answer to each request is one stream.

    Args:
        snapshot: returns everything to show; each stream begins with it.
        news: returns what has changed since it was called last, perhaps without the nodes; None if nothing has.
        improvements: returns the latest improvement of each job, by the job's number.
    """

    def __init__(
        self,
        snapshot: Callable[[], dict[str, Any]],
        news: Callable[[], dict[str, Any] | None],
        improvements: Callable[[], Mapping[int, Heard]],
    ) -> None:
        self._snapshot = snapshot
        self._news = news
        self._improvements = improvements
        self._latest: asyncio.Future[_Event] = asyncio.get_running_loop().create_future()  # of the next event
        self._of: Counter[str] = Counter()  # streams of each address

    @property
    def count(self) -> int:
        """How many streams there are."""
        return self._of.total()

    async def run(self) -> None:
        """Publish updates until cancelled; take none while nobody watches."""
        while True:
            await asyncio.sleep(PERIOD)
            news = self._news() if self.count else None
            if news is not None:
                before, self._latest = self._latest, asyncio.get_running_loop().create_future()
                before.set_result(_Event.of(news))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send events to one browser until it disconnects or is logged out."""
        if self.count >= MOST:
            await PlainTextResponse(f"there are {MOST} streams already\n", 503)(scope, receive, send)
            return
        address = subscriber(scope["client"][0])
        if self._of[address] >= MOST_OF_ONE:
            await PlainTextResponse(f"this address has {MOST_OF_ONE} streams already\n", 429)(scope, receive, send)
            return
        self._of[address] += 1
        briefly = parse_qs(scope["query_string"]).get(b"nodes") == [b"0"]
        gone = asyncio.create_task(_until_gone(receive))
        try:
            await send({"type": "http.response.start", "status": 200, "headers": _HEADERS})
            event = _Event.of(self._snapshot())
            sent: Mapping[int, Heard] = {}
            while not gone.done() and scope["is_still_allowed"]():
                before, sent = sent, self._improvements()
                news = [_improvement_event(each) for job, each in sent.items() if before.get(job) is not each]
                body = b"".join(news) + (event.brief if briefly else event.whole)
                await send({"type": "http.response.body", "body": body, "more_body": True})
                # Shielded: all streams wait for this future, so the end of one must not cancel it.
                event = await asyncio.shield(self._latest)
        finally:
            gone.cancel()
            self._of[address] -= 1
            self._of += Counter()  # keeps only what is above 0


async def _until_gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


@dataclass(frozen=True)
class _Event:
    whole: bytes
    brief: bytes

    @staticmethod
    def of(snapshot: dict[str, Any]) -> "_Event":
        brief = {name: value for name, value in snapshot.items() if name != "nodes"}
        return _Event(_encoded(snapshot), _encoded(brief))


@lru_cache(_KEPT)
def _improvement_event(heard: Heard) -> bytes:
    return b"event: improvement\n" + _encoded(heard.plain())


def _encoded(value: dict[str, Any]) -> bytes:
    return b"data: " + json.dumps(value, separators=(",", ":"), allow_nan=False).encode() + b"\n\n"
