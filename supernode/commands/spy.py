"""Run the spy of a cluster whose processes are started separately: it verifies and publishes what nodes find.

With --dashboard it is not a spy but shows a running cluster in a browser, until Ctrl-C; by default the cluster of this
user's `supernode up`.
"""

import argparse
import os
from typing import TYPE_CHECKING

from supernode import exits
from supernode.commands.cluster_options import identity_of
from supernode.commands.dashboard_options import add_dashboard
from supernode.commands.role_options import (
    add_membership,
    add_trust,
    cluster_of,
    endpoint_of,
    modules_of,
    prepare_process,
    secret_of,
)

if TYPE_CHECKING:
    from supernode.client.cluster_info import Place
    from supernode.dashboard.listen_address import ListenAddress

EXAMPLE = "supernode spy --connect tcp/192.168.1.7:7447"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the cluster, and whether to show it."""
    add_membership(parser)
    add_trust(parser)
    add_dashboard(parser)
    parser.add_argument(
        "--state", metavar="DIR", help="with --dashboard: the state folder of a cluster on this machine"
    )


def run(options: argparse.Namespace) -> int:
    """Collect and verify, or show the cluster, until a signal arrives."""
    prepare_process()
    from supernode.launch.supervisor import wanted_address

    listen_address = wanted_address(options)
    if listen_address is not None:
        return _show(options, listen_address)
    import secrets
    from pathlib import Path

    _check_state(options.state is None, "expected --dashboard too")
    router, cluster, identity = endpoint_of(options), cluster_of(options), identity_of(options, "spy")
    secret = secret_of(options, identity)
    from coordinator.launch.imports import import_all
    from node.node_config import NodeConfig
    from spy.process import watch

    import_all()
    host = secrets.token_hex(4)
    watch(NodeConfig(cluster, 0, "", Path(), router, secret, modules_of(options), host, identity=identity))
    return exits.OK


def _show(options: argparse.Namespace, listen_address: "ListenAddress") -> int:
    """Serve the dashboard; wait for the cluster whenever it is away."""
    from supernode.dashboard.server import NICENESS, serve

    place, sock = _place_of(options), listen_address.listen()
    os.nice(NICENESS)
    print(f"dashboard of {place}: {listen_address.address(sock)}", flush=True)
    serve(place, listen_address, sock)
    return exits.OK


def _place_of(options: argparse.Namespace) -> "Place":
    from supernode.client.cluster_info import Place

    if options.connect is None:
        return Place.of_folder(options.state)
    _check_state(options.state is None, "expected none with --connect")
    return Place.at(options.connect, cluster=cluster_of(options), identity=identity_of(options, "dashboard"))


def _check_state(is_right: bool, expected: str) -> None:
    if not is_right:
        from problems.errors import BadInput

        raise BadInput(f"--state: {expected}")
