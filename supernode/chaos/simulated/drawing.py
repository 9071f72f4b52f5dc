"""Draw what a trial does from one seed."""

import random
from dataclasses import replace
from typing import Literal

import topologies
from problems.run import MOST_GENERATIONS
from supernode.chaos.simulated.network import Weather
from supernode.chaos.simulated.plans import (
    AFTER,
    LATENCIES,
    NEIGHBOUR,
    PROPOSER,
    SHORTEST_WORK,
    Fault,
    Plan,
    PlannedHost,
    PlannedJob,
    PlannedRequest,
)
from supernode.chaos.simulated.situations import situation

_TOPOLOGIES = ("torus 2x2", "torus 2x3", "torus 3x3", "torus 3x4", "torus 4x4")
_SPECIAL = ("spy", "router", "coordinator")
_LENGTHS = (1.0, 8.0)  # seconds of faults
_STEPS = (500, 4000)  # generations of all cells of a job together
_MOST_FAULTS = 14
_HOST_AWAY = 12.0  # seconds, at most
_SOON = 0.2  # seconds, in the mean
_MOST_QUESTIONS = 40  # of coordinators; a trial has some tens
_STEPS_OF_JOBS = ("prepare", "begin", "halt", "look", "tell states", "propose stop", "finish", "drop")
_MOST_OF_A_KIND = 3  # questions of a kind of which one is met
_OUTLASTS = (2.0, 5.0)  # how many times as slow a job is that is to outlast the faults
_TARGETS = (80.0, 40.0, 20.0, 10.0)  # of Rastrigin's function in ten dimensions, which begins at some 100


def drawn(seed: int) -> Plan:
    """Return the plan of a seed."""
    if (plan := situation(seed)) is not None:
        return plan
    draw = random.Random(f"plan {seed}")
    topology = draw.choice(_TOPOLOGIES)
    latency, length = draw.choice(LATENCIES), draw.uniform(*_LENGTHS)
    # A job has some thousand steps at most, to bound what a trial costs; so its steps are slow enough to meet faults.
    first = _drawn_job(draw, topology)
    takes = length * draw.uniform(0.5, 1.5) / first.generations - (3 * latency if first.mode == "lockstep" else 0.0)
    jobs = [first]
    if draw.random() < 0.3:
        jobs.append(replace(_drawn_job(draw, topology), at=draw.uniform(0.0, length)))
    nodes = topologies.parse(topology).cells
    hosts = _drawn_hosts(draw, nodes) if draw.random() < 0.4 else ()
    faults = [_drawn_fault(draw, nodes, length, hosts) for _ in range(draw.randrange(_MOST_FAULTS))]
    if draw.random() < 0.3:  # many at once
        at = draw.uniform(0.0, length)
        faults += [Fault(at, "kill", f"node {node}") for node in draw.sample(range(nodes), max(1, nodes // 4))]
    requests = [_drawn_request(draw, len(jobs), length) for _ in range(draw.choice((0, 0, 0, 1, 2)))]
    requests += _updates_back(random.Random(f"back {seed}"), requests)
    if draw.random() < 0.5:
        faults = _brought_together(draw, faults, [job.at for job in jobs] + [request.at for request in requests])
    ends = random.Random(f"ends {seed}")
    jobs = [_with_an_end(ends, job) for job in jobs]
    endless = random.Random(f"endless {seed}")
    for number in sorted({request.job for request in requests if request.do == "cancel"}):
        if endless.random() < 0.5:  # so that a cancel that is lost shows
            jobs[number] = _without_an_end(jobs[number])
    faults += _ambushes(random.Random(f"ambushes {seed}"), nodes, latency)
    faults += _ambushes_of_steps(random.Random(f"steps {seed}"), nodes, latency, hosts)
    faults += (cut := _cut_off_at_a_takeover(random.Random(f"takeover {seed}"), length, hosts))
    faults += (moved := _killed_as_it_moves(random.Random(f"moves {seed}"), nodes, length, latency, hosts))
    if hosts and (moved or random.Random(f"room {seed}").random() < 0.5):  # so that it can move, or begin elsewhere
        jobs[0] = replace(jobs[0], topology="torus 2x2")
    slow = random.Random(f"slow {seed}")
    takes *= slow.uniform(*_OUTLASTS) if slow.random() < (0.7 if cut else 0.15) else 1.0
    ordered = tuple(sorted(faults, key=lambda fault: fault.at))
    return Plan(seed, topology, hosts, tuple(jobs), tuple(requests), latency, max(SHORTEST_WORK, takes), ordered)


def _brought_together(draw: random.Random, faults: list[Fault], others: list[float]) -> list[Fault]:
    """Return the faults, some moved to soon after another event: by chance few meet what another fault causes."""
    moments = others + [fault.at for fault in faults] + [fault.at + fault.seconds for fault in faults]
    return [
        replace(fault, at=draw.choice(moments) + draw.expovariate(1 / _SOON)) if draw.random() < 0.4 else fault
        for fault in faults
    ]


def _drawn_job(draw: random.Random, topology: str) -> PlannedJob:
    topology = topology if draw.random() < 0.8 else "torus 2x2"
    generations = max(20, draw.randint(*_STEPS) // topologies.parse(topology).cells)
    seconds = draw.uniform(0.5, 10.0) if draw.random() < 0.2 else None
    mode = "lockstep" if draw.random() < 0.75 else "async"
    return PlannedJob(0.0, topology, mode, draw.randrange(4), draw.choice((1, 4)), generations, seconds)


def _ambushes(draw: random.Random, nodes: int, latency: float) -> list[Fault]:
    """Return kills just after something that the cluster does: by chance few meet the steps of a protocol."""
    found: list[Fault] = []
    for _ in range(draw.choice((0, 0, 0, 1, 1, 2))):
        many = max(1, nodes // 4) if draw.random() < 0.3 else 1
        killed = [f"node {node}" for node in draw.sample(range(nodes), many)]
        killed = [draw.choice(_SPECIAL)] if draw.random() < 0.3 else killed
        upon = "question" if draw.random() < 0.75 else "proposal"
        count = draw.randint(1, _MOST_QUESTIONS if upon == "question" else 2)
        at = draw.expovariate(1.0 / (AFTER * latency))
        found += [Fault(at, "kill", whom, upon=upon, count=count) for whom in killed]
    return found


def _ambushes_of_steps(draw: random.Random, nodes: int, latency: float, hosts: tuple[PlannedHost, ...]) -> list[Fault]:
    """Return faults just after a step of a job that is rare, so that the n-th of all questions hardly ever meets it."""
    found: list[Fault] = []
    for _ in range(draw.choice((0, 0, 1, 2))):
        if draw.random() < 0.25:  # at once: a stop is soon known to all cells
            at, count = draw.expovariate(1.0 / latency), draw.choice((1, 1, 2))
            killed = draw.choice(((PROPOSER,), (PROPOSER, NEIGHBOUR), (NEIGHBOUR,)))
            found += [Fault(at, "kill", whom, upon="proposal", count=count) for whom in killed]
        else:
            at, count = draw.expovariate(1.0 / (AFTER * latency)), draw.randint(1, _MOST_OF_A_KIND)
            faults = _drawn_faults_in_a_step(draw, nodes, hosts)
            upon = draw.choice(_STEPS_OF_JOBS)
            found += [replace(fault, at=at, upon=upon, count=count) for fault in faults]
    return found


def _drawn_faults_in_a_step(draw: random.Random, nodes: int, hosts: tuple[PlannedHost, ...]) -> list[Fault]:
    kind, seconds, one = draw.random(), draw.uniform(0.05, 3.0), f"node {draw.randrange(nodes)}"
    if kind < 0.07:  # no node is left that has a deme and can be reached
        return [
            Fault(0.0, "kill", whom) if draw.random() < 0.6 else Fault(0.0, "part", whom, seconds, other="router")
            for whom in (f"node {node}" for node in range(nodes))
        ]
    if kind < 0.5:
        special = draw.choice(_SPECIAL)
        killed = draw.choice(((one,), (one, special), (special,), ("spy", "coordinator")))
        return [Fault(0.0, "kill", whom) for whom in killed]
    whom = draw.choice(hosts).name if hosts and draw.random() < 0.7 else one
    if kind < 0.6 and whom != one:
        return [Fault(0.0, "leave", each, seconds) for each in dict.fromkeys((whom, draw.choice(hosts).name))]
    if kind < 0.66 and whom != one:
        return [Fault(0.0, "kill", f"agent {whom}")]
    away = Fault(0.0, "stop", one, seconds) if kind < 0.72 else Fault(0.0, "part", whom, seconds, other="router")
    return [away, Fault(0.0, "kill", "coordinator")] if draw.random() < 0.4 else [away]


def _cut_off_at_a_takeover(draw: random.Random, length: float, hosts: tuple[PlannedHost, ...]) -> list[Fault]:
    """Return the death of a coordinator soon after all hosts were cut off, or one, perhaps with all nodes of a job."""
    if not hosts or draw.random() >= 0.15:
        return []
    at, host = draw.uniform(0.0, length), draw.choice(hosts).name
    cut = Fault(at, "part", host, draw.uniform(1.0, _HOST_AWAY), other="router")
    killed = Fault(at + draw.expovariate(1 / _SOON), "kill", "coordinator")
    hosts_cut = [each.name for each in hosts] if draw.random() < 0.4 else [host]
    return [*(replace(cut, whom=each) for each in hosts_cut), killed]


def _killed_as_it_moves(
    draw: random.Random, nodes: int, length: float, latency: float, hosts: tuple[PlannedHost, ...]
) -> list[Fault]:
    """Return the end of one or two hosts, and a kill in a step of the job that moves away from them."""
    if len(hosts) < 3 or draw.random() >= 0.35:
        return []
    at, seconds = draw.uniform(0.0, length), draw.uniform(0.5, 5.0)
    leaves = [Fault(at, "leave", host.name, seconds) for host in hosts[: draw.choice((1, 2))]]
    soon, upon = draw.expovariate(1.0 / (AFTER * latency)), draw.choice(("halt", "prepare"))
    return [*leaves, Fault(soon, "kill", f"node {draw.randrange(nodes)}", upon=upon, count=draw.randint(1, 4))]


def _with_an_end(draw: random.Random, job: PlannedJob) -> PlannedJob:
    """Return the job, which now and then proposes by itself to stop."""
    if draw.random() < 0.2:
        return replace(job, target=draw.choice(_TARGETS))
    if draw.random() < 0.3:
        return replace(job, stall=draw.randint(3, 20), restarts=draw.choice((0, 0, 1)))
    return job


def _without_an_end(job: PlannedJob) -> PlannedJob:
    """Return the job, which ends only when it is cancelled."""
    return PlannedJob(job.at, job.topology, job.mode, job.seed, job.deme, MOST_GENERATIONS - 1, seconds=None)


def _drawn_request(draw: random.Random, jobs: int, length: float) -> PlannedRequest:
    kinds: tuple[Literal["cancel", "rewire", "update"], ...] = ("cancel", "rewire", "rewire", "update", "update")
    return PlannedRequest(draw.uniform(0.0, length), draw.choice(kinds), draw.randrange(jobs))


def _updates_back(draw: random.Random, requests: list[PlannedRequest]) -> list[PlannedRequest]:
    """Return updates to the first function, whose values are larger: the best answer before must not count then."""
    updates = [request for request in requests if request.do == "update" and draw.random() < 0.5]
    return [replace(each, at=each.at + draw.uniform(0.1, 2.0), function="rastrigin") for each in updates]


def _drawn_hosts(draw: random.Random, nodes: int) -> tuple[PlannedHost, ...]:
    """Draw two or three hosts that have the nodes together, and perhaps one more that has some to spare."""
    number = draw.choice((2, 3))
    sizes = [nodes // number + (place < nodes % number) for place in range(number)]
    if draw.random() < 0.5:
        sizes.append(draw.choice(sizes))
    listens = draw.random() < 0.7
    return tuple(
        PlannedHost(draw.uniform(0.0, 1.0), f"h{place}", size, f"tcp/10.0.0.{place}:7450" if listens else "")
        for place, size in enumerate(sizes)
    )


def _drawn_fault(draw: random.Random, nodes: int, length: float, hosts: tuple[PlannedHost, ...]) -> Fault:
    if hosts and draw.random() < 0.3:
        return _drawn_fault_of_a_host(draw, length, draw.choice(hosts).name)
    at, kind, node = draw.uniform(0.0, length), draw.random(), draw.randrange(nodes)
    whom = draw.choice(_SPECIAL) if draw.random() < 0.25 else f"node {node}"
    if kind < 0.55:
        return Fault(at, "kill", whom)
    if kind < 0.7:
        return Fault(at, "stop", whom, draw.uniform(0.05, 3.0))
    if kind < 0.8:
        other = "router" if draw.random() < 0.3 else f"node {(node + 1 + draw.randrange(nodes - 1)) % nodes}"
        one, other = (f"node {node}", other) if draw.random() < 0.5 else (other, f"node {node}")
        return Fault(at, draw.choice(("part", "hold")), one, draw.uniform(0.05, 5.0), other=other)
    if kind < 0.85:
        return Fault(at, "disk", "", draw.uniform(0.05, 3.0))
    weather = Weather(draw.choice((1e-3, 20e-3, 100e-3)), draw.choice((0.0, 0.02, 0.3)), draw.choice((0.0, 0.1)))
    return Fault(at, "weather", "", draw.uniform(0.1, 3.0), weather=weather)


def _drawn_fault_of_a_host(draw: random.Random, length: float, host: str) -> Fault:
    at, kind, seconds = draw.uniform(0.0, length), draw.random(), draw.uniform(0.1, _HOST_AWAY)
    if kind < 0.4:
        return Fault(at, "kill", host, seconds)
    if kind < 0.7:
        return Fault(at, "leave", host, seconds)
    return Fault(at, "part" if kind < 0.9 else "hold", host, seconds, other="router")
