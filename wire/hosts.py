"""How nodes that were not launched with the coordinator join a cluster: host by host, each asking for numbers.

A host is one start of processes that share a folder of sockets: a container, or a machine. It holds a liveliness token,
and answers whoever asks with what it is; with the same words it asks to join, and is answered with its nodes' numbers.
"""

from dataclasses import dataclass, replace
from typing import Self

from wire.exchange import VERSION
from wire.strict import Rejected, count, fields, of, pack, unpack

MOST_NODES = 4096  # on one host

_MOST_BYTES = 1 << 16


@dataclass(frozen=True)
class Host:
    """A host of nodes.

    Attributes:
        id: of this start of it; another start has another.
        name: for people. A host that comes again under its name gets its old numbers, so jobs find their nodes.
        wants: how many nodes it holds.
        endpoint: where its first node listens to nodes on other hosts, such as tcp/10.0.0.3:7450; "": nowhere.
        nodes: their numbers; empty as long as it has none.
    """

    id: str
    name: str
    wants: int
    endpoint: str = ""
    nodes: tuple[int, ...] = ()

    def with_nodes(self, nodes: tuple[int, ...]) -> Self:
        """The same, joined."""
        return replace(self, nodes=nodes)

    def encode(self) -> bytes:
        """As msgpack."""
        return pack([VERSION, self.id, self.name, self.wants, self.endpoint, self.nodes])

    @staticmethod
    def decode(payload: bytes) -> "Host":
        """The inverse of `encode`.

        Raises:
            Rejected: whatever is wrong with it.
        """
        version, name, *values = fields(unpack(payload, _MOST_BYTES), 6)
        if type(version) is not int or version != VERSION:
            raise Rejected("other version")
        shown, wants, endpoint, nodes = values
        numbers = tuple(count(node) for node in of(list, nodes))
        if len(numbers) not in (0, count(wants, MOST_NODES + 1)):
            raise Rejected("wrong shape")
        return Host(of(str, name), of(str, shown), wants, of(str, endpoint), numbers)
