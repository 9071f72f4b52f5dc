"""Run the router of a cluster whose processes are started separately: all other processes connect to it."""

import argparse

from supernode import exits
from supernode.commands.role_options import add_option, endpoint, endpoint_of, prepare_process

EXAMPLE = "supernode router --listen tcp/0.0.0.0:7447"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add where the router listens."""
    add_option(parser, "listen", "the endpoints to listen at, separated by spaces", metavar="ENDPOINT")


def run(options: argparse.Namespace) -> int:
    """Route until a signal arrives."""
    import contextlib
    import os

    endpoint_of(options, "listen")
    endpoints = [endpoint(each, "listen") for each in options.listen.split()]
    prepare_process()
    from coordinator.launch.router import route

    with contextlib.suppress(KeyboardInterrupt):
        route(endpoints, os.open(os.devnull, os.O_WRONLY))
    return exits.OK
