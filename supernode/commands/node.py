"""Join nodes of this machine, or of this container, to a cluster; they stay until the command ends."""

import argparse

from supernode import exits
from supernode.commands.cluster_options import add_force
from supernode.commands.role_options import (
    add_membership,
    add_option,
    add_trust,
    cluster_of,
    endpoint,
    endpoint_of,
    modules_of,
    number_of,
    prepare_process,
    secret_of,
)

_FAR_AWAY, _ANY_PORT = "198.51.100.1", 9  # of a network that is for documentation only (RFC 5737)

EXAMPLE = "supernode node --connect tcp/192.168.1.7:7447 --nodes 4"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which cluster, how many, and where they can be reached."""
    add_membership(parser)
    add_option(parser, "nodes", "how many", metavar="N")
    add_option(parser, "host", "this host's name; under it it gets its nodes back (the machine's, and a process id)")
    add_option(
        parser,
        "listen",
        "be reachable for nodes of other hosts, at four ports for each node from this one on, such as"
        " tcp/192.168.1.8:7450; 0.0.0.0 stands for this machine's own address (links between hosts by the router)",
        metavar="ENDPOINT",
    )
    add_trust(parser)
    add_force(parser)


def run(options: argparse.Namespace) -> int:
    """Join, and stay until a signal."""
    import os
    import secrets
    import socket

    router, cluster, nodes = endpoint_of(options), cluster_of(options), number_of(options, "nodes")
    listen = own_endpoint(endpoint(options.listen, "listen"), router) if options.listen else ""
    secret = secret_of(options)
    prepare_process()
    from coordinator.host import HostZygote
    from wire.hosts import Host

    name = options.host or f"{socket.gethostname()}-{os.getpid()}"
    host = Host(secrets.token_hex(4), name, nodes, listen)
    HostZygote(cluster, router, secret, modules_of(options), host, force=options.force).run()
    return exits.OK


def own_endpoint(listen: str, router: str) -> str:
    """An endpoint that others can connect to; a container does not know its address when it is configured.

    Args:
        listen: what was asked for; 0.0.0.0 stands for an own address.
        router: the endpoint of the router, which others reach too.

    Raises:
        BadInput: if it has no address and port.
    """
    import re

    from problems.errors import BadInput

    found = re.fullmatch(r"tcp/(.+):([1-9]\d{0,4})", listen)
    if found is None:
        raise BadInput(f"--listen: expected tcp/ADDRESS:PORT, found {listen}")
    address, port = found.groups()
    return f"tcp/{own_address(router) if address == '0.0.0.0' else address}:{port}"


def own_address(router: str) -> str:
    """The address from which this machine speaks to the router; if that is on this machine, to anybody far away.

    A machine's name is of no use: on many it stands for a loopback address. Nothing is sent.
    """
    import contextlib
    import re
    import socket

    found = re.fullmatch(r"\w+/(.+):\d+", router)
    for host in ([] if found is None else [found[1]]) + [_FAR_AWAY]:
        with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((host, _ANY_PORT))
            address = str(probe.getsockname()[0])
            if not address.startswith("127."):
                return address
    return "127.0.0.1"  # it is alone
