"""The faults of a trial, drawn from a seed: the same seed gives the same faults."""

import random
from dataclasses import dataclass
from typing import Literal

DISK = "disk"
SPECIAL = ("spy", "router", "coordinator")
"""Processes other than nodes, of which each dies once in a trial."""

_STOPPED_FOR = (0.5, 3.0)  # seconds; shorter than the time after which a stopped process counts as dead
_STOPPED = 0.2  # share of the single faults that stop a node instead of killing it


@dataclass(frozen=True)
class Fault:
    """Something that is done to a process, or to the disk.

    Attributes:
        at: when, in seconds since the job began to run.
        do: "kill" (SIGKILL), "stop" (SIGSTOP, later SIGCONT) or "fill" (no room on the disk).
        target: the name of the process, such as "node 7" or "router", or "disk".
        seconds: how long it is stopped, or full.
    """

    at: float
    do: Literal["kill", "stop", "fill"]
    target: str
    seconds: float = 0.0


def faults(nodes: int, seconds: float, at_once: float, seed: int, full_disk: float = 0.0) -> list[Fault]:
    """Return the faults of a trial in the order of time.

    A share of the nodes is killed at once after a second; then every second one random node is killed or stopped. Spy,
    router and coordinator are killed once each, at random moments.

    Args:
        nodes: the number of nodes.
        seconds: the time from the first fault to the last.
        at_once: the share of the nodes that is killed at once.
        seed: the same seed gives the same faults.
        full_disk: for how many seconds the disk is full, once.
    """
    source = random.Random(seed)
    found = [Fault(1.0, "kill", f"node {node}") for node in source.sample(range(nodes), round(at_once * nodes))]
    for second in range(1, int(seconds)):
        node = f"node {source.randrange(nodes)}"
        if source.random() < _STOPPED:
            found.append(Fault(1.0 + second, "stop", node, source.uniform(*_STOPPED_FOR)))
        else:
            found.append(Fault(1.0 + second, "kill", node))
    found += [Fault(source.uniform(1.0, max(1.0, seconds)), "kill", process) for process in SPECIAL]
    if full_disk:
        found.append(Fault(source.uniform(1.0, max(1.0, seconds - full_disk)), "fill", DISK, full_disk))
    return sorted(found, key=lambda fault: fault.at)
