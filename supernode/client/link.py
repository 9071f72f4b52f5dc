"""A client's link to a cluster: it sends requests and receives answers over Zenoh, for one asyncio loop.

Zenoh calls back on threads of its own. `Link` hands everything that arrives to the loop, so that only the loop's thread
touches the client's state.

A request without an answer is sent again: the coordinator or the router may have died, and their supervisor starts them
anew. Requests may be repeated without harm. `Link` gives up only when nothing has answered for a while, or when the
state folder says that the cluster is down.
"""

import asyncio
import contextlib
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any, Self

import zenoh

from coordinator.errors import ClusterFailed
from problems.errors import BadInput
from supernode.client.cluster_info import Place
from wire import sessions
from wire.callbacks import direct
from wire.jobs import Refused, Request, Status, decode_answer, encode
from wire.keys import ANYONE, Keys
from wire.members import Identity
from wire.strict import Rejected

CONNECT_WITHIN = 1.8  # seconds to find a cluster; with the imports before it, `connect` fails within two seconds
PATIENCE = 30.0  # seconds without any answer after which a cluster is given up; a restart takes less
_ATTEMPT = 10.0  # seconds after which an answer counts as lost: the router drops those that find no room
_AGAIN = 0.05  # seconds between two attempts


class Link:
    """A session with one cluster; `open` makes one. Use it only on the loop that it was made on."""

    def __init__(self, session: zenoh.Session, place: Place, keys: Keys) -> None:
        self.place = place
        self.keys = keys
        self._session = session
        self._member = None if place.identity is None else place.identity.member
        self._loop = asyncio.get_running_loop()

    @classmethod
    async def open(cls, place: Place) -> Self:
        """Find the cluster at ``place`` and connect to it.

        Raises:
            ClusterFailed: if no cluster is found, which is known in less than two seconds; if several are, and none is
                the one that ``place`` names; or if the cluster does not answer.
        """
        until = time.monotonic() + CONNECT_WITHIN
        info = place.info()
        endpoint = place.endpoint if info is None else info.endpoint
        assert endpoint is not None, "a place that is not a folder has an endpoint"
        identity = place.identity
        if sessions.is_encrypted(endpoint):
            _check_keys(endpoint, identity)
        try:
            session = await asyncio.to_thread(sessions.visitor, endpoint, CONNECT_WITHIN, identity)
        except zenoh.ZError:
            raise ClusterFailed(_no_answer(place, endpoint)) from None
        # Until the cluster's name is known, ask under the name of the folder's entry, or any cluster at the endpoint.
        link = cls(session, place, Keys("*" if info is None else info.cluster))
        try:
            link.keys = Keys(await link._find(until))
        except BaseException:
            await link.close()
            raise
        return link

    async def ask(self, request: Request, patience: float = PATIENCE) -> Any:
        """Send a request and return the value of its answer; repeat it until it is answered.

        Args:
            request: the request.
            patience: seconds without any answer after which the cluster is given up.

        Raises:
            BadInput: if the cluster refuses the request and blames the input.
            ClusterFailed: if the request fails in the cluster, or nothing has answered for ``patience`` seconds.
        """
        self._check_right(request)
        payload = encode(request)
        until = time.monotonic() + patience
        while True:
            left = max(_AGAIN, until - time.monotonic())
            answers = await self._gather(request.right, payload, min(left, _ATTEMPT))
            if answers:
                return _value(answers[0])
            self.place.info()  # raises at once if the state folder says that the cluster is down
            if time.monotonic() >= until:
                raise ClusterFailed(f"the cluster at {self.place} does not answer")
            await asyncio.sleep(_AGAIN)

    def listen(self, key: str, hear: Callable[[bytes], None]) -> None:
        """Call ``hear`` on the loop with the payload of each message under ``key``, until the link is closed."""

        def pass_on(sample: zenoh.Sample) -> None:
            # On a thread of Zenoh's, which must not be blocked.
            self._call(hear, sample.payload.to_bytes())

        self._session.declare_subscriber(key, direct(pass_on))

    def watch(self, key: str, hear: Callable[[str, bool], None]) -> None:
        """Call ``hear`` on the loop with each liveliness token under ``key`` that appears (True) or vanishes (False).

        Tokens that are there already are reported as well.
        """

        def pass_on(sample: zenoh.Sample) -> None:
            self._call(hear, str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self._session.liveliness().declare_subscriber(key, direct(pass_on), history=True)

    async def close(self) -> None:
        """Disconnect from the cluster."""
        await asyncio.to_thread(self._session.close)

    async def _find(self, until: float) -> str:
        """Return the name of the cluster that answers.

        A cluster must be there by ``until``; once it is, its answer may take as long as that to any request.

        Raises:
            ClusterFailed: if none is there in time, or several are and none of them is the one that is meant.
        """
        question = encode(Status())
        while True:
            answers = await self._gather(Status.right, question, PATIENCE)  # at once if no coordinator is there
            names = sorted({str(_value(answer)["cluster"]) for answer in answers})
            if len(names) == 1:
                return names[0]
            if self.place.cluster in names:
                return self.place.cluster
            if names:
                raise ClusterFailed(f"more than one cluster answers at {self.place}: {', '.join(names)}")
            if time.monotonic() >= until - _AGAIN:
                raise ClusterFailed(_no_answer(self.place, str(self.place)))
            await asyncio.sleep(_AGAIN)

    def _check_right(self, request: Request) -> None:
        """Refuse what the router would drop without an answer.

        Raises:
            BadInput: if this client has not the right.
        """
        member = self._member
        if member is not None and request.right not in member.may:
            has = ", ".join(member.may) or "nothing"
            raise BadInput(f"{member.name} may {has}, but {request.name} needs the right to {request.right}")

    async def _gather(self, right: str, payload: bytes, seconds: float) -> list[bytes]:
        """Send one request and return all answers to it, none if nothing answers within ``seconds``.

        Raises:
            ClusterFailed: if the session is broken.
        """
        answers: list[bytes] = []
        over = self._loop.create_future()
        key = self.keys.requests(ANYONE if self._member is None else self._member.name, right)

        def hear(reply: zenoh.Reply) -> None:
            if reply.ok is not None:  # else an error of Zenoh's own, such as a timeout
                answers.append(reply.ok.payload.to_bytes())

        def end() -> None:
            self._call(_settle, over)

        try:
            self._session.get(key, direct(hear, end), payload=payload, timeout=seconds)
        except zenoh.ZError as error:
            raise ClusterFailed(f"the link to {self.place} is broken: {error}") from None
        await over
        return answers

    def _call(self, function: Callable[..., None], *arguments: Any) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed, so nothing waits for this any more
            self._loop.call_soon_threadsafe(function, *arguments)


def _check_keys(endpoint: str, identity: Identity | None) -> None:
    """Refuse keys that no router would accept.

    Raises:
        BadInput: if there are none, or they have expired.
    """
    if identity is None:
        raise BadInput(f"{endpoint}: expected keys too (--keys DIR), since the cluster asks who connects")
    expires = datetime.fromisoformat(identity.member.expires)
    if expires < datetime.now(UTC):
        raise BadInput(
            f"the keys in {identity.folder} expired on {expires:%Y-%m-%d}; `supernode keys renew` makes new ones"
        )


def _no_answer(place: Place, where: str) -> str:
    text = f"no cluster answers at {where}"
    if place.identity is None:
        return text
    return f"{text}, or it does not know the keys of {place.identity.member.name} in {place.identity.folder}"


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
