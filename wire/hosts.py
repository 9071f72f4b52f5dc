"""The message by which nodes that the coordinator did not launch join a cluster, host by host.

A host is one start of a group of processes that share a folder of sockets: a container, or a machine. It holds a
liveliness token. The same message serves as the host's request to join, which the coordinator answers with the numbers
of the host's nodes, and as the host's answer to a coordinator that starts later and asks all hosts what they are.
"""

from dataclasses import dataclass, replace
from typing import Self

from wire.exchange_layout import VERSION
from wire.strict import Rejected, count, fields, of, pack, unpack

MOST_NODES = 4096  # on one host

_MOST_BYTES = 1 << 16


@dataclass(frozen=True)
class Host:
    """A host of nodes.

    Attributes:
        id: identifies this start of the host; each start has another id.
        name: the name shown to people. A host that joins again under its name gets its old node numbers back, so that
            jobs find their nodes.
        wants: the number of nodes on the host.
        endpoint: where the host's first node listens for nodes of other hosts, such as tcp/10.0.0.3:7450; "" if it does
            not.
        nodes: the numbers of its nodes; empty until the host has joined.
        leaving: whether it is about to end, and asks which of its nodes jobs still need.
        label: where the host is, from the largest unit to the smallest, such as ``block/rack``; "" if that is not
            known.
    """

    id: str
    name: str
    wants: int
    endpoint: str = ""
    nodes: tuple[int, ...] = ()
    label: str = ""
    leaving: bool = False

    def with_nodes(self, nodes: tuple[int, ...]) -> Self:
        """Return the host with its nodes' numbers, that is, joined; they may be fewer than it wanted."""
        return replace(self, nodes=nodes, wants=len(nodes))

    def encode(self) -> bytes:
        """Return the host as msgpack."""
        return pack([VERSION, self.id, self.name, self.wants, self.endpoint, self.nodes, self.label, self.leaving])

    @staticmethod
    def decode(payload: bytes) -> "Host":
        """Return the host in ``payload``, the inverse of `encode`.

        Raises:
            Rejected: if the payload is not a valid host, or has another number of nodes than the host wants.
        """
        version, name, *values = fields(unpack(payload, _MOST_BYTES), 8)
        if type(version) is not int or version != VERSION:
            raise Rejected("other version")
        shown, wants, endpoint, nodes, label, leaving = values
        numbers = tuple(count(node) for node in of(list, nodes))
        if len(numbers) not in (0, count(wants, MOST_NODES + 1)):
            raise Rejected("wrong shape")
        return Host(of(str, name), of(str, shown), wants, of(str, endpoint), numbers, of(str, label), of(bool, leaving))
