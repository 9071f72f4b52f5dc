"""One trial: clients' jobs on a simulated cluster, faults drawn from a seed, and what must hold in spite of them.

First faults happen, then they stop, and everything must end.
"""

import contextlib
import gc
import io
import re
import tempfile
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import topologies
from problems import ProblemFile
from supernode.chaos.simulated import stand_ins
from supernode.chaos.simulated.ambushes import Ambushes
from supernode.chaos.simulated.client import SimulatedClient
from supernode.chaos.simulated.cluster import Cluster
from supernode.chaos.simulated.disk import Disk
from supernode.chaos.simulated.invariants import Invariants
from supernode.chaos.simulated.joined_cluster import JoinedCluster
from supernode.chaos.simulated.network import Network, Weather
from supernode.chaos.simulated.plans import Plan
from supernode.chaos.simulated.world import Process, World

_READY_WITHIN = 60.0  # seconds of simulated time
_ENDS_WITHIN = 300.0  # seconds after the last fault
_STOPS_WITHIN = 30.0  # seconds from the end of the last job until all cells have stopped, and links are closed
_COMMIT = 3e-3  # seconds, mean, that a commit takes
_LOOK_EVERY = 0.02  # seconds between two looks at the cluster
_LOOK_CLOSELY_EVERY = 0.5e-3  # seconds between two looks for cells that propose to stop, where a fault waits for that


@dataclass
class Outcome:
    """What a trial has shown: what was broken, the log, and a digest of everything that happened."""

    plan: Plan
    broken: list[str] = field(default_factory=list)
    log: list[str] = field(default_factory=list)
    digest: str = ""
    seconds: float = 0.0
    events: int = 0


def run(plan: Plan, file: ProblemFile) -> Outcome:
    """Carry out a plan and return what it has shown.

    Args:
        plan: what to do.
        file: the problem of the jobs.
    """
    outcome = Outcome(plan)
    file = replace(file, name="problem.toml", folder=Path("/"))  # a digest must not depend on where the file is
    was_collecting = gc.isenabled()
    gc.disable()  # a collection ends forgotten queries at a moment that the seed does not decide
    gc.freeze()  # so the collection below looks through nothing but what the trial has made
    try:
        with tempfile.TemporaryDirectory(dir=_quick_folder()) as state:
            _run(plan, file, Path(state), outcome)
    finally:
        gc.collect()
        gc.unfreeze()
        if was_collecting:
            gc.enable()
    return outcome


def _quick_folder() -> str | None:
    return "/dev/shm" if Path("/dev/shm").is_dir() else None


def _run(plan: Plan, file: ProblemFile, state: Path, outcome: Outcome) -> None:
    broken = outcome.broken
    cluster: Cluster | None = None

    def failed(process: Process, task: str, error: BaseException) -> None:
        broken.append(f"{process.name}: {task} raised {type(error).__name__}: {error}")
        if cluster is not None and task in ("main", "network"):
            cluster.ended(process)

    def exited(process: Process) -> None:
        if cluster is not None and process.alive:
            cluster.ended(process)

    world = World(plan.seed, failed, exited)
    world.mask = str(state)
    network = Network(world, Weather(plan.latency), plan.work)
    processes: dict[int, Process] = {}
    disk = Disk()
    with stand_ins.in_place(world, network, processes), contextlib.redirect_stderr(_Log(world)), disk.in_place():
        if plan.hosts:
            nodes = topologies.parse(plan.topology).cells
            cluster = JoinedCluster(world, network, plan.hosts, nodes, state, processes)
        else:
            cluster = Cluster(world, network, plan.topology, state, processes)
        client = SimulatedClient(world, network, cluster.router, cluster.keys)
        disk.fails = lambda: world.now < cluster.disk_fails_until
        disk.spend = lambda: world.spend(_COMMIT)
        invariants = Invariants(world, cluster, client, broken, plan)
        world.run(lambda: cluster.is_ready, _READY_WITHIN)
        ready = world.now
        for number, job in enumerate(plan.jobs):
            world.at(ready + job.at, partial(client.submit, f"job-{number}", file.with_run(**job.settings())))
        for request in plan.requests:
            id = f"job-{request.job}"
            world.at(ready + request.at, partial(client.ask, id, request.of(id, plan.jobs[request.job])))
        last = ready
        for fault in plan.timed:
            last = max(last, ready + fault.at + fault.seconds)
            world.at(ready + fault.at, partial(cluster.suffer, fault))
        invariants.faults_end = last
        ambushes = Ambushes(world, cluster, plan.faults, invariants.expect_faults_until)
        network.asked, network.taken = ambushes.asked, invariants.taken
        world.at(ready, lambda: invariants.look(_LOOK_EVERY))
        world.at(ready, lambda: ambushes.look(_LOOK_CLOSELY_EVERY))
        over = world.run(lambda: world.now > last and invariants.all_ended(len(plan.jobs)), last + _ENDS_WITHIN)
        if over:
            world.run(lambda: not (invariants.strays() or invariants.leaking()), world.now + _STOPS_WITHIN)
        else:
            broken.append(f"not all jobs ended: {[(job.id, job.status) for job in client.jobs]}")
        invariants.at_the_end()
        world.end()
        for process in [*processes.values(), client.process]:
            process.kill()
    outcome.log = world.log
    outcome.digest, outcome.seconds, outcome.events = world.digest, world.now, world.events


class _Log(io.StringIO):
    """Standard error of the simulated processes: their log becomes part of the world's."""

    def __init__(self, world: World) -> None:
        super().__init__()
        self._world = world

    def write(self, text: str) -> int:
        """Write a line, as `LogLines` does."""
        if text.strip():
            self._world.say(f"log: {text.strip()}")
        return len(text)


def shortest(outcome: Outcome, file: ProblemFile) -> Outcome:
    """Return the outcome of a plan with fewer faults that breaks the same, found by leaving out one at a time."""
    found = outcome
    tried = True
    while tried:
        tried = False
        for fault in found.plan.faults:
            fewer = tuple(each for each in found.plan.faults if each is not fault)
            other = run(replace(found.plan, faults=fewer), file)
            if _kinds(other) & _kinds(outcome):
                found, tried = other, True
                break
    return found


def _kinds(outcome: Outcome) -> set[str]:
    """Return what was broken, without names and numbers."""
    return {re.sub(r"[\d.]+(e-?\d+)?|[0-9a-f]{8,}", "", broken) for broken in outcome.broken}
