"""Keep track of which process each node has, and of the latest counters of each node.

A node's liveliness token drops when its process dies, but also when the router does. So a dropped token alone means
nothing; only the token of another process on the same node proves that the old process has died.
"""

import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

import zenoh

from coordinator.cpu_time import cpu_seconds_of
from wire.callbacks import direct
from wire.keys import Keys
from wire.news import Counters
from wire.strict import Rejected

_KILOBYTE = 1024
_LOOK_FOR = 0.1  # seconds to spend on measuring memory for each request for the nodes' status


class Roster:
    """The processes of one cluster, for a coordinator that did not launch them.

    Args:
        session: a Zenoh session through the router.
        keys: the key expressions of the cluster.
        replaced: called with the number of a node that has a new process, or with None for the spy; and with the signal
            by which the process before it crashed, or "". Usually called on Zenoh's thread.
        arrived: called with the number of a node that is seen for the first time, likewise.
        returned: called with the number of a node that was out of sight and is back with the same process, likewise.
        heard: called with each node's counters, likewise.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        replaced: Callable[[int | None, str], None],
        arrived: Callable[[int], None] = lambda _: None,
        returned: Callable[[int], None] = lambda _: None,
        heard: Callable[[Counters], None] = lambda _: None,
    ) -> None:
        self._keys = keys
        self._replaced = replaced
        self._arrived = arrived
        self._returned = returned
        self._heard = heard
        self._lock = threading.Lock()
        self._processes: dict[str, tuple[int, str]] = {}  # by name, the process id and the host ("": this machine)
        self._seen: dict[int, float] = {}  # by node, when its process was first seen, on the monotonic clock
        self._counters: dict[int, tuple[Counters, float]] = {}  # by node, the latest and when they came, likewise
        self._memory = _Memory()
        self._spy: int | None = None  # its process id, as long as its token exists
        liveliness = self._liveliness = session.liveliness()
        self._declared = [
            liveliness.declare_subscriber(keys.any_life, direct(self._see), history=True),
            liveliness.declare_subscriber(keys.any_spy_life, direct(self._see), history=True),
            session.declare_subscriber(keys.spy_counters, direct(self._hear)),
        ]

    def look(self) -> None:
        """Note all nodes that are present now; the subscriber would report them only a little later."""
        for token in self._present():
            self._see(token)

    def look_for(self, nodes: Collection[int]) -> None:
        """Note those of these nodes that are present now and are not known; nobody is told of any other node."""
        for token in self._present():
            if self._misses(token, nodes):
                self._see(token)

    def _present(self) -> Iterator[zenoh.Sample]:
        """Yield the tokens of nodes that are present now; on a busy machine Zenoh may leave some out."""
        for reply in self._liveliness.get(self._keys.any_life):
            if reply.ok is not None:
                yield reply.ok

    def _misses(self, sample: zenoh.Sample, nodes: Collection[int]) -> bool:
        try:
            node, _ = self._keys.life_of(str(sample.key_expr))
        except Rejected:
            return False
        with self._lock:
            return node in nodes and f"node {node}" not in self._processes

    def forget(self, nodes: Iterable[int]) -> None:
        """Forget nodes that are gone for good; one that comes under such a number later counts as new."""
        with self._lock:
            for node in nodes:
                self._processes.pop(f"node {node}", None)
                self._seen.pop(node, None)
                self._counters.pop(node, None)

    def cpu_seconds(self) -> dict[str, float]:
        """Return the CPU time that each process on this machine has used so far, by name, this one's included."""
        with self._lock:
            processes = {name: process for name, (process, host) in self._processes.items() if not host}
        return cpu_seconds_of(processes) | {"coordinator": time.process_time()}

    def silent(self, nodes: Iterable[int], seconds: float) -> dict[int, int]:
        """Return the process of each of these nodes that runs on this machine and has sent no counters for so long."""
        now = time.monotonic()
        with self._lock:
            lately = {node for node, (_, came) in self._counters.items() if now - came < seconds}
            here = {node: self._here(node) for node in set(nodes) - lately}
        return {node: process for node, process in here.items() if process is not None}

    @property
    def spy(self) -> int | None:
        """The id of the spy's process; None if there is none."""
        return self._spy

    def nodes(self, nodes: Iterable[int], job_on: Callable[[int], str | None]) -> list[dict[str, Any]]:
        """Return each node as the command `status` shows it; ``job_on`` returns the job of a node."""
        # Before the lock is taken: `job_on` takes the dispatcher's lock.
        jobs = {node: job_on(node) for node in nodes}
        with self._lock:
            here = {each: process for each in jobs if (process := self._here(each)) is not None}
            described = [self._node(node, job) for node, job in jobs.items()]
        self._memory.look(here.values())
        return [each | {"memory": self._memory.known.get(here.get(each["node"], -1))} for each in described]

    def _here(self, node: int) -> int | None:
        """Return the id of a node's process if that runs on this machine; else None."""
        process, host = self._processes.get(f"node {node}", (None, ""))
        return None if host else process

    def _node(self, node: int, job: str | None) -> dict[str, Any]:
        (process, _), now = self._processes.get(f"node {node}", (None, "")), time.monotonic()
        counters, came = self._counters.get(node, (None, now))
        shown = None if job is None else counters  # the counters of a node without a job are those of its last one
        return {
            "node": node,
            "process": process,
            "job": job,
            "cell": None if shown is None else shown.cell,
            "epoch": None if shown is None else shown.epoch,
            "generation": None if shown is None else shown.generation,
            "seconds": round(now - self._seen[node], 3) if node in self._seen else None,
            "reported": None if shown is None else round(now - came, 3),
            "sent": 0 if counters is None else counters.sent,
            "received": 0 if counters is None else counters.received,
        }

    def _see(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        try:
            (node, process), host = self._keys.life_of(key), self._keys.host_of_life(key)
        except Rejected:
            return
        is_here = sample.kind == zenoh.SampleKind.PUT
        if node is None and (is_here or process == self._spy):  # an old spy's token may go after the new one's has come
            self._spy = process if is_here else None
        if not is_here:
            return
        name = "spy" if node is None else f"node {node}"
        with self._lock:
            before = self._processes.get(name)
            self._processes[name] = (process, host)
            if node is not None and before != (process, host):
                self._seen[node] = time.monotonic()
                self._counters.pop(node, None)
        # The lock is free again: these call the dispatcher, which takes its own.
        if before is None and node is not None:
            self._arrived(node)
        elif before not in (None, (process, host)):
            self._replaced(node, self._keys.crash_of_life(key))
        elif node is not None:
            self._returned(node)

    def _hear(self, sample: zenoh.Sample) -> None:
        try:
            received = Counters.decode_all(sample.payload.to_bytes())
        except Rejected:
            return
        now = time.monotonic()
        with self._lock:
            self._counters |= {counters.node: (counters, now) for counters in received}
        for counters in received:  # the lock is free again
            self._heard(counters)


class _Memory:
    """The memory of processes. The kernel takes milliseconds to add up one, so each look covers only some of many.

    Attributes:
        known: bytes by process id, as of the latest look at that process; the longest unseen first.
    """

    def __init__(self) -> None:
        self.known: dict[int, int | None] = {}

    def look(self, processes: Iterable[int]) -> None:
        """Measure processes for a limited time, those first that were not measured for the longest time."""
        there = set(processes)
        self.known = {process: memory for process, memory in self.known.items() if process in there}
        until = time.monotonic() + _LOOK_FOR
        for process in [*(there - self.known.keys()), *self.known]:
            self.known.pop(process, None)  # so that it becomes the last of the dict
            self.known[process] = _proportional_set_size(process)
            if time.monotonic() >= until:
                return


def _proportional_set_size(process: int) -> int | None:
    """Return a process's memory in bytes, shared pages divided among their users; None if the process is gone."""
    try:
        rollup = Path(f"/proc/{process}/smaps_rollup").read_text(encoding="ascii")
    except OSError:
        return None
    for line in rollup.splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) * _KILOBYTE
    return None
