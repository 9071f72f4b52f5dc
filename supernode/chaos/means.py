"""The means of a trial: how a fault is done to a cluster that runs, and how it ends."""

import contextlib
import os
import signal
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from supernode.chaos.network import Network
from supernode.chaos.schedule import Fault


def _none(_: int) -> Mapping[str, int]:
    return {}


@dataclass(frozen=True)
class Means:
    """Ways to reach a cluster's processes, disk and network.

    Attributes:
        endpoint: the endpoint of the cluster's router.
        processes: returns the ids of the processes by name, such as "node 7" or "host 1".
        disk: the disk that keeps the jobs, if it can be filled.
        network: the hosts of the cluster, if they can be cut off.
        nodes_on: returns the ids of the node processes of a host by name.
    """

    endpoint: str
    processes: Callable[[], Mapping[str, int]]
    disk: Path | None = None
    network: Network | None = None
    nodes_on: Callable[[int], Mapping[str, int]] = _none

    def begin(self, fault: Fault) -> Callable[[], None] | None:
        """Carry out a fault; return what ends it, or None if there is no such process any more."""
        if fault.do == "fill":
            assert self.disk is not None
            return _fill(self.disk)
        if fault.do == "part":
            assert self.network is not None
            return self.network.cut(fault.number)
        process = self.processes().get(fault.target)
        if process is None:
            return None
        try:
            os.kill(process, signal.SIGKILL if fault.do == "kill" else signal.SIGSTOP)
        except ProcessLookupError:
            return None
        return partial(_let_go_on, process)

    def dying(self, fault: Fault) -> list[int]:
        """Return the nodes that die by a fault, if it is carried out now."""
        if fault.do != "kill":
            return []
        names = [fault.target] if fault.kind == "node" else []
        if fault.kind == "host":
            names += self.nodes_on(fault.number)
        return [int(name.removeprefix("node ")) for name in names]


def _fill(disk: Path) -> Callable[[], None]:
    """Leave no room on a disk; return what makes room again."""
    filler, block = disk / "filler", bytes(1 << 16)
    with contextlib.suppress(OSError), filler.open("wb", buffering=0) as file:
        while True:
            file.write(block)
    return partial(filler.unlink, missing_ok=True)


def _let_go_on(process: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(process, signal.SIGCONT)
