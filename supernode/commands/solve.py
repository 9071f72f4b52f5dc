"""Solve a problem on a cluster started for it, one process for each cell; or on one that is up already."""

import argparse
import os
import resource
from dataclasses import replace
from typing import TYPE_CHECKING

from supernode.commands.cluster_options import add_place, connected
from supernode.commands.run_options import add_run_options, chosen_file

if TYPE_CHECKING:
    from coordinator import Job, LocalCluster
    from problems import ProblemFile
    from spy.result import Result
    from spy.terminal import Terminal

EXAMPLE = "supernode solve examples/mobile-robot.toml --seed 1 --plot office.png"

_DRAIN_SECONDS = 3.0  # what cells get to stop in after Ctrl-C


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of a run, and where."""
    add_run_options(parser)
    add_place(parser.add_argument_group("where (by default on a cluster of its own)"))


def run(options: argparse.Namespace) -> int:
    """Follow the job on stderr, and print its result on stdout."""
    file = chosen_file(options)
    if options.connect is None and options.state is None:
        return _on_its_own(file, options)
    return _on_a_running_one(file, options)


def _on_a_running_one(file: "ProblemFile", options: argparse.Namespace) -> int:
    """Ctrl-C cancels the job; the best so far is the result."""
    from supernode.following import Follower
    from supernode.present import present

    with connected(options) as client:
        job = client.submit(file)
        follower = Follower(job, file, options.quiet, options.log)
        interrupted = False
        try:
            follower.show()
        except KeyboardInterrupt:
            interrupted = True
            job.cancel()
        result = follower.result(_DRAIN_SECONDS if interrupted else None)
    return present(result, file, options, interrupted)


def _on_its_own(file: "ProblemFile", options: argparse.Namespace) -> int:
    """Launch a cluster, and end it."""
    import topologies
    from coordinator import LocalCluster
    from spy.terminal import Terminal
    from supernode.present import present

    log = None if options.log is None else os.path.abspath(options.log)  # noqa: PTH100 - no links resolved
    topology = topologies.parse(file.run.topology)
    with Terminal(topology, options.quiet) as terminal:
        terminal.say(f"starting nodes: {topology.cells} ({topology.spec})")
        with LocalCluster(topology=topology.spec) as cluster:
            terminal.say(f"ready after {cluster.seconds_to_ready:.2f} s")
            result, interrupted = _follow(cluster, cluster.submit(file, log=log), terminal)
    return present(replace(result, cpu_seconds=_cpu_seconds()), file, options, interrupted)


def _follow(cluster: "LocalCluster", job: "Job", terminal: "Terminal") -> tuple["Result", bool]:
    """Show what happens until the end; Ctrl-C asks the cells to stop, and the best so far is the result."""
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
    from wire.news import Improvement

    for event in job.events():
        if isinstance(event, Improvement):
            terminal.improvement(event)
        else:
            terminal.statistics(event)


def _cpu_seconds() -> float:
    """CPU time of this process and of the cluster's, all reaped by now."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)
