"""The spy of a cluster whose processes live in several places: it verifies and publishes what nodes find.

With --dashboard it is an onlooker instead: it shows a running cluster in a browser, by default the one of this user's
`supernode up`, until Ctrl-C.
"""

import argparse
from typing import TYPE_CHECKING

from supernode import exits
from supernode.commands.dashboard_options import add_dashboard
from supernode.commands.role_options import add_membership, cluster_of, endpoint_of, prepare_process

if TYPE_CHECKING:
    from supernode.dashboard.door import Door

EXAMPLE = "supernode spy --connect tcp/192.168.1.7:7447"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which cluster, and whether to show it."""
    add_membership(parser)
    add_dashboard(parser)


def run(options: argparse.Namespace) -> int:
    """Watch until a signal."""
    from supernode.upkeep import wished_door

    door = wished_door(options)
    if door is not None:
        return _show(options, door)
    import secrets
    from pathlib import Path

    router, cluster = endpoint_of(options), cluster_of(options)
    prepare_process()
    from coordinator.zygote import import_all
    from node.berth import Berth
    from spy.process import watch

    import_all()
    watch(Berth(cluster, 0, "", Path(), router, secrets.token_hex(4)))
    return exits.OK


def _show(options: argparse.Namespace, door: "Door") -> int:
    """Serve the dashboard; a cluster that is away is waited for."""
    from supernode.dashboard.server import serve
    from supernode.whereabouts import Place

    place = Place.of_folder(None) if options.connect is None else Place.at(options.connect)
    sock = door.listen()
    print(f"dashboard of {place}: {door.address(sock)}", flush=True)
    serve(place, door, sock)
    return exits.OK
