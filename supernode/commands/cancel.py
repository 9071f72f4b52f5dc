"""End a job of a running cluster; its result is the best so far."""

import argparse

from supernode import exits
from supernode.commands.cluster_options import add_cluster_options, add_job, connected, tell

EXAMPLE = "supernode cancel 5f3a09c1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the job, and the options of the cluster."""
    add_job(parser)
    add_cluster_options(parser, "the state that the job was in")


def run(options: argparse.Namespace) -> int:
    """Ask the cluster to cancel the job, without waiting for its end."""
    from coordinator.jobs.states import ENDS

    with connected(options) as client:
        status = client.job(options.job).cancel()
    told = f"had ended before: {status}" if status in ENDS else f"is being cancelled (it was {status})"
    tell(options, {"job": options.job, "status": status}, f"{options.job} {told}")
    return exits.OK
