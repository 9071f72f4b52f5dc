"""The spy of a cluster whose processes live in several places: it verifies and publishes what nodes find."""

import argparse

from supernode import exits
from supernode.commands.role_options import add_membership, cluster_of, endpoint_of, prepare_process

EXAMPLE = "supernode spy --connect tcp/192.168.1.7:7447"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which cluster."""
    add_membership(parser)


def run(options: argparse.Namespace) -> int:
    """Watch until a signal."""
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
