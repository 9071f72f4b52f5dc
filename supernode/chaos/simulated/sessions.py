"""Stand-ins for Zenoh's sessions, on the simulated network."""

import types
from collections.abc import Callable, Iterator
from typing import Any

from supernode.chaos.simulated.network import (
    Ask,
    Declare,
    Final,
    Link,
    Network,
    Put,
    Reply,
    Station,
    Undeclare,
    intersects,
)
from supernode.chaos.simulated.samples import (
    SEND,
    Answer,
    Callback,
    Declared,
    Publisher,
    Query,
    Sample,
    SampleKind,
    ZError,
)
from supernode.chaos.simulated.thread_types import SimpleQueue
from supernode.chaos.simulated.world import Process, World

DECLARE = 50e-6
"""Seconds that a declaration takes."""

_TOLD_AGAIN = 0.02
"""The share of questions for tokens that repeat them to the watchers of the same session; Zenoh does so under load."""


class _Asked:
    """A question of this session that is not over."""

    def __init__(self, handler: Callback, links: set[Link | None]) -> None:
        self.handler = handler
        self.links = links


class _Liveliness:
    def __init__(self, session: "Session") -> None:
        self._session = session

    def declare_token(self, key: str) -> Declared:
        return self._session.declare("token", key)

    def declare_subscriber(self, key: str, handler: Callback, history: bool = False) -> Declared:
        return self._session.watch(key, handler, history)

    def get(self, key: str) -> Iterator[Answer]:
        if self._session.world.draw.random() < _TOLD_AGAIN:
            self._session.tell_again(key)
        self._session.spend(DECLARE)
        return iter([Answer(Sample(token, b"")) for token in self._session.tokens() if intersects(key, token)])


class Session(Station):
    """Instead of `zenoh.Session`; its callbacks run one after another, on a task of its own, in order of arrival."""

    def __init__(
        self, network: Network, process: Process, listen: list[str], connect: list[str], *, is_peer: bool = False
    ) -> None:
        super().__init__(network, process, is_peer=is_peer)
        self._declared: list[Declared] = []
        self._watchers: list[Declared] = []
        self._asked: dict[int, _Asked] = {}
        self._news = SimpleQueue(network.world)
        self._endpoints = connect
        self.info = types.SimpleNamespace(routers_zid=lambda: [link.there for link in self.links])
        for endpoint in listen:
            before = network.listeners.get(endpoint)
            if before is not None and before.is_open and before.process.alive:
                self.shut()
                network.taken(process.name, endpoint)
                raise ZError(f"{endpoint}: address already in use")
            network.listeners[endpoint] = self
        process.start(self._work, "network")
        for endpoint in connect:
            network.keep_connecting(self, endpoint)

    @property
    def world(self) -> World:
        """The world of the session's process."""
        return self.network.world

    def spend(self, seconds: float) -> None:
        """Let the calling task work for a while."""
        if self.world.process is self.process:
            self.world.spend(seconds)

    def _work(self) -> None:
        """Call back, for as long as the session is open."""
        while (call := self._news.get()) is not None:
            call()

    # What the production code calls -----------------------------------------------------------------------------------
    def declare_subscriber(self, key: str, handler: Callback) -> Declared:
        """Receive what is published under a key."""
        return self.declare("subscriber", key, handler.call)

    def declare_queryable(self, key: str, handler: Callback) -> Declared:
        """Take questions under a key."""
        return self.declare("queryable", key, handler.call)

    def declare_publisher(self, key: str) -> Publisher:
        """Return what publishes under a key."""
        return Publisher(self, key)

    def liveliness(self) -> _Liveliness:
        """Return what declares tokens and watches them."""
        return _Liveliness(self)

    def put(self, key: str, payload: bytes) -> None:
        """Publish a message."""
        if not self.is_open:
            raise ZError("the session is closed")
        message = Put(key, bytes(payload))
        for link in self.links[:]:
            if not self.is_peer or link.matches("subscriber", key):
                self.network.send(link, message, twice=self.is_peer)
        self.spend(self.network.work if self.is_peer else SEND)

    def get(
        self,
        key: str,
        handler: Callback | None = None,
        *,
        payload: bytes = b"",
        timeout: float = 10.0,
        target: object = None,
        consolidation: object = None,
        priority: object = None,
    ) -> Any:
        """Ask a question; without a handler return an iterator over the answers."""
        if not self.is_open:
            raise ZError("the session is closed")
        if handler is None:
            answers = SimpleQueue(self.world)
            self.get(key, Callback(answers.put, lambda: answers.put(None)), payload=payload, timeout=timeout)
            return iter(answers.get, None)
        number = next(self.network.numbers)
        links: set[Link | None] = set(self.links)
        self._asked[number] = _Asked(handler, links)
        for link in self.links[:]:
            self.send(link, Ask(number, key, bytes(payload)))
        if not links:
            self._finish(number, None)
        self.world.at(self.world.now + timeout, lambda: self._time_is_over(number))
        self.spend(SEND)
        return None

    def close(self) -> None:
        """Close the session."""
        if self.is_open:
            self.shut()
            for number in list(self._asked):
                self._end(number)
            self._news.put(None)

    # Declarations -----------------------------------------------------------------------------------------------------
    def declare(self, kind: str, key: str, call: Callable[[Any], None] | None = None) -> Declared:
        """Declare something, and tell the other ends of all links."""
        if not self.is_open:
            raise ZError("the session is closed")
        declared = Declared(self, kind, key, call)
        self._declared.append(declared)
        for link in self.links[:]:
            self.send(link, Declare(kind, key))
        if kind == "token":
            self._see(key, is_there=True)
        self.spend(DECLARE)
        return declared

    def watch(self, key: str, handler: Callback, history: bool) -> Declared:
        """Call ``handler`` with the tokens under a key that come and go."""
        watcher = Declared(self, "watcher", key, handler.call)
        self._watchers.append(watcher)
        if history:
            for token in self.tokens():
                self._tell(watcher, token, is_there=True)
        self.spend(DECLARE)
        return watcher

    def undeclare(self, declared: Declared) -> None:
        """End a declaration."""
        if declared in self._watchers:
            self._watchers.remove(declared)
        elif declared in self._declared:
            self._declared.remove(declared)
            for link in self.links[:]:
                self.send(link, Undeclare(declared.kind, declared.key))
        self.spend(DECLARE)

    def tokens(self) -> list[str]:
        """Return the tokens that this session sees, its own too."""
        own = {each.key for each in self._declared if each.kind == "token"}
        return sorted(own.union(each.key for link in self.links for each in link.declared if each.kind == "token"))

    def tell_again(self, key: str) -> None:
        """Tell the watchers once more of the tokens under a key that they have heard of and that are still there."""
        for watcher in self._watchers:
            for token in sorted(watcher.heard.intersection(self.tokens())):
                if intersects(key, token):
                    self._call_back(watcher.call, Sample(token, b""), watcher)

    def _see(self, token: str, is_there: bool) -> None:
        for watcher in self._watchers[:]:
            self._tell(watcher, token, is_there)

    def _tell(self, watcher: Declared, token: str, is_there: bool) -> None:
        if not intersects(watcher.key, token) or (token in watcher.heard) == is_there:
            return
        (watcher.heard.add if is_there else watcher.heard.discard)(token)
        self._call_back(watcher.call, Sample(token, b"", SampleKind.PUT if is_there else SampleKind.DELETE), watcher)

    # What the network calls, on the hub -------------------------------------------------------------------------------
    def linked(self, link: Link) -> None:
        """Tell the other end what this session has declared."""
        for declared in self._declared:
            self.send(link, Declare(declared.kind, declared.key))

    def unlinked(self, link: Link) -> None:
        """See the tokens behind the link vanish, end questions, and look for the other end again."""
        gone = sorted(each.key for each in link.declared if each.kind == "token")
        link.declared.clear()
        still = set(self.tokens())
        for token in gone:
            if token not in still:
                self._see(token, is_there=False)
        for number in [number for number, asked in self._asked.items() if link in asked.links]:
            self._finish(number, link)
        for endpoint in self._endpoints:
            self.network.keep_connecting(self, endpoint)

    def receive(self, link: Link, message: Any) -> None:
        """Take a message."""
        match message:
            case Declare(kind, key):
                link.declared[message] += 1
                if kind == "token":
                    self._see(key, is_there=True)
            case Undeclare(kind, key):
                if link.forget(message) and kind == "token" and key not in self.tokens():
                    self._see(key, is_there=False)
            case Put(key, payload):
                for taker in self._takers("subscriber", key):
                    self._call_back(taker.call, Sample(key, payload), taker)
            case Ask(_, key):
                query = Query(self, link, message)  # ends, if nobody takes it, when it is forgotten
                for taker in self._takers("queryable", key):
                    self._call_back(taker.call, query, taker)
            case Reply(number, key, payload):
                if number in self._asked:
                    self._call_back(self._asked[number].handler.call, Answer(Sample(key, payload)), None)
            case Final(number):
                self._finish(number, link)

    def _takers(self, kind: str, key: str) -> list[Declared]:
        return [each for each in self._declared if each.kind == kind and intersects(each.key, key)]

    def _call_back(self, call: Callable[[Any], None], argument: Any, declared: Declared | None) -> None:
        """Queue a callback, unless what it belongs to has been undeclared by then."""

        def run() -> None:
            if declared is None or declared in self._declared or declared in self._watchers:
                call(argument)

        self._news.put(run)

    def _finish(self, number: int, link: Link | None) -> None:
        asked = self._asked.get(number)
        if asked is not None:
            asked.links.discard(link)
            if not asked.links:
                self._end(number)

    def _time_is_over(self, number: int) -> None:
        if number in self._asked and self.process.alive:
            self._call_back(self._asked[number].handler.call, Answer(None), None)
            self._end(number)

    def _end(self, number: int) -> None:
        handler = self._asked.pop(number).handler
        self._news.put(handler.end)
