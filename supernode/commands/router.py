"""Run the router of a cluster whose processes are started separately: all other processes connect to it."""

import argparse

from supernode import exits
from supernode.commands.cluster_options import add_keys, identity_of
from supernode.commands.role_options import (
    add_insecure,
    add_option,
    check_listen,
    endpoint,
    endpoint_of,
    prepare_process,
)

EXAMPLE = "supernode router --listen tls/0.0.0.0:7447 --keys keys"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add where the router listens."""
    add_option(parser, "listen", "the endpoints to listen at, separated by spaces", metavar="ENDPOINT")
    add_keys(parser)
    add_insecure(parser)


def run(options: argparse.Namespace) -> int:
    """Route until a signal arrives."""
    import contextlib
    import os

    endpoint_of(options, "listen")
    endpoints = [endpoint(each, "listen") for each in options.listen.split()]
    identity = identity_of(options, "router")
    check_listen(endpoints, identity is not None, options.insecure)
    prepare_process()
    from coordinator.launch.router import route
    from wire import sessions

    with contextlib.suppress(KeyboardInterrupt):
        if identity is not None:
            sessions.log_refusals()
        route(endpoints, os.open(os.devnull, os.O_WRONLY), identity)
    return exits.OK
