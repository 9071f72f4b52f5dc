"""Change the links of a network namespace of Linux through rtnetlink(7), which needs no program such as ip."""

import os
import socket
import struct
from typing import Self

_NEW_LINK, _SET_LINK, _NEW_ADDRESS, _ERROR = 16, 19, 20, 2  # RTM_NEWLINK, _SETLINK and _NEWADDR; NLMSG_ERROR
_REQUEST, _ANSWER, _MAKE = 0x1, 0x4, 0x600  # NLM_F_REQUEST, _ACK, and _CREATE with _EXCL
_HEADER, _LINK, _ADDRESS, _ATTRIBUTE, _INDEX = "=IHHII", "=BxHiII", "=BBBBI", "=HH", "=I"
_NAME, _MASTER, _INFO, _NAMESPACE = 3, 10, 18, 28  # IFLA_IFNAME, _MASTER, _LINKINFO and _NET_NS_FD
_PORT = 12 | 0x8000  # IFLA_PROTINFO with NLA_F_NESTED: else its value would be the state itself
_KIND, _DATA, _PEER, _STATE = 1, 2, 1, 1  # IFLA_INFO_KIND, IFLA_INFO_DATA, VETH_INFO_PEER, IFLA_BRPORT_STATE
_LOCAL, _OTHER = 2, 1  # IFA_LOCAL, IFA_ADDRESS
_UP = 1  # IFF_UP
_DISABLED, _FORWARDING = 0, 3  # BR_STATE_DISABLED, BR_STATE_FORWARDING
_LONGEST = 1 << 16  # bytes of an answer


class Netlink:
    """Speaks for the network namespace of the thread that makes this; a context manager.

    All methods raise `OSError` if the kernel refuses.
    """

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def add_bridge(self, name: str) -> None:
        """Make a bridge, and set it up."""
        self._make(_text(_NAME, name) + _attribute(_INFO, _text(_KIND, "bridge")))
        self.set_up(name)

    def add_cable(self, port: str, bridge: str, there: int, end: str) -> None:
        """Make a cable from a port of a bridge to another namespace, and set the port up.

        Args:
            port: the name of the end at the bridge.
            bridge: the bridge.
            there: a descriptor of the other namespace.
            end: the name of the end there.
        """
        away = _text(_NAME, end) + _number(_NAMESPACE, there)
        peer = _attribute(_PEER, _link(0) + away)
        master = _number(_MASTER, socket.if_nametoindex(bridge))
        kind = _text(_KIND, "veth") + _attribute(_DATA, peer)
        self._make(_text(_NAME, port) + master + _attribute(_INFO, kind))
        self.set_up(port)

    def add_address(self, name: str, address: str, prefix: int) -> None:
        """Give an interface an IPv4 address, in a network of so many bits."""
        packed = socket.inet_aton(address)
        head = struct.pack(_ADDRESS, socket.AF_INET, prefix, 0, 0, socket.if_nametoindex(name))
        body = head + _attribute(_LOCAL, packed) + _attribute(_OTHER, packed)
        self._ask(_NEW_ADDRESS, _MAKE, body)

    def set_up(self, name: str) -> None:
        """Let an interface send and receive."""
        self._ask(_NEW_LINK, 0, _link(socket.if_nametoindex(name), flags=_UP))

    def forward(self, port: str, *, on: bool) -> None:
        """Let a bridge pass on what comes and goes by a port, or drop all that silently."""
        state = _attribute(_STATE, bytes([_FORWARDING if on else _DISABLED]))
        self._ask(_SET_LINK, 0, _link(socket.if_nametoindex(port), socket.AF_BRIDGE) + _attribute(_PORT, state))

    def _make(self, attributes: bytes) -> None:
        self._ask(_NEW_LINK, _MAKE, _link(0) + attributes)

    def _ask(self, kind: int, flags: int, body: bytes) -> None:
        size = struct.calcsize(_HEADER)
        self._socket.send(struct.pack(_HEADER, size + len(body), kind, _REQUEST | _ANSWER | flags, 1, 0) + body)
        answer = self._socket.recv(_LONGEST)
        assert struct.unpack_from(_HEADER, answer)[1] == _ERROR, "that is the only answer to a change"
        (error,) = struct.unpack_from("=i", answer, size)
        if error:
            raise OSError(-error, os.strerror(-error))


def _link(index: int, family: int = socket.AF_UNSPEC, flags: int = 0) -> bytes:
    return struct.pack(_LINK, family, 0, index, flags, flags)


def _attribute(kind: int, value: bytes) -> bytes:
    size = struct.calcsize(_ATTRIBUTE) + len(value)
    return struct.pack(_ATTRIBUTE, size, kind) + value + bytes(-size % 4)


def _text(kind: int, value: str) -> bytes:
    return _attribute(kind, value.encode() + b"\0")


def _number(kind: int, value: int) -> bytes:
    return _attribute(kind, struct.pack(_INDEX, value))
