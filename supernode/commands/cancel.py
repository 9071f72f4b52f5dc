"""End a job of a running cluster; its result is the best so far."""

import argparse

from supernode import exits
from supernode.commands.cluster_options import add_cluster_options, add_job, connected, tell

EXAMPLE = "supernode cancel 5f3a09c1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which job."""
    add_job(parser)
    add_cluster_options(parser, "its state when it was told so")


def run(options: argparse.Namespace) -> int:
    """Ask for it; `watch` shows the end."""
    from coordinator.states import ENDS

    with connected(options) as client:
        status = client.job(options.job).cancel()
    told = f"had ended before: {status}" if status in ENDS else f"is being cancelled (it was {status})"
    tell(options, {"job": options.job, "status": status}, f"{options.job} {told}")
    return exits.OK
