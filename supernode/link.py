"""A client's link to a cluster: requests and their answers over Zenoh, for one asyncio loop.

Zenoh calls back on threads of its own; all that it brings is handed to the loop. A request that nobody answers is made
again, since whoever supervises the cluster starts a coordinator or a router that died again: requests are harmless when
they are repeated. Only when nobody has answered for a while, or the state folder says that the cluster is down, is it
given up.
"""

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import Any, Self

import zenoh

from coordinator.errors import ClusterFailed
from problems.errors import BadInput
from supernode.cluster_info import Place
from wire import sessions
from wire.callbacks import direct
from wire.jobs import Refused, Request, Status, decode_answer, encode
from wire.keys import Keys
from wire.strict import Rejected

CONNECT_WITHIN = 1.8  # seconds until a cluster is there, together with all before it less than two
PATIENCE = 30.0  # seconds without any answer, after which a cluster is given up
_AGAIN = 0.05  # seconds between attempts


class Link:
    """A session with one cluster; made by `open`."""

    def __init__(self, session: zenoh.Session, place: Place, keys: Keys) -> None:
        self.place = place
        self.keys = keys
        self._session = session
        self._loop = asyncio.get_running_loop()

    @classmethod
    async def open(cls, place: Place) -> Self:
        """Find the cluster.

        Raises:
            ClusterFailed: if none is there, in less than two seconds, or the one that is does not answer.
        """
        until = time.monotonic() + CONNECT_WITHIN
        info = place.info()
        endpoint = place.endpoint if info is None else info.endpoint
        assert endpoint is not None, "a place without a card is an endpoint"
        try:
            session = await asyncio.to_thread(sessions.visitor, endpoint, CONNECT_WITHIN)
        except zenoh.ZError:
            raise ClusterFailed(f"no cluster answers at {endpoint}") from None
        link = cls(session, place, Keys("*" if info is None else info.cluster))
        try:
            link.keys = Keys(await link._find(until))
        except BaseException:
            await link.close()
            raise
        return link

    async def ask(self, request: Request, patience: float = PATIENCE) -> Any:
        """The answer to a request.

        Raises:
            BadInput: if the cluster refuses it and blames the input.
            ClusterFailed: if it fails there, or nobody has answered for so many seconds.
        """
        payload = encode(request)
        until = time.monotonic() + patience
        while True:
            answers = await self._gather(payload, max(_AGAIN, until - time.monotonic()))
            if answers:
                return _value(answers[0])
            self.place.info()
            if time.monotonic() >= until:
                raise ClusterFailed(f"the cluster at {self.place} does not answer")
            await asyncio.sleep(_AGAIN)

    def listen(self, key: str, hear: Callable[[bytes], None]) -> None:
        """Have the loop call ``hear`` with each message under ``key``."""

        def pass_on(sample: zenoh.Sample) -> None:
            self._call(hear, sample.payload.to_bytes())

        self._session.declare_subscriber(key, direct(pass_on))

    def watch(self, key: str, hear: Callable[[str, bool], None]) -> None:
        """Have the loop call ``hear`` with each liveliness token under ``key`` as it comes (True) and goes (False)."""

        def pass_on(sample: zenoh.Sample) -> None:
            self._call(hear, str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self._session.liveliness().declare_subscriber(key, direct(pass_on), history=True)

    async def close(self) -> None:
        """Leave the cluster."""
        await asyncio.to_thread(self._session.close)

    async def _find(self, until: float) -> str:
        """The name of the cluster that answers: one is there by then, and has as long to answer as to any request."""
        while True:
            answers = await self._gather(encode(Status()), PATIENCE)  # ends at once if there is nobody to answer
            names = sorted({str(_value(answer)["cluster"]) for answer in answers})
            if len(names) == 1:
                return names[0]
            if self.place.cluster in names:
                return self.place.cluster
            if names:
                raise ClusterFailed(f"more than one cluster answers at {self.place}: {', '.join(names)}")
            if time.monotonic() >= until - _AGAIN:
                raise ClusterFailed(f"no cluster answers at {self.place}")
            await asyncio.sleep(_AGAIN)

    async def _gather(self, payload: bytes, seconds: float) -> list[bytes]:
        """All answers to one query."""
        answers: list[bytes] = []
        over = self._loop.create_future()

        def hear(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                answers.append(reply.ok.payload.to_bytes())

        def end() -> None:
            self._call(_settle, over)

        try:
            self._session.get(self.keys.jobs, direct(hear, end), payload=payload, timeout=seconds)
        except zenoh.ZError as error:
            raise ClusterFailed(f"the link to {self.place} is broken: {error}") from None
        await over
        return answers

    def _call(self, function: Callable[..., None], *arguments: Any) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed: nobody is left to be told
            self._loop.call_soon_threadsafe(function, *arguments)


def _settle(over: "asyncio.Future[None]") -> None:
    if not over.done():
        over.set_result(None)


def _value(payload: bytes) -> Any:
    try:
        answer = decode_answer(payload)
    except Rejected as error:
        raise ClusterFailed(f"the cluster's answer cannot be read: {error.reason}") from error
    if isinstance(answer, Refused):
        raise (BadInput if answer.blame == "input" else ClusterFailed)(answer.message)
    return answer.value
