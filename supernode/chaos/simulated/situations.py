"""Situations in which several rare things come together: by chance they hardly ever do, not in thousands of trials."""

import random
from collections.abc import Callable, Sequence
from typing import NamedTuple

import topologies
from supernode.chaos.simulated.plans import (
    AFTER,
    LATENCIES,
    SHORTEST_WORK,
    Fault,
    Plan,
    PlannedHost,
    PlannedJob,
    PlannedRequest,
)

_SHARE = 0.2  # of all trials
_TOPOLOGIES = ("torus 2x3", "torus 3x3")
_SMALL = "torus 2x2"  # leaves nodes to move to
_FIRST = (0.3, 2.5)  # seconds until the first thing happens
_LASTS = (0.7, 1.5)  # times as long as the situation
_GENERATIONS = (100, 300)
_HOST_STARTS_WITHIN = 0.02  # seconds until a host has its numbers, and its nodes are seen
_GONE = 40.0  # seconds; a host counts as gone after ten
_FIRST_OF_A_CHANGE = 3  # of the questions to prepare: a job's first epoch takes two, to its nodes and to the spy


class _Moment(NamedTuple):
    """When things happen.

    Attributes:
        at: seconds until the first.
        soon: seconds from an event to what follows it.
    """

    at: float
    soon: float


class _Situation(NamedTuple):
    """What happens in one of the situations.

    Attributes:
        topology: of the job.
        faults: in any order.
        requests: of the client.
        hosts: empty if one zygote launches all nodes.
        seconds: how long the job should last, about.
    """

    topology: str
    faults: Sequence[Fault]
    requests: Sequence[PlannedRequest] = ()
    hosts: Sequence[PlannedHost] = ()
    seconds: float = 6.0


def situation(seed: int) -> Plan | None:
    """Return the plan of a seed if it is one with a situation; else None."""
    draw = random.Random(f"situation {seed}")
    if draw.random() >= _SHARE:
        return None
    (make,) = draw.choices(tuple(_WEIGHTS), weights=tuple(_WEIGHTS.values()))
    latency = draw.choice(LATENCIES)
    found = make(draw, _Moment(draw.uniform(*_FIRST), draw.expovariate(1.0 / (AFTER * latency))))
    mode = "lockstep" if draw.random() < 0.75 else "async"
    generations = draw.randint(*_GENERATIONS)
    job = PlannedJob(0.0, found.topology, mode, draw.randrange(4), draw.choice((1, 4)), generations, seconds=None)
    exchange = 3 * latency if mode == "lockstep" else 0.0
    work = max(SHORTEST_WORK, found.seconds * draw.uniform(*_LASTS) / generations - exchange)
    faults = tuple(sorted(found.faults, key=lambda fault: fault.at))
    return Plan(seed, found.topology, tuple(found.hosts), (job,), tuple(found.requests), latency, work, faults)


def _hosts(draw: random.Random, nodes: int, number: int, *, may_be_apart: bool = True) -> list[PlannedHost]:
    """Return so many hosts that have so many nodes together; perhaps they only reach each other through the router."""
    sizes = [nodes // number + (place < nodes % number) for place in range(number)]
    listens = not may_be_apart or draw.random() < 0.7
    return [
        PlannedHost(draw.uniform(0.0, 1.0), f"h{place}", size, f"tcp/10.0.0.{place}:7450" if listens else "")
        for place, size in enumerate(sizes)
    ]


def _perhaps_hosts(draw: random.Random, topology: str) -> list[PlannedHost]:
    return _hosts(draw, topologies.parse(topology).cells, draw.choice((2, 3))) if draw.random() < 0.5 else []


def _change_after_another_was_prepared(draw: random.Random, when: _Moment) -> _Situation:
    """Let the coordinator die as it has prepared another topology, and ask the next one for an update first."""
    topology = draw.choice(_TOPOLOGIES)
    requests = (
        PlannedRequest(when.at, "rewire", 0),
        PlannedRequest(when.at + draw.uniform(0.05, 0.8), "update", 0),
    )
    count = _FIRST_OF_A_CHANGE + draw.choice((0, 0, 1))
    killed = Fault(when.soon, "kill", "coordinator", upon="prepare", count=count)
    return _Situation(topology, [killed], requests, _perhaps_hosts(draw, topology))


def _moves_before_and_after_a_takeover(draw: random.Random, when: _Moment) -> _Situation:
    """Move a job again after a takeover: only the coordinator before knew which ports are free."""
    hosts = _hosts(draw, draw.choice((6, 8, 9)), draw.choice((3, 4)), may_be_apart=False)
    faults, requests = [], []
    if draw.random() < 0.5:
        faults.append(Fault(when.at, "leave", "h0", draw.uniform(0.5, 3.0)))
    else:
        requests.append(PlannedRequest(when.at, "rewire", 0))
    takeover = when.at + draw.uniform(0.3, 2.0)
    second = takeover + draw.uniform(0.3, 2.0)
    faults.append(Fault(takeover, "kill", "coordinator"))
    faults.append(Fault(second, "leave", "h1", draw.uniform(0.5, 3.0)))
    return _Situation(_SMALL, faults, requests, hosts, seconds=second + 3.0)


def _coordinator_dies_as_a_job_moves(draw: random.Random, when: _Moment) -> _Situation:
    """Let the coordinator die as cells are halted to move; perhaps a node dies too, or there is nowhere to go."""
    hosts = _hosts(draw, draw.choice((6, 8, 9)), draw.choice((3, 4)))
    upon = draw.choice(("halt", "prepare"))
    count = draw.choice((1, 2)) if upon == "halt" else _FIRST_OF_A_CHANGE + draw.choice((0, 1, 2, 3))
    node = f"node {draw.randrange(6)}"
    killed = draw.choice((("coordinator",), ("coordinator",), ("coordinator", node), (node,)))
    faults = [Fault(when.at, "leave", draw.choice(hosts).name, draw.uniform(0.5, 3.0))]
    faults += [Fault(when.soon, "kill", whom, upon=upon, count=count) for whom in killed]
    if draw.random() < 0.5:
        seconds, cut = draw.uniform(0.3, 3.0), draw.sample(hosts, draw.choice((1, 2)))
        faults += [Fault(when.soon, "part", host.name, seconds, other="router", upon=upon, count=count) for host in cut]
    return _Situation(_SMALL, faults, hosts=hosts)


def _change_while_a_host_is_gone(draw: random.Random, when: _Moment) -> _Situation:
    """Keep a host away for so long that it counts as gone, and have a change of its job wait for it."""
    topology = draw.choice((*_TOPOLOGIES, _SMALL))
    hosts = _hosts(draw, max(6, topologies.parse(topology).cells), draw.choice((2, 3)))
    gone = draw.choice(hosts).name
    killed, cut = Fault(when.at, "kill", gone, _GONE), Fault(when.at, "part", gone, _GONE, other="router")
    request = PlannedRequest(when.at + draw.uniform(-0.05, 8.0), draw.choice(("update", "rewire")), 0)
    return _Situation(topology, [draw.choice((killed, cut))], [request], hosts)


def _death_beside_nodes_that_are_cut_off(draw: random.Random, when: _Moment) -> _Situation:
    """Kill a node while nobody can be asked for its state, and another one, or the coordinator, as cells halt."""
    topology = draw.choice(("torus 3x3", "torus 3x4", "torus 4x4"))
    torus = topologies.parse(topology)
    dead, seconds = draw.randrange(torus.cells), draw.uniform(3.5, 14.0)
    faults = [Fault(when.at, "kill", f"node {dead}")]
    beside = dict.fromkeys(torus.neighbours(dead))
    faults += [Fault(when.at, "part", f"node {node}", seconds, other="router") for node in beside]
    other = draw.choice(("coordinator", f"node {draw.randrange(torus.cells)}"))
    faults.append(Fault(when.soon, "kill", other, upon="halt", count=draw.choice((1, 1, 2))))
    return _Situation(topology, faults, seconds=seconds + 2.0)


def _change_before_all_have_begun(draw: random.Random, when: _Moment) -> _Situation:
    """Cut off a node, or a host, as its job begins; it may come back as a change of the job is prepared."""
    topology = draw.choice(_TOPOLOGIES)
    hosts = _perhaps_hosts(draw, topology)
    node = f"node {draw.randrange(topologies.parse(topology).cells)}"
    whom = draw.choice(hosts).name if hosts and draw.random() < 0.5 else node
    seconds, count = draw.uniform(0.5, 4.0), draw.choice((1, 2, 2))
    cut = Fault(draw.choice((0.0, when.soon)), "part", whom, seconds, other="router", upon="begin", count=count)
    request = PlannedRequest(draw.uniform(0.05, 3.0), draw.choice(("update", "rewire")), 0)
    return _Situation(topology, [cut], [request], hosts)


def _host_ends_as_it_starts(draw: random.Random, when: _Moment) -> _Situation:
    """Tell a host to end before its nodes are seen, for which a job waits.

    A cluster of hosts is ready at once, so the times of faults and of hosts count from the same moment.
    """
    hosts = _hosts(draw, 4, 2)
    last = max(hosts, key=lambda host: host.at)
    ends = last.at + draw.uniform(0.0, _HOST_STARTS_WITHIN)
    return _Situation(_SMALL, [Fault(ends, "leave", last.name, draw.uniform(0.5, 3.0))], hosts=hosts)


_WEIGHTS: dict[Callable[[random.Random, _Moment], _Situation], float] = {
    _change_after_another_was_prepared: 1.0,
    _moves_before_and_after_a_takeover: 1.5,
    _coordinator_dies_as_a_job_moves: 2.5,
    _change_while_a_host_is_gone: 1.0,
    _death_beside_nodes_that_are_cut_off: 1.0,
    _change_before_all_have_begun: 1.0,
    _host_ends_as_it_starts: 1.0,
}
