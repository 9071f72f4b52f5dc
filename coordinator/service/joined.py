"""The coordinator of a cluster on several machines or containers: it launches no nodes, hosts of nodes join it."""

import contextlib
import threading
import time
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import Any

import zenoh

from coordinator.jobs.alarms import NO_JOB, Alarms
from coordinator.jobs.client_limits import ClientLimits
from coordinator.jobs.hooks import Hooks
from coordinator.jobs.job import JobEntry, JobSpec, Moved, Placement, Returned
from coordinator.jobs.running import EVAL_TIMEOUT
from coordinator.service.host_book import HOST_TIMEOUT, HostBook
from coordinator.service.process import Options, run
from coordinator.service.roster import Roster
from coordinator.service.service_dispatcher import ServiceDispatcher
from node.node_config import NodeConfig
from wire.hosts import Host
from wire.keys import Keys
from wire.seal import Seal

_FOUND_WITHIN, _LOOK_AGAIN = 2.0, 0.02  # seconds; a running host finds a restarted router in a fifth of one
_AWAITED_EVERY = 1.0  # seconds between two looks for nodes whose host is back


def preside(config: NodeConfig, options: Options, limits: ClientLimits) -> None:
    """Run the coordinator until a client or SIGTERM ends it; at least ``options.nodes`` nodes are expected."""
    make_dispatcher = partial(
        JoinedDispatcher,
        seal=Seal(config.secret),
        limits=limits,
        most_nodes=options.most_nodes,
        eval_timeout=options.eval_timeout,
        host_timeout=options.host_timeout,
    )
    run(config, replace(options, joined=True), make_dispatcher)


class JoinedDispatcher(ServiceDispatcher):
    """A dispatcher whose nodes come and go host by host. A host itself replaces those of its nodes that die."""

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        nodes: int,
        hooks: Hooks,
        *,
        seal: Seal,
        limits: ClientLimits,
        most_nodes: int | None = None,
        eval_timeout: float = EVAL_TIMEOUT,
        host_timeout: float = HOST_TIMEOUT,
    ) -> None:
        super().__init__(session, keys, seal, hooks, limits=limits, expected=nodes, eval_timeout=eval_timeout)
        self._moving: dict[int, int] = {}  # nodes that leave, each with the job whose cells are on their way from it
        self._forgotten: set[int] = set()  # nodes of hosts that were given up; only the book's thread uses it
        self._awaited: set[int] = set()  # those of them whose hosts are back, and that have not been seen yet
        self._next_look = Alarms(lambda _: self._look_for_the_awaited())
        callbacks = self._came, self._went, self._leave, self._drain, self._complain
        self._book = HostBook(session, keys, seal, *callbacks, hooks, most_nodes, host_timeout)
        # After the book: when a node is reported, its host must be known already, or a wiring would lack its address.
        self._roster = Roster(session, keys, self.replaced, self.joined, self.returned, self.heard)
        self._roster.look()

    def nodes(self) -> list[dict[str, Any]]:
        """Return each node as the command `status` shows it, with the name of its host."""
        return [node | {"host": self._book.host_of(node["node"])} for node in super().nodes()]

    def _came(self, host: Host) -> None:
        with self._lock:
            self._node_hosts.move_in(host)
            self._scheduler.stay(host.nodes)  # it may have been about to end before, or out of reach
        self._start()
        # Nodes that were back a moment before their host was given up will not come again.
        if back := self._forgotten.intersection(host.nodes):
            self._forgotten -= back
            with self._lock:
                self._awaited |= back
            self._look_for_the_awaited()

    def _look_for_the_awaited(self) -> None:
        """Look for nodes until they are seen: on a busy machine Zenoh may not tell of a token that is there."""
        with self._lock:
            awaited = frozenset(self._awaited)
        with contextlib.suppress(zenoh.ZError):  # the session may be closed
            self._roster.look_for(awaited)
        with self._lock:
            self._awaited.difference_update(self._scheduler.here)
            if self._awaited:
                self._next_look.set(NO_JOB, time.monotonic() + _AWAITED_EVERY)

    def _went(self, host: Host) -> None:
        """Give no further job to the nodes of a host that is out of reach; those that have one keep it."""
        with self._lock:
            self._scheduler.rest(host.nodes)

    def _complain(self, error: str) -> None:
        self._log("error", f"the record of hosts: {error}")

    def placed(self, job: JobEntry, placement: Placement) -> None:
        """Note also that the job has left nodes, unless another move is on its way, which may begin at those."""
        number, nodes = job.spec.number, placement.nodes
        with self._lock:
            if nodes == (self._scheduler.nodes_of(number) or ())[: len(nodes)]:
                self._moving = {node: mover for node, mover in self._moving.items() if mover != number}
        super().placed(job, placement)

    def replaced(self, node: int | None, crash: str = "") -> None:
        """See `Dispatcher.replaced`; also a job whose cell is still on its way from the node is told."""
        super().replaced(node, crash)
        if node is not None:
            self._tell_movers([node], crash)

    def returned(self, node: int) -> None:
        """See `Dispatcher.returned`; also a job whose cell is still on its way from the node is told."""
        super().returned(node)
        with self._lock:
            if (job := self._mover(node)) is not None:
                job.queue.put(Returned(node))

    def left(self, nodes: Iterable[int], why: str) -> None:
        """See `Dispatcher.left`; a job whose cells were still on their way goes on without them."""
        nodes = tuple(nodes)
        super().left(nodes, why)
        self._tell_movers(nodes)

    def _is_stray(self, node: int, job: int) -> bool:
        """See `ServiceDispatcher`; a node that the job is about to leave still has a part in it."""
        return self._moving.get(node) != job and super()._is_stray(node, job)

    def _tell_movers(self, nodes: Iterable[int], crash: str = "") -> None:
        with self._lock:
            for node in nodes:
                if (job := self._mover(node)) is not None:
                    job.replaced(node, crash)

    def _mover(self, node: int) -> JobEntry | None:
        return self.jobs.get(self._moving.get(node, -1))

    def adopt(self, spec: JobSpec, placement: Placement) -> JobEntry:
        """Take over a job that runs already, also if some of its nodes are on a host that is out of reach for now.

        Raises:
            ValueError: if its nodes are not free, nothing is known of their hosts, or all these are out of reach. A job
                begins again elsewhere rather than wait for them: most likely all was ended, and some will not come
                back. If they were only cut off, their nodes are told to forget the job as soon as they are heard.
        """
        self._wait_for_one_of(placement.nodes)
        with self._lock:
            known = {node for node in placement.nodes if self._node_hosts.place_of(node)}
            away = known.difference(self._scheduler.here)
            if len(away) == len(placement.nodes):
                raise ValueError("all its hosts are out of reach, so it begins again elsewhere")
            self._scheduler.join(away)
            try:
                return super().adopt(spec, placement)
            except ValueError:
                self._scheduler.leave(away)
                raise

    def _wait_for_one_of(self, nodes: Iterable[int]) -> None:
        """Wait until one of these nodes is here, or for a moment: the router may have been started anew as well."""
        until = time.monotonic() + _FOUND_WITHIN
        while time.monotonic() < until:
            with self._lock:
                if not set(self._scheduler.here).isdisjoint(nodes):
                    return
            threading.Event().wait(_LOOK_AGAIN)

    def drain(self, nodes: Iterable[int]) -> list[int]:
        """Move jobs away from nodes that are about to leave; return those nodes that some job still needs.

        Call it again until it returns none: jobs move only where enough nodes are free, and that takes a moment.
        """
        with self._lock:
            for number, moved in self._scheduler.drain(nodes).items():
                self._moving |= dict.fromkeys(moved, number)
                self.jobs[number].queue.put(Moved(self._scheduler.nodes_of(number) or ()))
            needed = {node for number in self.jobs for node in self._scheduler.nodes_of(number) or ()}
            needed |= {node for node, number in self._moving.items() if number in self.jobs}
            return sorted(needed.intersection(nodes))

    def _drain(self, host: Host) -> list[int]:
        if not self._is_restored:  # jobs may need them that are not known yet
            return list(host.nodes)
        needed = self.drain(host.nodes)
        if not needed:
            self._log("info", f"host {host.name} leaves; no job needs its nodes {', '.join(map(str, host.nodes))}")
        return needed

    def _leave(self, host: Host, fault: str) -> None:
        self.left(host.nodes, fault)
        self._roster.forget(host.nodes)
        with self._lock:
            self._awaited.difference_update(host.nodes)
        self._forgotten.update(host.nodes)
