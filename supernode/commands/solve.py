"""Solve a problem on a cluster started for it, one process for each cell; or on one that is up already.

With --dashboard the cluster has a coordinator, as `supernode up` starts it, and a browser shows the run for as long as
it lasts.
"""

import argparse
from typing import TYPE_CHECKING

from supernode.commands.checkpoint_options import add_checkpoint, begun_checkpoints
from supernode.commands.cluster_options import add_own_cluster, add_place, connected
from supernode.commands.dashboard_options import add_dashboard
from supernode.commands.run_options import add_run_options, chosen_file

if TYPE_CHECKING:
    from coordinator import Job, LocalCluster
    from problems import ProblemFile
    from spy.result import Result
    from supernode.client.client import Client
    from supernode.dashboard.listen_address import ListenAddress

EXAMPLE = "supernode solve examples/mobile-robot.toml --seed 1 --plot office.png"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of a run, and where to run it."""
    add_run_options(parser)
    where = parser.add_argument_group("where (by default on a cluster of its own)")
    add_place(where)
    add_own_cluster(where)
    add_checkpoint(where)
    where.add_argument(
        "--checkpoints",
        metavar="DIR",
        help="the folder of the checkpoints (the problem file's name with .run, in the current folder)",
    )
    add_dashboard(parser)


def run(options: argparse.Namespace) -> int:
    """Show progress on stderr, and print the result on stdout."""
    from supernode.launch.supervisor import wanted_address

    file, listen_address = chosen_file(options), wanted_address(options)
    if options.connect is not None or options.state is not None:
        return _on_a_running_one(file, options, listen_address)
    return _on_its_own(file, options) if listen_address is None else _on_a_shown_one(file, options, listen_address)


def _on_a_running_one(file: "ProblemFile", options: argparse.Namespace, listen_address: "ListenAddress | None") -> int:
    """Solve on a cluster that is up; a dashboard is its own business."""
    from problems import BadInput
    from supernode.terminal.present import present

    _refuse_checkpoints(options, "a running cluster")
    if listen_address is not None:
        raise BadInput("--dashboard: expected none with --connect or --state: `supernode spy --dashboard` shows those")
    with connected(options) as client:
        result, interrupted = _followed(client, file, options)
    return present(result, file, options, interrupted)


def _on_a_shown_one(file: "ProblemFile", options: argparse.Namespace, listen_address: "ListenAddress") -> int:
    """Solve on a cluster of its own that has a dashboard: one with a coordinator and a store, as `up` starts it."""
    import sys

    from coordinator.launch.launcher import ServiceOptions
    from supernode.client.client import Client
    from supernode.client.cluster_info import Place
    from supernode.launch.supervisor import LaunchRequest, Supervisor, check_library
    from supernode.terminal.present import present

    _refuse_checkpoints(options, "--dashboard")
    check_library("solve --dashboard")
    module, own, _ = file.kind.partition(":")
    service = ServiceOptions(
        max_queue=0,
        allow_modules=(module,) if own else (),
        modules=file.folder,
        node_timeout=options.node_timeout,
        eval_timeout=options.eval_timeout,
        node_memory=options.node_memory,
    )
    # `max_queue=0`: nobody else's job may wait for this cluster, which ends with its one job.
    request = LaunchRequest(file.run.topology, service, listen_address, options.force)
    with Supervisor(request).up() as up, Client(Place.at(up.endpoint)) as client:
        if not options.quiet:
            print(f"dashboard of this run: {up.dashboard}", file=sys.stderr)
        result, interrupted = _followed(client, file, options)
    return present(result, file, options, interrupted)


def _refuse_checkpoints(options: argparse.Namespace, where: str) -> None:
    from problems import BadInput

    if options.checkpoint is not None or options.checkpoints is not None:
        raise BadInput(f"--checkpoint: expected none with {where}; the checkpoints of a cluster are `supernode up`'s")


def _followed(client: "Client", file: "ProblemFile", options: argparse.Namespace) -> tuple["Result", bool]:
    """Return the result of the job on a running cluster, and whether Ctrl-C interrupted it, which cancels the job."""
    from supernode.launch.own_cluster import DRAIN_SECONDS
    from supernode.terminal.following import Follower

    job = client.submit(file)
    follower = Follower(client, job, file, options.quiet, options.log, least=options.least_improvement)
    try:
        follower.show()
        return follower.result(), False
    except KeyboardInterrupt:
        job.cancel()
    return follower.result(DRAIN_SECONDS), True


def _on_its_own(file: "ProblemFile", options: argparse.Namespace) -> int:
    """Solve on a cluster of its own, started for the job."""
    from supernode.launch.own_cluster import run_on_its_own

    about = {"log": options.log, "least_improvement": options.least_improvement}
    with begun_checkpoints(file, options) as folder:

        def submit(cluster: "LocalCluster") -> "Job":
            if folder is None:
                return cluster.submit(file, **about)
            return cluster.resume(folder.path, checkpoint_every=options.checkpoint, **about)

        return run_on_its_own(file, options, submit, folder)
