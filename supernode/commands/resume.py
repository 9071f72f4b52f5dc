"""Let a run of `solve --checkpoint` go on after its processes have ended, however they ended.

In lockstep it goes on bit for bit: its result is that of a run that was never interrupted. With another torus each cell
begins with the deme of a cell of the checkpoint, and the result's directives say so.
"""

import argparse

from supernode.commands.checkpoint_options import add_checkpoint
from supernode.commands.cluster_options import add_own_cluster
from supernode.commands.run_options import add_report, torus

EXAMPLE = "supernode resume office.run"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the folder, the topology, where to run, and what to report."""
    parser.add_argument("folder", metavar="DIR", help="the folder of the checkpoints")
    shape = parser.add_mutually_exclusive_group()
    shape.add_argument("--torus", metavar="RxC", type=torus, dest="topology", help="other rows and columns than before")
    shape.add_argument("--topology", metavar="SPEC", help='another topology, such as "ring 16"')
    add_checkpoint(parser, "30s")
    add_own_cluster(parser)
    add_report(parser)


def run(options: argparse.Namespace) -> int:
    """Show progress on stderr, and print the result on stdout."""
    import sys

    from coordinator.store.checkpoint_folder import CheckpointFolder
    from supernode.commands.run_options import check_outputs
    from supernode.launch.own_cluster import run_on_its_own

    check_outputs(options)
    folder = CheckpointFolder(options.folder)
    checkpoint, damaged = folder.latest()
    file = checkpoint.file_on(options.topology)
    file.problem()  # imports its kind: the cluster loads the kernels of imported kinds
    for line in damaged:
        print(f"warning: {line}; the one before is used", file=sys.stderr)
    if others := checkpoint.other_versions():
        print(f"warning: {', '.join(others)}: the run may not go on bit for bit", file=sys.stderr)
    about = {"log": options.log, "least_improvement": options.least_improvement}
    with folder.held():
        if not options.quiet:
            print(f"goes on after generation {checkpoint.generation}", file=sys.stderr)
        return run_on_its_own(
            file,
            options,
            lambda cluster: cluster.resume(
                folder.path, topology=options.topology, checkpoint_every=options.checkpoint, **about
            ),
            folder,
        )
