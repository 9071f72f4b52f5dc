"""The dispatcher of a cluster that stays up: processes that die are replaced, and jobs outlive the coordinator."""

import contextlib
import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import zenoh

import topologies
from coordinator.jobs.blocks import edges_between
from coordinator.jobs.calls import best_told, tell
from coordinator.jobs.client_limits import ClientLimits
from coordinator.jobs.dispatcher import Dispatcher
from coordinator.jobs.hooks import Hooks
from coordinator.jobs.running import EVAL_TIMEOUT
from coordinator.service.roster import Roster
from wire.control import Drop
from wire.keys import Keys
from wire.news import Counters, Improvement, LogRecord
from wire.seal import Seal

_STRAY_AFTER = 3.0  # seconds from the first counters for a job that has ended


class ServiceDispatcher(Dispatcher):
    """Runs jobs on nodes that other processes have launched.

    Args:
        session: a Zenoh session through the router.
        keys: the key expressions of the cluster.
        seal: signs commands.
        hooks: called with everything that happens.
        topology: the topology of the nodes, unless they join.
        wired: whether the nodes have the links of that topology.
        limits: what each client may take.
        expected: for a cluster whose nodes join, the least number of nodes expected.
        eval_timeout: how many seconds an evaluation may go on once its job is stopped.
    """

    _roster: Roster  # subclasses make it, since only some of them handle nodes that join

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        seal: Seal,
        hooks: Hooks,
        *,
        topology: str = "",
        wired: bool = False,
        limits: ClientLimits,
        expected: int | None = None,
        eval_timeout: float = EVAL_TIMEOUT,
    ) -> None:
        self.began = time.time_ns() // 1_000_000
        self._is_restored = False  # until then jobs may run that are not known here yet
        self._strays: dict[tuple[int, int], float] = {}  # nodes with ended jobs, and when that was noticed first
        super().__init__(
            session,
            keys,
            seal,
            topology,
            wired=wired,
            hooks=hooks,
            cpu_seconds=self._cpu_seconds,
            replaces=True,
            checked=True,  # by the request handler
            limits=limits,
            # Milliseconds since 1970: higher than all numbers of the coordinator before, which did not make a wiring
            # each millisecond. A number given twice would let nodes keep links that they should replace.
            first_wiring=self.began,
            expected=expected,
            eval_timeout=eval_timeout,
        )

    def nodes(self) -> list[dict[str, Any]]:
        """Return each node as the command `status` shows it."""
        with self._lock:
            here = self._scheduler.here
        return self._roster.nodes(here, self.job_on)

    def job_on(self, node: int) -> str | None:
        """Return the id of the job that a node belongs to; None if it is free."""
        job, _ = self.place_of(node)
        return None if job is None else job.spec.job

    def best_told(self, number: int) -> Improvement | None:
        """Return the best answer of a job that the spy has told, and have it forget the job; see `calls.best_told`."""
        return best_told(self.session, self._seal, self.keys.spy_control, number)

    def restored(self) -> None:
        """Note that all jobs of the previous coordinator are known."""
        self._is_restored = True

    def heard(self, counters: Counters) -> None:
        """Have a node forget the job of its counters if that has ended, or runs elsewhere: it was cut off meanwhile.

        The last counters of a job may come after its end. So a node is a stray only if it still sends some later.
        """
        stray, now = (counters.node, counters.job), time.monotonic()
        with self._lock:
            if not self._is_stray(*stray):
                self._strays.pop(stray, None)
            elif now > self._strays.setdefault(stray, now) + _STRAY_AFTER:
                del self._strays[stray]
                # On another thread: Zenoh's must not wait until the link takes the question.
                threading.Thread(target=self._end_stray, args=stray, name="stray", daemon=True).start()

    def _is_stray(self, node: int, job: int) -> bool:
        """Return whether a node has no part in a job, so that it need not remember it."""
        here = node in (self._scheduler.nodes_of(job) or ())
        return self._is_restored and not here and job not in self._forgetting.remembered

    def _end_stray(self, node: int, job: int) -> None:
        # With the lock, or the job might begin again, from a checkpoint, between the look and the question.
        with self._lock, contextlib.suppress(zenoh.ZError):  # if the session is closed, the next coordinator does it
            if self._is_stray(node, job):
                tell(self.session, self._seal, self.keys.control(node), Drop(job))

    def placements(self) -> list[dict[str, Any]]:
        """Return for each job on several hosts its cells by host, and how many of its edges cross hosts."""
        found = []
        with self._lock:
            for number, job in self.jobs.items():
                nodes = self._scheduler.nodes_of(number) or ()
                hosts = [self._node_hosts.place_of(node) for node in nodes]
                if len(set(hosts)) > 1 and (known := self._wirings.get(nodes[0])) is not None:
                    topology = topologies.parse(known[0])
                    crossing, edges = edges_between(topology, hosts[: topology.cells])  # a job may be about to grow
                    spread = {"hosts": dict(Counter(hosts)), "crossing": crossing, "edges": edges}
                    found.append({"job": job.spec.job} | spread)
        return found

    def spy(self) -> int | None:
        """Return the id of the spy's process; None if there is none."""
        return self._roster.spy

    def replaced(self, node: int | None, crash: str = "") -> None:
        """Note and log that a new process has replaced that of a node (None: of the spy)."""
        whose = "as the spy" if node is None else f"on node {node}"
        # The log first: the death may end the job, and then the line could not name it any more.
        self._log("warning", f"a process has died: another one lives {whose}", node)
        super().replaced(node, crash)

    def end_silent(self, nodes: Sequence[int], seconds: float) -> None:
        """End the processes of those nodes that have told nothing for so long, if they run on this machine."""
        for node, process in self._roster.silent(nodes, seconds).items():
            self._log(
                "warning", f"an evaluation has not ended {seconds:g} s after its job: its process is killed", node
            )
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)

    def left(self, nodes: Iterable[int], why: str) -> None:
        """Remove nodes that are gone for good; log why, if that is a fault ("" if no job needs them any more)."""
        if why:
            self._log("error", why)
        super().left(nodes, why)

    def close(self) -> None:
        """Do nothing: the jobs run on and are left to the next coordinator."""

    def _log(self, level: str, text: str, node: int | None = None) -> None:
        """Log a message; one about a node names the node's job and cell too."""
        job, cell = (None, None) if node is None else self.place_of(node)
        number = None if job is None else job.spec.number
        self.hooks.logged(LogRecord(level, "coordinator", text, time.time(), node, cell, number))

    def _cpu_seconds(self) -> dict[str, float]:
        return self._roster.cpu_seconds()
