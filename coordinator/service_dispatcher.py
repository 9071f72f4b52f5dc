"""The dispatcher of a service: its processes outlive it, and whatever dies of them is replaced."""

import time
from collections.abc import Iterable
from typing import Any

import zenoh

from coordinator.dispatcher import Dispatcher
from coordinator.hooks import Hooks
from coordinator.roster import Roster
from wire.keys import Keys
from wire.news import LogRecord
from wire.seal import Seal


class ServiceDispatcher(Dispatcher):
    """Runs the jobs of nodes that others have launched.

    Args:
        session: through the router.
        keys: of the cluster.
        seal: by which its processes obey.
        hooks: told of what happens.
        topology: of the nodes, unless they join.
        wired: whether they have those links.
        max_queue: how many jobs may wait.
        expected: for a cluster whose nodes join, how many at least.
    """

    _roster: Roster  # made by those who know whom to tell of nodes that come

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        seal: Seal,
        hooks: Hooks,
        *,
        topology: str = "",
        wired: bool = False,
        max_queue: int | None,
        expected: int | None = None,
    ) -> None:
        self.began = time.time_ns() // 1_000_000
        super().__init__(
            session,
            keys,
            seal,
            topology,
            wired=wired,
            hooks=hooks,
            cpu_seconds=self._cpu_seconds,
            replaces=True,
            max_queue=max_queue,
            first_wiring=self.began,  # no coordinator before this one has come so far
            expected=expected,
        )

    def nodes(self) -> list[dict[str, Any]]:
        """Each node, as `status` shows it."""
        with self._lock:
            here = self._scheduler.here
        return self._roster.nodes(here, self.job_on)

    def spy(self) -> int | None:
        """The process of the spy, if there is one."""
        return self._roster.spy

    def replaced(self, node: int | None) -> None:
        """Another process lives in the place of a dead node, or of the dead spy."""
        whose = "as the spy" if node is None else f"on node {node}"
        self._log("warning", f"a process has died: another one lives {whose}", node)  # first: it may end the job
        super().replaced(node)

    def left(self, nodes: Iterable[int], why: str) -> None:
        """Nodes are gone that nothing replaces."""
        self._log("error", why)
        super().left(nodes, why)

    def close(self) -> None:
        """Leave the jobs to whoever comes next."""

    def _log(self, level: str, text: str, node: int | None = None) -> None:
        """Tell it; what is about a node is about the job there too."""
        job, cell = (None, None) if node is None else self.place_of(node)
        number = None if job is None else job.spec.number
        self.hooks.logged(LogRecord(level, "coordinator", text, time.time(), node, cell, number))

    def _cpu_seconds(self) -> dict[str, float]:
        return self._roster.cpu_seconds()
