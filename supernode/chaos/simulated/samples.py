"""Stand-ins for what `zenoh` hands out: samples, answers, queries, publishers and declarations."""

from collections.abc import Callable
from typing import Any, Protocol, Self

from supernode.chaos.simulated.network import Ask, Final, Link, Reply

SEND = 20e-6
"""Seconds that sending takes."""


class Session(Protocol):
    """What these need of the session that they belong to."""

    def spend(self, seconds: float) -> None:
        """Let the calling task work for a while."""

    def send(self, link: Link, message: Any) -> None:
        """Send a message over a link."""

    def put(self, key: str, payload: bytes) -> None:
        """Publish a message."""

    def undeclare(self, declared: "Declared") -> None:
        """End a declaration."""


class ZError(Exception):
    """Instead of `zenoh.ZError`."""


class SampleKind:
    """Instead of `zenoh.SampleKind`."""

    PUT = "put"
    DELETE = "delete"


class Bytes:
    """Instead of `zenoh.ZBytes`."""

    def __init__(self, payload: bytes) -> None:
        self._payload = payload

    def to_bytes(self) -> bytes:
        """Return the bytes."""
        return self._payload

    def __len__(self) -> int:
        return len(self._payload)


class Sample:
    """Instead of `zenoh.Sample`."""

    def __init__(self, key: str, payload: bytes, kind: str = SampleKind.PUT) -> None:
        self.key_expr = key
        self.payload = Bytes(payload)
        self.kind = kind


class Answer:
    """Instead of `zenoh.Reply`; ``ok`` is None for an error, such as a timeout."""

    def __init__(self, ok: Sample | None) -> None:
        self.ok = ok
        self.err = None if ok is not None else "timeout"


class Callback:
    """Instead of `zenoh.handlers.Callback`."""

    def __init__(
        self, function: Callable[[Any], None], end: Callable[[], None] | None = None, indirect: bool = True
    ) -> None:
        self.call = function
        self.end = end or (lambda: None)


class Query:
    """Instead of `zenoh.Query`: a question that this process is to answer."""

    def __init__(self, session: Session, link: Link, ask: Ask) -> None:
        self.key_expr = ask.key
        self.payload = Bytes(ask.payload)
        self._session = session
        self._link = link
        self._number = ask.number
        self._is_over = False

    def reply(self, key: str, payload: bytes) -> None:
        """Send an answer."""
        if self._is_over:
            raise ZError("the query is finalized")
        self._session.spend(SEND)
        self._session.send(self._link, Reply(self._number, key, bytes(payload)))

    def drop(self) -> None:
        """End the question."""
        if not self._is_over:
            self._is_over = True
            self._session.send(self._link, Final(self._number))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.drop()

    def __del__(self) -> None:
        self.drop()


class Declared:
    """Something that a session has declared; `undeclare` ends it."""

    def __init__(self, session: Session, kind: str, key: str, call: Callable[[Any], None] | None) -> None:
        self.kind = kind
        self.key = key
        self.call = call or _ignore
        self.heard: set[str] = set()  # tokens that it was told of
        self._session = session

    def undeclare(self) -> None:
        """End the declaration."""
        self._session.undeclare(self)


class Publisher:
    """Instead of `zenoh.Publisher`."""

    def __init__(self, session: Session, key: str) -> None:
        self._session = session
        self._key = key
        self._is_gone = False

    def put(self, payload: bytes) -> None:
        """Publish a message."""
        if self._is_gone:
            raise ZError("the publisher is undeclared")
        self._session.put(self._key, payload)

    def undeclare(self) -> None:
        """End the declaration; publishing fails from now on."""
        self._is_gone = True


def _ignore(_: object) -> None:
    """Do nothing: nobody is told of what comes under a token."""
