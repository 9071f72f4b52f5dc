"""Change the problem of a running job, whose world has moved; the job goes on from the individuals that it has."""

import argparse
from pathlib import Path

from supernode import exits
from supernode.commands.cluster_options import add_cluster_options, add_job, connected, tell

EXAMPLE = "supernode update 5f3a09c1 moved.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the job, the patch, and the options of the cluster."""
    add_job(parser)
    parser.add_argument("patch", metavar="PATCH.toml", help="keys of a problem file; each replaces the problem's own")
    add_cluster_options(parser, "the number of the new epoch")


def run(options: argparse.Namespace) -> int:
    """Print the number of the new epoch."""
    with connected(options) as client:
        epoch = client.job(options.job).update(Path(options.patch))
    tell(options, {"job": options.job, "epoch": epoch}, f"{options.job}: epoch {epoch}")
    return exits.OK
