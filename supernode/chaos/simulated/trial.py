"""One trial: clients' jobs on a simulated cluster, faults drawn from a seed, and what must hold in spite of them.

First faults happen, then they stop, and everything must end. The seed also chooses the cluster, the jobs, the weather
of the network and the faults.
"""

import contextlib
import gc
import io
import random
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from problems import ProblemFile
from supernode.chaos.simulated import stand_ins
from supernode.chaos.simulated.client import SimulatedClient
from supernode.chaos.simulated.cluster import Cluster
from supernode.chaos.simulated.invariants import Invariants
from supernode.chaos.simulated.network import Faults, Network
from supernode.chaos.simulated.world import Process, World

_READY_WITHIN = 60.0  # seconds of simulated time
_ENDS_WITHIN = 300.0  # seconds after the last fault
_LOOK_EVERY = 0.1  # seconds between two looks at the cluster

_TOPOLOGIES = ("torus 2x2", "torus 2x3", "torus 3x3", "torus 4x4")
_LATENCIES = (0.2e-3, 1e-3, 4e-3)  # seconds
_SPECIAL = ("spy", "router", "coordinator")
_LONGEST = 12.0  # seconds of faults
_MOST_FAULTS = 14


@dataclass(frozen=True)
class Fault:
    """Something that happens to the cluster.

    Attributes:
        at: seconds after the cluster is ready.
        do: "kill", "stop", or "weather", which changes the network for a while.
        whom: the process.
        seconds: for how long.
        weather: the network's faults meanwhile.
    """

    at: float
    do: str
    whom: str = ""
    seconds: float = 0.0
    weather: Faults | None = None


@dataclass(frozen=True)
class Plan:
    """What a trial does, all drawn from its seed.

    Attributes:
        topology: of the cluster.
        jobs: the settings of each job's run, and when it is submitted.
        latency: mean seconds of a message on a link, in fair weather.
        faults: in the order of time.
    """

    seed: int
    topology: str
    jobs: tuple[tuple[float, dict[str, object]], ...]
    latency: float
    faults: tuple[Fault, ...]


@dataclass
class Outcome:
    """What a trial has shown: what was broken, the log, and a digest of everything that happened."""

    plan: Plan
    broken: list[str] = field(default_factory=list)
    log: list[str] = field(default_factory=list)
    digest: str = ""
    seconds: float = 0.0
    events: int = 0


def drawn(seed: int) -> Plan:
    """Return the plan of a seed."""
    draw = random.Random(f"plan {seed}")
    topology = draw.choice(_TOPOLOGIES)
    rows, columns = map(int, topology.split()[1].split("x"))
    nodes = rows * columns
    jobs = []
    for _ in range(draw.choice((1, 1, 2))):
        lockstep = draw.random() < 0.75
        run: dict[str, object] = {
            "topology": topology if draw.random() < 0.8 else "torus 2x2",
            "mode": "lockstep" if lockstep else "async",
            "seed": draw.randrange(4),
            "generations": draw.choice((60, 200, 400)),
            "deme": draw.choice((1, 4)),
            "target": -1.0,
            "stall": 1_000_000,
        }
        if draw.random() < 0.2:
            run["seconds"] = draw.uniform(1.0, 10.0)
        jobs.append((draw.uniform(0.0, 2.0) if jobs else 0.0, run))
    length = draw.uniform(2.0, _LONGEST)
    faults = [_drawn_fault(draw, nodes, length) for _ in range(draw.randrange(_MOST_FAULTS))]
    if draw.random() < 0.3:  # many at once
        at = draw.uniform(0.0, length)
        faults += [Fault(at, "kill", f"node {node}") for node in draw.sample(range(nodes), max(1, nodes // 4))]
    ordered = tuple(sorted(faults, key=lambda fault: fault.at))
    return Plan(seed, topology, tuple(jobs), draw.choice(_LATENCIES), ordered)


def _drawn_fault(draw: random.Random, nodes: int, length: float) -> Fault:
    at, kind = draw.uniform(0.0, length), draw.random()
    whom = draw.choice(_SPECIAL) if draw.random() < 0.25 else f"node {draw.randrange(nodes)}"
    if kind < 0.6:
        return Fault(at, "kill", whom)
    if kind < 0.8:
        return Fault(at, "stop", whom, draw.uniform(0.05, 3.0))
    weather = Faults(draw.choice((1e-3, 20e-3, 100e-3)), draw.choice((0.0, 0.02, 0.3)), draw.choice((0.0, 0.1)))
    return Fault(at, "weather", "", draw.uniform(0.1, 3.0), weather)


def run(plan: Plan, file: ProblemFile) -> Outcome:
    """Carry out a plan and return what it has shown.

    Args:
        plan: what to do.
        file: the problem of the jobs.
    """
    outcome = Outcome(plan)
    was_collecting = gc.isenabled()
    gc.disable()  # a collection ends forgotten queries at a moment that the seed does not decide
    try:
        with tempfile.TemporaryDirectory(dir=_quick_folder()) as state:
            _run(plan, file, Path(state), outcome)
    finally:
        gc.collect()
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

    world = World(plan.seed, failed)
    network = Network(world)
    network.faults = fair = Faults(plan.latency)
    processes: dict[int, Process] = {}
    with stand_ins.in_place(world, network, processes), contextlib.redirect_stderr(_Log(world)):
        cluster = Cluster(world, network, plan.topology, state, processes)
        client = SimulatedClient(world, network, cluster.router, cluster.keys)
        invariants = Invariants(world, cluster, client, broken)
        for number, (at, settings) in enumerate(plan.jobs):
            asked_for = file.with_run(**settings)
            world.at(at, lambda number=number, asked_for=asked_for: client.submit(f"job-{number}", asked_for))
        last = 0.0
        for fault in plan.faults:
            last = max(last, fault.at + fault.seconds)
            world.at(fault.at, lambda fault=fault: _do(fault, world, network, cluster, fair))
        world.at(_LOOK_EVERY, lambda: invariants.look(_LOOK_EVERY))
        over = world.run(lambda: invariants.all_ended(len(plan.jobs)) and world.now > last, last + _ENDS_WITHIN)
        if not over:
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


def _do(fault: Fault, world: World, network: Network, cluster: Cluster, fair: Faults) -> None:
    """Carry out a fault. On the hub."""
    if fault.do == "kill":
        cluster.kill(fault.whom)
    elif fault.do == "stop":
        cluster.stop(fault.whom, fault.seconds)
    else:
        assert fault.weather is not None
        world.say(f"weather {fault.weather} for {fault.seconds:.3f} s")
        network.faults = fault.weather

        def calm() -> None:
            network.faults = fair

        world.at(world.now + fault.seconds, calm)


def shortest(plan: Plan, file: ProblemFile) -> Plan:
    """Return a plan that still breaks something, with as few faults as leaving out one after another finds."""
    faults: Sequence[Fault] = plan.faults
    for fault in plan.faults:
        fewer = tuple(each for each in faults if each is not fault)
        if run(replace(plan, faults=fewer), file).broken:
            faults = fewer
    return replace(plan, faults=tuple(faults))
