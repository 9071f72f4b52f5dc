"""Which host each node lives on, for a cluster whose nodes live in several places: what a wiring says of it."""

from collections.abc import Iterable
from dataclasses import dataclass

from wire.control import Wiring
from wire.hosts import Host

PORTS = 4  # that a node listens at in turn: the links of the last wiring are open when those of the next one are made


@dataclass
class _NodeHost:
    """Where one node lives, and the port that is next."""

    host: str
    endpoint: str
    turn: int


class NodeHosts:
    """Empty for a cluster on one host."""

    def __init__(self) -> None:
        self._node_hosts: dict[int, _NodeHost] = {}

    def move_in(self, host: Host, turn: int = 0) -> None:
        """The nodes of a host live there now; ``turn`` is the first of the ports that they use."""
        for place, node in enumerate(host.nodes):
            self._node_hosts[node] = _NodeHost(host.id, _endpoint(host.endpoint, place), turn)

    def leave(self, nodes: Iterable[int]) -> None:
        """They live nowhere any more."""
        for node in nodes:
            self._node_hosts.pop(node, None)

    def wiring(self, number: int, nodes: tuple[int, ...]) -> Wiring:
        """A wiring of these nodes, cell by cell."""
        places = [self._node_hosts.get(node) for node in nodes]
        if not any(places):
            return Wiring(number, nodes)
        hosts = tuple("" if each is None else each.host for each in places)
        if len(set(hosts)) == 1:  # each has links within the host only
            return Wiring(number, nodes, hosts)
        return Wiring(number, nodes, hosts, tuple("" if each is None else _next_endpoint(each) for each in places))


def _endpoint(first: str, place: int) -> str:
    """The first endpoint of the node at that place on its host."""
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
