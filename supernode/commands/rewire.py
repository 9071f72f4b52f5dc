"""Give a running job another topology, as the programmable switch of the SuperNode did."""

import argparse

from supernode import exits
from supernode.commands.cluster_options import add_cluster_options, add_job, connected, tell
from supernode.commands.run_options import torus

EXAMPLE = 'supernode rewire 5f3a09c1 --topology "hypercube 4"'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the job, the topology, and the options of the cluster."""
    add_job(parser)
    shape = parser.add_mutually_exclusive_group(required=True)
    shape.add_argument("--torus", metavar="RxC", type=torus, dest="topology", help="rows and columns")
    shape.add_argument("--topology", metavar="SPEC", help='such as "torus 4x4" or "ring 16"')
    add_cluster_options(parser, "the number of the new epoch")


def run(options: argparse.Namespace) -> int:
    """Print the number of the epoch from which on the job has the topology."""
    import topologies
    from problems.errors import BadInput

    try:
        spec = topologies.parse(options.topology).spec
    except ValueError as error:
        raise BadInput(f"--topology: {error}") from None
    with connected(options) as client:
        epoch = client.job(options.job).rewire(spec)
    tell(options, {"job": options.job, "epoch": epoch}, f"{options.job}: epoch {epoch}")
    return exits.OK
