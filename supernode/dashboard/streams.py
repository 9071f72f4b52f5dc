"""Live news for browsers: server-sent events, each the whole picture as it is now, or all but the nodes (``nodes=0``).

All browsers share one snapshot, and none has a queue: whoever reads slowly misses some, and whoever does not read at
all is disconnected by the socket's user timeout (`listen_address`). So memory does not grow, however many look.
"""

import asyncio
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qs

from starlette.responses import PlainTextResponse
from starlette.types import Receive, Scope, Send

MOST = 100  # streams at once
PERIOD = 1.0  # seconds; nodes tell their counters no more often
_HEADERS = [
    (b"content-type", b"text/event-stream"),
    (b"cache-control", b"no-store"),
    (b"x-accel-buffering", b"no"),  # a proxy must not hold them back
]


class Streams:
    """Everybody who watches; an ASGI application that is one stream.

    Args:
        snapshot: all there is to show, which each stream begins with.
        news: the same, or what is new of it, if anything is.
    """

    def __init__(self, snapshot: Callable[[], dict[str, Any]], news: Callable[[], dict[str, Any] | None]) -> None:
        self._snapshot = snapshot
        self._news = news
        self._latest: asyncio.Future[_Event] = asyncio.get_running_loop().create_future()
        self.count = 0

    async def run(self) -> None:
        """Take snapshots until cancelled, while anybody watches."""
        while True:
            await asyncio.sleep(PERIOD)
            news = self._news() if self.count else None
            if news is not None:
                before, self._latest = self._latest, asyncio.get_running_loop().create_future()
                before.set_result(_Event.of(news))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Tell one browser until it is gone."""
        if self.count >= MOST:
            await PlainTextResponse(f"there are {MOST} streams already\n", 503)(scope, receive, send)
            return
        self.count += 1
        briefly = parse_qs(scope["query_string"]).get(b"nodes") == [b"0"]
        gone = asyncio.create_task(_until_gone(receive))
        try:
            await send({"type": "http.response.start", "status": 200, "headers": _HEADERS})
            event = _Event.of(self._snapshot())
            while not gone.done():
                await send(
                    {"type": "http.response.body", "body": event.brief if briefly else event.whole, "more_body": True}
                )
                event = await asyncio.shield(self._latest)
        finally:
            gone.cancel()
            self.count -= 1


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


def _encoded(snapshot: dict[str, Any]) -> bytes:
    return b"data: " + json.dumps(snapshot, separators=(",", ":"), allow_nan=False).encode() + b"\n\n"
