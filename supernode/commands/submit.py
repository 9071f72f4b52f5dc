"""Submit a job to a running cluster, and print its id; the job runs whether or not anybody waits for it."""

import argparse
from typing import TYPE_CHECKING

from supernode import exits
from supernode.commands.cluster_options import add_cluster_options, connected, tell
from supernode.commands.run_options import add_settings, settings, whole

if TYPE_CHECKING:
    from problems import ProblemFile

EXAMPLE = "supernode submit examples/mobile-robot.toml --seconds 2"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings of a run, and the job's place in the queue."""
    add_settings(parser)
    parser.add_argument("--id", metavar="ID", help="an id of your choice; the same job submitted twice is one job")
    parser.add_argument("--priority", metavar="N", type=whole, default=0, help="higher priorities are run first (0)")
    parser.add_argument(
        "--keep-alive", action="store_true", help="search until it has an answer, then wait for the next `update`"
    )
    parser.add_argument(
        "--grow", action="store_true", help="take further rows of the torus while the cluster has nodes free"
    )
    add_cluster_options(parser, "the job's id and state")


def run(options: argparse.Namespace) -> int:
    """Submit the job and print its id."""
    file = _file(options)
    with connected(options) as client:
        job = client.submit(file, id=options.id, priority=options.priority)
        tell(options, {"job": job.id, "status": job.state() if options.json else None}, job.id)
    return exits.OK


def _file(options: argparse.Namespace) -> "ProblemFile":
    from problems import load

    wanted = {name: True for name in ("keep_alive", "grow") if getattr(options, name)}
    file = load(options.problem).with_run(**settings(options), **wanted)
    file.refuse_unreachable()
    return file
