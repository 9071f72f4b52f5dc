"""The coordinator of a cluster whose processes live in several places: it launches nobody, nodes join it."""

import time
from functools import partial
from typing import Any

import zenoh

from coordinator.dispatcher import Dispatcher
from coordinator.homes import PORTS
from coordinator.hooks import Hooks
from coordinator.host_book import LEFT_AFTER, HostBook
from coordinator.roster import Roster
from coordinator.service import Options, run
from node.berth import Berth
from wire.hosts import Host
from wire.keys import Keys


def preside(berth: Berth, options: Options, max_queue: int | None) -> None:
    """Be the coordinator until a client, or SIGTERM, ends it; ``options.nodes`` are expected at least."""
    run(berth, options, partial(JoinedStaff, max_queue=max_queue))


class JoinedStaff(Dispatcher):
    """The dispatcher of nodes that come and go by hosts; a host forks anew those of its nodes that die."""

    def __init__(self, session: zenoh.Session, keys: Keys, nodes: int, hooks: Hooks, *, max_queue: int | None) -> None:
        now = time.time_ns() // 1_000_000
        super().__init__(
            session,
            keys,
            "",
            hooks=hooks,
            cpu_seconds=self._cpu_seconds,
            replaces=True,
            max_queue=max_queue,
            first_wiring=now,  # no coordinator before this one has come so far
            expected=nodes,
        )
        self._first_port = now % PORTS
        self._roster: Roster
        self._book = HostBook(session, keys, self._came, self._leave)
        self._roster = Roster(session, keys, self.replaced, self.joined)
        self._roster.look()

    def nodes(self) -> list[dict[str, Any]]:
        """Each node, as `status` shows it."""
        with self._lock:
            here = self._scheduler.here
        return self._roster.nodes(here, self.job_on)

    def _cpu_seconds(self) -> dict[str, float]:
        return self._roster.cpu_seconds()

    def close(self) -> None:
        """Leave the jobs to whoever comes next."""

    def _came(self, host: Host) -> None:
        with self._lock:
            self._homes.move_in(host, self._first_port)

    def _leave(self, host: Host) -> None:
        numbers = ", ".join(map(str, host.nodes))
        self.left(host.nodes, f"host {host.name} has been away for {LEFT_AFTER:.0f} s, with its nodes {numbers}")
        self._roster.forget(host.nodes)
