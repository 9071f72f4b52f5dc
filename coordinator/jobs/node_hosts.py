"""The host and the network address of each node, for the wirings of a cluster on several machines or containers."""

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from wire.control import Wiring
from wire.hosts import Host

PORTS = 4  # that a node uses in turn: the links of old wirings are still open when those of a new one are made


@dataclass
class _NodeHost:
    """The host of one node.

    Attributes:
        host: the host's id.
        place: where the host is: its label, and its name.
        endpoint: the endpoint of the node's first port; "" if it does not listen.
    """

    host: str
    place: str
    endpoint: str


class NodeHosts:
    """The hosts of all nodes; empty for a cluster that one zygote launched. Not thread-safe."""

    def __init__(self) -> None:
        self._node_hosts: dict[int, _NodeHost] = {}
        # By node, also if it is gone: the wirings of its latest two epochs, those that it told, and those made for it.
        self._begun: dict[int, tuple[int, ...]] = {}
        self._told: dict[int, tuple[int, ...]] = {}
        self._made: dict[int, tuple[int, ...]] = {}

    def move_in(self, host: Host) -> None:
        """Note the nodes of a host."""
        where = "/".join(part for part in (host.label, host.name) if part)
        for place, node in enumerate(host.nodes):
            self._node_hosts[node] = _NodeHost(host.id, where, _endpoint(host.endpoint, place))

    def place_of(self, node: int) -> str:
        """Return where a node's host is, such as ``block/rack/host``; "" if no host has joined with it."""
        known = self._node_hosts.get(node)
        return "" if known is None else known.place

    def leave(self, nodes: Iterable[int]) -> None:
        """Forget nodes that are gone."""
        for node in nodes:
            self._node_hosts.pop(node, None)

    def hosts_of(self, nodes: tuple[int, ...]) -> tuple[str, ...]:
        """Return the host of each of these nodes; empty if one zygote launched them all."""
        places = [self._node_hosts.get(node) for node in nodes]
        return tuple("" if each is None else each.host for each in places) if any(places) else ()

    def number(self, numbers: Iterator[int], nodes: tuple[int, ...]) -> int:
        """Return the next of these numbers for a wiring of these nodes.

        The number decides at which port each node listens. At the port of an old wiring its old links may be open
        still, also if the node was given up and is back: a neighbour that dials it would take them for the new ones.
        Links of a wiring with which no epoch has begun are closed only when the next one is prepared. So, of the ports
        that are free otherwise, the one that was used longest ago is taken.
        """
        ahead = list(itertools.islice(numbers, PORTS))
        taken = Counter(each % PORTS for node in nodes for each in self._open_of(node))
        latest = {each % PORTS: each for each in sorted(each for node in nodes for each in self._made.get(node, ()))}
        number = min(ahead, key=lambda number: (taken[number % PORTS], latest.get(number % PORTS, -1)))
        for node in nodes:
            self._made[node] = (*self._made.get(node, ()), number)[-PORTS:]
        return number

    def _open_of(self, node: int) -> set[int]:
        return {*self._begun.get(node, ()), *self._told.get(node, ())}

    def begun(self, number: int, nodes: tuple[int, ...]) -> None:
        """Note that an epoch begins with a wiring. A node closes the links of one that was given up by itself."""
        for node in nodes:
            before = self._begun.get(node, ())
            if number not in before[-1:]:
                self._begun[node] = (*before, number)[-2:]
                self._told.pop(node, None)

    def open_links(self, node: int, wirings: Iterable[int]) -> None:
        """Note the wirings whose links a node has, the latest last, as the node tells it."""
        self._told[node] = tuple(wirings)

    def taken_over(self, number: int, nodes: tuple[int, ...]) -> Wiring:
        """Return the wiring with which an epoch has begun under the previous coordinator."""
        self.begun(number, nodes)
        return self.wiring(number, nodes)

    def wiring(self, number: int, nodes: tuple[int, ...]) -> Wiring:
        """Return the wiring of that number and of these nodes, in the order of the cells."""
        hosts, places = self.hosts_of(nodes), [self._node_hosts.get(node) for node in nodes]
        if len(set(hosts)) <= 1:  # all links are within one host, over Unix sockets, so nobody listens at a port
            return Wiring(number, nodes, hosts)
        turn = number % PORTS
        return Wiring(
            number, nodes, hosts, tuple("" if each is None else _next_port(each.endpoint, turn) for each in places)
        )


def _endpoint(first: str, place: int) -> str:
    """Return the endpoint of the first port of the node at position ``place`` of a host, whose own is ``first``."""
    return _next_port(first, PORTS * place)


def _next_port(endpoint: str, further: int) -> str:
    """Return the endpoint that is so many ports further; "" if there is none."""
    if not endpoint:
        return ""
    address, _, port = endpoint.rpartition(":")
    return f"{address}:{int(port) + further}"
