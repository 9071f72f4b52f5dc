"""Solve a problem on a cluster started for it, one process for each cell; or on one that is up already.

With --dashboard the cluster has a coordinator, as `supernode up` starts it, and a browser shows the run for as long as
it lasts.
"""

import argparse
import resource
from dataclasses import replace
from typing import TYPE_CHECKING

from supernode.commands.cluster_options import add_force, add_node_timeout, add_place, connected
from supernode.commands.dashboard_options import add_dashboard
from supernode.commands.run_options import add_run_options, chosen_file

if TYPE_CHECKING:
    from coordinator import Job, LocalCluster
    from problems import ProblemFile
    from spy.result import Result
    from spy.terminal import Terminal
    from supernode.client.client import Client
    from supernode.dashboard.listen_address import ListenAddress

EXAMPLE = "supernode solve examples/mobile-robot.toml --seed 1 --plot office.png"

_DRAIN_SECONDS = 3.0  # time that the cells get to stop after Ctrl-C


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of a run, and where to run it."""
    add_run_options(parser)
    where = parser.add_argument_group("where (by default on a cluster of its own)")
    add_place(where)
    add_force(where)
    where.add_argument(
        "--on-node-death",
        choices=("replace", "fail"),
        default="replace",
        help="whether another process takes the place of one that dies, or the job fails (replace)",
    )
    add_node_timeout(where)
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

    check_library("solve --dashboard")
    module, own, _ = file.kind.partition(":")
    service = ServiceOptions(
        max_queue=0, allow_modules=(module,) if own else (), modules=file.folder, node_timeout=options.node_timeout
    )
    # `max_queue=0`: nobody else's job may wait for this cluster, which ends with its one job.
    request = LaunchRequest(file.run.topology, service, listen_address, options.force)
    with Supervisor(request).up() as up, Client(Place.at(up.endpoint)) as client:
        if not options.quiet:
            print(f"dashboard of this run: {up.dashboard}", file=sys.stderr)
        result, interrupted = _followed(client, file, options)
    return present(result, file, options, interrupted)


def _followed(client: "Client", file: "ProblemFile", options: argparse.Namespace) -> tuple["Result", bool]:
    """Return the result of the job on a running cluster, and whether Ctrl-C interrupted it, which cancels the job."""
    from supernode.terminal.following import Follower

    job = client.submit(file)
    follower = Follower(client, job, file, options.quiet, options.log, least=options.least_improvement)
    try:
        follower.show()
        return follower.result(), False
    except KeyboardInterrupt:
        job.cancel()
    return follower.result(_DRAIN_SECONDS), True


def _on_its_own(file: "ProblemFile", options: argparse.Namespace) -> int:
    """Solve on a cluster of its own, started for the job."""
    import topologies
    from coordinator.launch import capacity

    topology = topologies.parse(file.run.topology)
    capacity.check(topology.cells, force=options.force)  # now, not after half a second of imports
    from coordinator import LocalCluster
    from coordinator.launch.compilation import compile_missing
    from problems import registry
    from spy.terminal import Terminal
    from supernode.terminal.present import present

    log, least = options.log, options.least_improvement
    kinds = registry.imported_kinds()  # that of the file, and those that a user's own kind is made of
    with Terminal(topology, options.quiet, least=least) as terminal:
        compile_missing(kinds, terminal.say)
        terminal.say(f"starting nodes: {topology.cells} ({topology.spec})")
        with LocalCluster(
            topology=topology.spec,
            kinds=kinds,
            force=options.force,
            on_node_death=options.on_node_death,
            node_timeout=options.node_timeout,
        ) as cluster:
            terminal.say(f"ready after {cluster.seconds_to_ready:.2f} s")
            result, interrupted = _follow(cluster, cluster.submit(file, log=log, least_improvement=least), terminal)
    tried = file.tried(result.directives)
    return present(replace(result, cpu_seconds=_cpu_seconds()), tried, options, interrupted)


def _follow(cluster: "LocalCluster", job: "Job", terminal: "Terminal") -> tuple["Result", bool]:
    """Show progress to the end; return the result, and whether Ctrl-C interrupted the job.

    After Ctrl-C the cells are asked to stop; if they do not in time, the cluster is ended. Either way there is a
    result: the best so far.
    """
    try:
        _show(job, terminal)
        return job.result(), False
    except KeyboardInterrupt:
        job.cancel()
    try:
        return job.result(_DRAIN_SECONDS), True
    except TimeoutError:
        cluster.close()
        return job.result(), True


def _show(job: "Job", terminal: "Terminal") -> None:
    from coordinator.jobs.job import BegunAnew
    from wire.news import Improvement

    for event in job.events():
        if isinstance(event, Improvement):
            terminal.improvement(event)
        elif isinstance(event, BegunAnew):
            terminal.begins_anew(event.why)
        else:
            terminal.statistics(event)


def _cpu_seconds() -> float:
    """Return the CPU time of this process and of the cluster's, s; call it once all children are reaped."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)
