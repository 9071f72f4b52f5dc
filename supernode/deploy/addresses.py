"""The address of this machine by which others reach it."""

import contextlib
import random
import re
import socket

from problems.errors import BadInput

_FAR_AWAY, _ANY_PORT = "198.51.100.1", 9  # an address reserved for documentation (RFC 5737): nothing answers there
FIRST_PORT, MOST_PORTS = 20000, 12000  # Linux gives those above to whoever asks for any port
_PORTS = range(FIRST_PORT, FIRST_PORT + MOST_PORTS - 1000, 100)
_TRIES = 100


def own_endpoint(listen: str, router: str) -> str:
    """Return the endpoint of this host that others can connect to.

    Args:
        listen: the endpoint asked for. 0.0.0.0 stands for this host's own address, which a container does not know when
            it is configured.
        router: the endpoint of the router, which the other hosts reach too.

    Raises:
        BadInput: if ``listen`` has no address and port.
    """
    found = re.fullmatch(r"(tcp|tls)/(.+):([1-9]\d{0,4})", listen)
    if found is None:
        raise BadInput(f"--listen: expected tls/ADDRESS:PORT or tcp/ADDRESS:PORT, found {listen}")
    protocol, address, port = found.groups()
    return f"{protocol}/{own_address(router) if address == '0.0.0.0' else address}:{port}"


def own_address(router: str) -> str:
    """Return the address from which this machine reaches the router; if that is a loopback address, a far-away one.

    The machine's name would not do: on many machines it resolves to a loopback address. Connecting a UDP socket only
    chooses a route; nothing is sent.
    """
    found = re.fullmatch(r"\w+/(.+):\d+", router)
    for host in ([] if found is None else [found[1]]) + [_FAR_AWAY]:
        with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((host, _ANY_PORT))
            address = str(probe.getsockname()[0])
            if not address.startswith("127."):
                return address
    return "127.0.0.1"  # this machine has no network


def free_port() -> int:
    """Return a port that nobody uses now. It is drawn, so that those above it are probably free too.

    Raises:
        BadInput: if there is none.
    """
    for _ in range(_TRIES):
        port = random.choice(_PORTS)
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(("", port))
            return port
    raise BadInput(f"expected a free port from {_PORTS[0]} on, found none")
