"""Join nodes of this machine, or of this container, to a cluster; they stay until the command ends."""

import argparse

from supernode import exits
from supernode.commands.role_options import (
    add_membership,
    add_option,
    cluster_of,
    endpoint,
    endpoint_of,
    number_of,
    prepare_process,
)

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


def run(options: argparse.Namespace) -> int:
    """Join, and stay until a signal."""
    import os
    import secrets
    import socket

    router, cluster, nodes = endpoint_of(options), cluster_of(options), number_of(options, "nodes")
    listen = own_endpoint(endpoint(options.listen, "listen")) if options.listen else ""
    prepare_process()
    from coordinator.host import HostZygote
    from wire.hosts import Host

    name = options.host or f"{socket.gethostname()}-{os.getpid()}"
    HostZygote(cluster, router, Host(secrets.token_hex(4), name, nodes, listen)).run()
    return exits.OK


def own_endpoint(listen: str) -> str:
    """An endpoint that others can connect to; a container does not know its address when it is configured.

    Raises:
        BadInput: if it has no address and port.
    """
    import re
    import socket

    from problems.errors import BadInput

    found = re.fullmatch(r"tcp/(.+):([1-9]\d{0,4})", listen)
    if found is None:
        raise BadInput(f"--listen: expected tcp/ADDRESS:PORT, found {listen}")
    address, port = found.groups()
    if address == "0.0.0.0":
        try:
            address = socket.gethostbyname(socket.gethostname())
        except OSError as error:
            raise BadInput(f"--listen: this machine does not know its own address: {error.strerror}") from error
    return f"tcp/{address}:{port}"
