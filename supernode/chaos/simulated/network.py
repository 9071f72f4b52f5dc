"""A simulated network in the manner of Zenoh: a router, sessions as its clients, and sessions linked directly.

A link carries messages in their order, each after a drawn time. It breaks when one of its ends dies: what that end had
sent arrives, what was sent to it is lost, the other end sees the tokens behind the link vanish, and questions asked
through it end unanswered. A session looks for its router, and a peer for the peers that it was told of, until they are
there.

What this leaves out of Zenoh: full queues that hold back a sender, and the layout of its messages.
"""

import itertools
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from supernode.chaos.simulated.world import Process, World

_FIRST_RETRY, _LAST_RETRY, _GROWTH = 0.01, 0.2, 1.5  # seconds and factor, as `wire.sessions` tells Zenoh
_NOTICED = 1e-3  # seconds, mean: from the end of a process until the other end of its links knows of it


@dataclass
class Weather:
    """What the network does wrong for now.

    Attributes:
        latency: mean seconds that a message takes on a link.
        lost: the share of published messages that are dropped, as Zenoh does when queues are full. Questions and
            answers are never dropped.
        twice: the share of messages between neighbours that arrive twice.
    """

    latency: float = 100e-6
    lost: float = 0.0
    twice: float = 0.0


@dataclass(frozen=True)
class Declare:
    """A station takes messages ("subscriber"), questions ("queryable"), or is there ("token") under a key."""

    kind: str
    key: str


@dataclass(frozen=True)
class Undeclare:
    """The opposite of `Declare`."""

    kind: str
    key: str


@dataclass(frozen=True)
class Put:
    """A published message."""

    key: str
    payload: bytes


@dataclass(frozen=True)
class Ask:
    """A question; the station that forwards it gives it a number of its own."""

    number: int
    key: str
    payload: bytes


@dataclass(frozen=True)
class Reply:
    """An answer to the question of that number."""

    number: int
    key: str
    payload: bytes


@dataclass(frozen=True)
class Final:
    """There will be no more answers to a question."""

    number: int


@dataclass(eq=False)
class Link:
    """One end's view of a link.

    Attributes:
        there: the station at the other end.
        back: the other end's view.
        declared: how often the other end has declared each thing.
        is_up: whether it carries messages.
    """

    here: "Station"
    there: "Station"
    back: "Link | None" = None
    declared: Counter[Declare] = field(default_factory=Counter)
    is_up: bool = True
    arrives: float = 0.0  # when the latest message of this direction arrives

    def matches(self, kind: str, key: str) -> bool:
        """Return whether the other end has declared something that matches a key."""
        return any(each.kind == kind and intersects(each.key, key) for each in self.declared)

    def forget(self, gone: Undeclare) -> bool:
        """Note that the other end has undeclared something; return whether it has declared nothing like it besides."""
        declared = Declare(gone.kind, gone.key)
        self.declared[declared] -= 1
        if self.declared[declared] > 0:
            return False
        del self.declared[declared]
        return True


class Station:
    """A router or a session: an end of links.

    Attributes:
        is_peer: whether it is a node's session with its neighbours.
    """

    def __init__(self, network: "Network", process: Process, *, is_peer: bool = False) -> None:
        self.network = network
        self.is_peer = is_peer
        self.process = process
        self.links: list[Link] = []
        self.is_open = True
        process.at_end.append(self.shut)
        network.add(self)

    def shut(self) -> None:
        """Break all links; the other ends notice soon."""
        self.is_open = False
        for link in self.links[:]:
            self.network.cut(link)

    def send(self, link: Link, message: Any) -> None:
        """Send a message over a link."""
        self.network.send(link, message)

    def linked(self, link: Link) -> None:
        """A link has come up."""
        raise NotImplementedError

    def unlinked(self, link: Link) -> None:
        """A link has gone."""
        raise NotImplementedError

    def receive(self, link: Link, message: Any) -> None:
        """Take a message. On the hub."""
        raise NotImplementedError


class Network:
    """The links of a world.

    Args:
        world: the world.
        fair: what goes wrong in fair weather.
        work: mean seconds that a node works for each message to its neighbours.

    Attributes:
        weather: what the network does wrong for now.
        listeners: the stations that listen, by endpoint.
        asked: called with the sealed command of each question that a coordinator sends.
        taken: called with the name of a process and an address at which it cannot listen, since another session does.
    """

    def __init__(self, world: World, fair: Weather, work: float) -> None:
        self.world = world
        self.weather = self._fair = fair
        self.work = work
        self.listeners: dict[str, Station] = {}
        self.numbers = itertools.count()
        self.asked: Callable[[bytes], None] = lambda _: None
        self.taken: Callable[[str, str], None] = lambda *_: None
        self._stations: list[Station] = []
        self._apart: dict[frozenset[str], float] = {}  # names of processes, until when they are cut off
        self._held: dict[tuple[str, str], float] = {}  # from and to whom, until when messages are held

    def change(self, weather: Weather, seconds: float) -> None:
        """Change the weather for a while."""
        self.weather = weather

        def calm() -> None:
            if self.weather is weather:  # else it has changed again meanwhile
                self.weather = self._fair

        self.world.at(self.world.now + seconds, calm)

    def part(self, one: str, other: str, seconds: float) -> None:
        """Cut all links between two processes, and let none come up for so long."""
        apart = frozenset((one, other))
        self._apart[apart] = max(self._apart.get(apart, 0.0), self.world.now + seconds)
        for station in self._stations:
            for link in station.links[:]:
                if {link.here.process.name, link.there.process.name} == apart and link.is_up:
                    self.cut(link)
                    if link.here.process.alive:
                        link.here.unlinked(link)

    def hold(self, one: str, other: str, seconds: float) -> None:
        """Let no message of a process arrive at another one for so long; afterwards all do, as TCP sends them again."""
        way = (one, other)
        self._held[way] = max(self._held.get(way, 0.0), self.world.now + seconds)

    def add(self, station: "Station") -> None:
        """Note a station."""
        self._stations = [each for each in self._stations if each.is_open]
        self._stations.append(station)

    def open_peers(self, process: Process) -> int:
        """Return how many stations of a process are open that are sessions with neighbours."""
        return sum(each.process is process and each.is_open and each.is_peer for each in self._stations)

    def _may_link(self, one: "Station", other: "Station") -> bool:
        names = frozenset((one.process.name, other.process.name))
        return self._apart.get(names, 0.0) <= self.world.now

    def send(self, link: Link, message: Any, twice: bool = False) -> None:
        """Let a message arrive at the other end of a link after a while, in the order of that link."""
        world, weather = self.world, self.weather
        if not link.is_up or not link.here.process.alive:
            return
        if isinstance(message, Put) and weather.lost and world.draw.random() < weather.lost:
            return
        if isinstance(message, Ask) and link.here.process.name == "coordinator":
            self.asked(message.payload)
        held = self._held.get((link.here.process.name, link.there.process.name), 0.0)
        link.arrives = max(link.arrives, held, world.now + world.draw.expovariate(1.0 / weather.latency))
        for _ in range(1 + (twice and world.draw.random() < weather.twice)):
            world.at(link.arrives, lambda: self._arrive(link, message))

    def _arrive(self, link: Link, message: Any) -> None:
        back = link.back
        if back is None or not back.is_up:
            return
        there = back.here
        if there.process.stopped_until > self.world.now:  # it reads when it goes on, in the same order
            self.world.at(there.process.stopped_until, lambda: self._arrive(link, message))
            return
        if there.process.alive:
            self.world.note(link.here.process.name, there.process.name, message)
            there.receive(back, message)

    def connect(self, one: Station, other: Station) -> None:
        """Link two stations."""
        here, there = Link(one, other), Link(other, one)
        here.back, there.back = there, here
        one.links.append(here)
        other.links.append(there)
        one.linked(here)
        other.linked(there)

    def cut(self, link: Link) -> None:
        """Break a link from one end; the other one notices after a while."""
        link.is_up = False
        if link in link.here.links:
            link.here.links.remove(link)
        back = link.back
        if back is None or not back.is_up:
            return
        notices = max(self.world.now + self.world.draw.expovariate(1.0 / _NOTICED), link.arrives)

        def notice() -> None:
            if back.is_up:
                back.is_up = False
                if back in back.here.links:
                    back.here.links.remove(back)
                if back.here.process.alive:
                    back.here.unlinked(back)

        self.world.at(notices, notice)

    def keep_connecting(self, station: Station, endpoint: str, pause: float = _FIRST_RETRY) -> None:
        """Link a station to the one that listens at an endpoint, as soon as there is one."""
        if not station.is_open or not station.process.alive:
            return
        listener = self.listeners.get(endpoint)
        is_there = listener is not None and listener.is_open and listener.process.alive
        if (
            listener is not None
            and is_there
            and listener.process.stopped_until <= self.world.now
            and self._may_link(station, listener)
        ):
            if not any(link.there is listener for link in station.links):
                self.connect(station, listener)
            return
        later = min(_LAST_RETRY, pause * _GROWTH)
        at = self.world.now + pause * self.world.draw.uniform(0.9, 1.1)
        self.world.at(at, lambda: self.keep_connecting(station, endpoint, later))


def intersects(one: str, other: str) -> bool:
    """Return whether two key expressions match a common key; ``*`` stands for one chunk."""
    if "*" not in one and "*" not in other:
        return one == other
    ones, others = one.split("/"), other.split("/")
    return len(ones) == len(others) and all(a == b or "*" in (a, b) for a, b in zip(ones, others, strict=True))
