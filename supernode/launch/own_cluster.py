"""Run one job on a cluster that is started for it, and show its progress and its result on the terminal."""

import argparse
import resource
from collections.abc import Callable
from dataclasses import replace

import topologies
from coordinator import Job, LocalCluster
from coordinator.jobs.job import BegunAnew, CheckpointFailed
from coordinator.launch import capacity
from coordinator.launch.compilation import compile_missing
from coordinator.store.checkpoint_folder import CheckpointFolder
from problems import ProblemFile, registry
from spy.result import Result
from spy.terminal import Terminal
from supernode.terminal.present import present
from wire.news import Improvement

DRAIN_SECONDS = 3.0
"""The time that the cells get to stop after Ctrl-C."""


def run_on_its_own(
    file: ProblemFile,
    options: argparse.Namespace,
    submit: Callable[[LocalCluster], Job],
    folder: CheckpointFolder | None = None,
) -> int:
    """Start a cluster, let ``submit`` give it a job, and present the result; return the exit code.

    Args:
        file: the problem file, with the topology of the cluster.
        options: what to report, and how the cluster is started.
        submit: called once the cluster is ready.
        folder: has the checkpoints of the run, which are deleted if it ends by itself.
    """
    topology = topologies.parse(file.run.topology)
    capacity.check(topology.cells, force=options.force)  # before anything is compiled
    kinds = registry.imported_kinds()  # that of the file, and those that a user's own kind is made of
    with Terminal(topology, options.quiet, least=options.least_improvement) as terminal:
        compile_missing(kinds, terminal.say)
        terminal.say(f"starting nodes: {topology.cells} ({topology.spec})")
        with LocalCluster(
            topology=topology.spec,
            kinds=kinds,
            force=options.force,
            on_node_death=options.on_node_death,
            node_timeout=options.node_timeout,
            eval_timeout=options.eval_timeout,
            node_memory=options.node_memory,
        ) as cluster:
            terminal.say(f"ready after {cluster.seconds_to_ready:.2f} s")
            job = submit(cluster)
            result, interrupted = _follow(cluster, job, terminal)
    if folder is not None and result.status not in ("cancelled", "failed"):
        folder.discard()
    first = job.spec.first or file
    tried = first.tried(result.directives)
    return present(replace(result, cpu_seconds=_cpu_seconds()), tried, options, interrupted)


def _follow(cluster: LocalCluster, job: Job, terminal: Terminal) -> tuple[Result, bool]:
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
        return job.result(DRAIN_SECONDS), True
    except TimeoutError:
        cluster.close()
        return job.result(), True


def _show(job: Job, terminal: Terminal) -> None:
    for event in job.events():
        if isinstance(event, Improvement):
            terminal.improvement(event)
        elif isinstance(event, BegunAnew):
            terminal.begins_anew(event.why)
        elif isinstance(event, CheckpointFailed):
            terminal.say(f"warning: no checkpoint: {event.why}")
        else:
            terminal.statistics(event)


def _cpu_seconds() -> float:
    """Return the CPU time of this process and of the cluster's, s; call it once all children are reaped."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)
