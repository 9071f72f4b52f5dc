"""A simulated router."""

from collections.abc import Iterable
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
)
from supernode.chaos.simulated.world import Process


class Router(Station):
    """The router of a cluster: it forwards what its clients publish, ask, answer and declare."""

    def __init__(self, network: Network, process: Process, endpoints: Iterable[str]) -> None:
        super().__init__(network, process)
        self._asked: dict[int, tuple[Link, int, set[Link]]] = {}  # by number here: asker, its number, who must answer
        for endpoint in endpoints:
            network.listeners[endpoint] = self

    def linked(self, link: Link) -> None:
        """Tell a new client which tokens there are."""
        for token in sorted({each.key for other in self.links for each in other.declared if each.kind == "token"}):
            self.send(link, Declare("token", token))

    def unlinked(self, link: Link) -> None:
        """Drop what a client had declared, and the questions that it had to answer."""
        for token in sorted(each.key for each in link.declared if each.kind == "token"):
            self._tell_gone(link, token)
        link.declared.clear()
        for number in [number for number, (_, _, waits) in self._asked.items() if link in waits]:
            self._finish(number, link)

    def receive(self, link: Link, message: Any) -> None:
        """Forward a message."""
        match message:
            case Declare(kind, key):
                if kind == "token" and not self._is_known(key):
                    self._forward(link, message)
                link.declared[message] += 1
            case Undeclare():
                self._undeclare(link, message)
            case Put(key):
                for other in self.links:
                    if other is not link and other.matches("subscriber", key):
                        self.send(other, message)
            case Ask(number, key, payload):
                self._ask(link, number, key, payload)
            case Reply(number, key, payload):
                if number in self._asked:
                    asker, its_number, _ = self._asked[number]
                    self.send(asker, Reply(its_number, key, payload))
            case Final(number):
                self._finish(number, link)

    def _undeclare(self, link: Link, message: Undeclare) -> None:
        if link.forget(message) and message.kind == "token":
            self._tell_gone(link, message.key)

    def _ask(self, link: Link, number: int, key: str, payload: bytes) -> None:
        """Pass a question on to all who have declared that they take it."""
        here = next(self.network.numbers)
        others = [each for each in self.links if each is not link and each.matches("queryable", key)]
        self._asked[here] = (link, number, set(others))
        for other in others:
            self.send(other, Ask(here, key, payload))
        if not others:
            self._finish(here, None)

    def _is_known(self, token: str) -> bool:
        return any(Declare("token", token) in link.declared for link in self.links)

    def _tell_gone(self, link: Link, token: str) -> None:
        """Tell the others that a token has gone, unless another client has one like it."""
        if not any(Declare("token", token) in other.declared for other in self.links if other is not link):
            self._forward(link, Undeclare("token", token))

    def _forward(self, link: Link, message: Any) -> None:
        for other in self.links:
            if other is not link:
                self.send(other, message)

    def _finish(self, number: int, link: Link | None) -> None:
        if number not in self._asked:
            return
        asker, its_number, waits = self._asked[number]
        if link is not None:
            waits.discard(link)
        if not waits:
            del self._asked[number]
            self.send(asker, Final(its_number))
