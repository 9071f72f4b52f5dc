"""The dispatcher of a service: its processes outlive it, and whatever dies of them is replaced."""

import time
from typing import Any

import zenoh

from coordinator.dispatcher import Dispatcher
from coordinator.hooks import Hooks
from coordinator.roster import Roster
from wire.keys import Keys


class Staff(Dispatcher):
    """Runs the jobs of nodes that others have launched.

    Args:
        session: through the router.
        keys: of the cluster.
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

    def close(self) -> None:
        """Leave the jobs to whoever comes next."""

    def _cpu_seconds(self) -> dict[str, float]:
        return self._roster.cpu_seconds()
