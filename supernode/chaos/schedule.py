"""The faults of a trial, drawn from a seed: the same seed gives the same faults."""

import random
from dataclasses import dataclass
from typing import Literal

DISK = "disk"
SPECIAL = ("spy", "router", "coordinator")
"""Processes other than nodes, of which each dies once in a trial."""

_STOPPED_FOR = (0.5, 3.0)  # seconds; shorter than the time after which a stopped process counts as dead
_STOPPED = 0.2  # share of the single faults that stop a node instead of killing it
_CUT_EVERY = 8.0  # seconds of faults for each cut of a host
_CUT_FOR = (1.0, 6.0)  # seconds; TCP tries again after as long
_LONG_CUT = 0.2  # share of the cuts that are long
_LONG_CUT_FOR = (10.0, 20.0)  # seconds; much shorter than the time after which a host counts as gone


@dataclass(frozen=True)
class Fault:
    """Something that is done to a process, to the disk, or to a host.

    Attributes:
        at: when, in seconds since the job began to run.
        do: "kill" (SIGKILL), "stop" (SIGSTOP, later SIGCONT), "fill" (no room on the disk) or "part" (all that a host
            sends, and all that is sent to it, is lost).
        target: the name of the process, such as "node 7" or "router", or "disk", or a host, such as "host 1".
        seconds: how long it is stopped, full, or cut off.
    """

    at: float
    do: Literal["kill", "stop", "fill", "part"]
    target: str
    seconds: float = 0.0

    @property
    def kind(self) -> str:
        """The kind of the target, such as "node"."""
        return self.target.partition(" ")[0]

    @property
    def number(self) -> int:
        """The number of the node or host."""
        return int(self.target.partition(" ")[2])


def faults(
    nodes: int, seconds: float, at_once: float, seed: int, full_disk: float = 0.0, hosts: int = 0
) -> list[Fault]:
    """Return the faults of a trial in the order of time.

    A share of the nodes is killed at once after a second; then every second one random node is killed or stopped. Spy,
    router and coordinator are killed once each, at random moments. If there are hosts, one of them is killed too, and
    they are cut off now and then; the other faults stay the same.

    Args:
        nodes: the number of nodes.
        seconds: the time from the first fault to the last.
        at_once: the share of the nodes that is killed at once.
        seed: the same seed gives the same faults.
        full_disk: for how many seconds the disk is full, once.
        hosts: the number of hosts that can be cut off; 0 for none.
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
    if hosts:
        found += _on_hosts(hosts, seconds, random.Random(f"hosts {seed}"))
    return sorted(found, key=lambda fault: fault.at)


def _on_hosts(hosts: int, seconds: float, source: random.Random) -> list[Fault]:
    """Return the death of a host, and the cuts."""
    found = [Fault(source.uniform(1.0, max(1.0, seconds)), "kill", f"host {source.randrange(hosts)}")]
    for _ in range(max(1, round(seconds / _CUT_EVERY))):
        length = source.uniform(*(_LONG_CUT_FOR if source.random() < _LONG_CUT else _CUT_FOR))
        at = source.uniform(1.0, max(1.0, seconds))
        found.append(Fault(at, "part", f"host {source.randrange(hosts)}", length))
    return found
