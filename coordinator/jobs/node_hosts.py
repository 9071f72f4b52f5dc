"""The host and the network address of each node, for the wirings of a cluster on several machines or containers."""

from collections.abc import Iterable
from dataclasses import dataclass

from wire.control import Wiring
from wire.hosts import Host

PORTS = 4  # that a node uses in turn: the links of the old wiring are still open when those of the new one are made


@dataclass
class _NodeHost:
    """The host of one node.

    Attributes:
        host: the host's id.
        place: where the host is: its label, and its name.
        endpoint: the endpoint of the node's first port; "" if it does not listen.
        turn: the turn of the node's ports.
    """

    host: str
    place: str
    endpoint: str
    turn: int


class NodeHosts:
    """The hosts of all nodes; empty for a cluster that one zygote launched. Not thread-safe."""

    def __init__(self) -> None:
        self._node_hosts: dict[int, _NodeHost] = {}

    def move_in(self, host: Host, turn: int = 0) -> None:
        """Note the nodes of a host; ``turn`` is the first of the ports that they use."""
        where = "/".join(part for part in (host.label, host.name) if part)
        for place, node in enumerate(host.nodes):
            self._node_hosts[node] = _NodeHost(host.id, where, _endpoint(host.endpoint, place), turn)

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

    def wiring(self, number: int, nodes: tuple[int, ...]) -> Wiring:
        """Return the wiring of these nodes, in the order of the cells; if on different hosts, they get new ports."""
        hosts, places = self.hosts_of(nodes), [self._node_hosts.get(node) for node in nodes]
        if len(set(hosts)) <= 1:  # all links are within one host, over Unix sockets, so nobody listens at a port
            return Wiring(number, nodes, hosts)
        return Wiring(number, nodes, hosts, tuple("" if each is None else _next_endpoint(each) for each in places))


def _endpoint(first: str, place: int) -> str:
    """Return the endpoint of the first port of the node at position ``place`` of a host, whose own is ``first``."""
    if not first:
        return ""
    address, _, port = first.rpartition(":")
    return f"{address}:{int(port) + PORTS * place}"


def _next_endpoint(host: _NodeHost) -> str:
    if not host.endpoint:
        return ""
    host.turn = (host.turn + 1) % PORTS
    address, _, port = host.endpoint.rpartition(":")
    return f"{address}:{int(port) + host.turn}"
