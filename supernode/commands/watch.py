"""Follow a job of a running cluster: each improvement as it comes on stderr, then the result, as `solve` prints it."""

import argparse

from supernode.commands.cluster_options import add_cluster_options, add_job, connected

EXAMPLE = "supernode watch 5f3a09c1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which job."""
    add_job(parser)
    parser.add_argument("--plot", metavar="FILE", help="draw the result (PNG, SVG or PDF by the name's end)")
    parser.add_argument("--quiet", action="store_true", help="no progress on stderr")
    add_cluster_options(parser, "the result")


def run(options: argparse.Namespace) -> int:
    """Show all until the end; Ctrl-C ends the watching, not the job."""
    from problems import ProblemFile
    from supernode.following import Follower
    from supernode.picture import check_picture_name
    from supernode.present import present

    if options.plot is not None:
        check_picture_name(options.plot)
    with connected(options) as client:
        job = client.job(options.job)
        file = ProblemFile.from_json(job.show()["file"])
        follower = Follower(job, file, options.quiet)
        follower.show()
        result = follower.result()
    return present(result, file, options, interrupted=False)
