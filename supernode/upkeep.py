"""The life of `supernode up`: one cluster in one state folder, from its start until somebody ends it.

This process is the cluster's lifeline: when it ends, however it ends, every process of the cluster does.
"""

import argparse
import importlib.util
import os
import queue
import secrets
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from coordinator.errors import ClusterFailed
from coordinator.launcher import Launcher, ServiceOptions
from problems.errors import BadInput
from supernode.client import Client
from supernode.whereabouts import Card, Place, occupy, remove_card, write_card
from wire import sessions

if TYPE_CHECKING:
    from supernode.dashboard.door import Door
    from supernode.dashboard.keeper import Keeper

_READY_WITHIN = 120.0  # seconds; a thousand nodes on two cores take less than ten


@dataclass(frozen=True)
class Wish:
    """What `up` was asked for; see its options."""

    topology: str
    listen: tuple[str, ...]
    database: str | None
    max_queue: int | None
    log_json: bool | None
    keep_days: float
    keep_records: int
    allow_modules: tuple[str, ...]
    dashboard: "Door | None" = None


def wish_of(options: argparse.Namespace) -> Wish:
    """The options, checked.

    Raises:
        BadInput: if one is wrong.
    """
    for needed in ("sqlalchemy", "structlog"):
        if importlib.util.find_spec(needed) is None:
            raise BadInput(f"up: expected {needed} to be installed: pip install 'supernode[service]'")
    for endpoint in options.listen:
        Place.at(endpoint, "--listen")
    if options.max_queue is not None and options.max_queue < 0:
        raise BadInput(f"--max-queue: expected at least 0, found {options.max_queue}")
    spec = _topology(options)
    modules = tuple(options.allow_module)
    keep = check_keep(options.keep_days, options.keep_records)
    door = wished_door(options)
    return Wish(
        spec, tuple(options.listen), options.database, options.max_queue, options.log_json, *keep, modules, door
    )


def wished_door(options: argparse.Namespace) -> "Door | None":
    """Where a dashboard is asked to listen, if one is.

    Raises:
        BadInput: if it cannot be there.
    """
    if options.dashboard is None:
        if options.dashboard_token_file is not None:
            raise BadInput("--dashboard-token-file: expected --dashboard too")
        return None
    from supernode.dashboard.door import door_of

    return door_of(options.dashboard, options.dashboard_token_file)


def check_keep(days: float, records: int) -> tuple[float, int]:
    """How much is kept, if it can be so.

    Raises:
        BadInput: if not.
    """
    if not days > 0:  # NaN is not either
        raise BadInput(f"--keep-days: expected a number greater than 0, found {days:g}")
    if records < 1:
        raise BadInput(f"--keep-records: expected at least 1, found {records}")
    return days, records


def _topology(options: argparse.Namespace) -> str:
    import topologies

    if options.nodes is not None:
        if options.nodes < 1:
            raise BadInput(f"--nodes: expected at least 1, found {options.nodes}")
        return topologies.torus_of(options.nodes)
    try:
        return topologies.parse(options.topology or "torus 4x4").spec
    except ValueError as error:
        raise BadInput(f"--topology: {error}") from error


class Upkeep:
    """One cluster in one state folder."""

    def __init__(self, folder: Path, wish: Wish) -> None:
        self.folder = folder.absolute()
        self._wish = wish
        self._ends: queue.SimpleQueue[str | None] = queue.SimpleQueue()  # why it ends; None if it was asked to

    def run(self, say: Callable[[str], None]) -> None:
        """Start, ``say`` one line when the cluster answers, and keep it up until Ctrl-C, a signal or `down`.

        Raises:
            BadInput: if the state folder cannot be used.
            StoreFailed: if the database cannot be used.
            ClusterFailed: if a cluster is up there already, or this one does not come up or breaks.
        """
        lock = occupy(self.folder)
        try:
            with self._ending_by_signals():
                self._keep_up(say)
        finally:
            remove_card(self.folder)
            os.close(lock)

    def _keep_up(self, say: Callable[[str], None]) -> None:
        self._try_the_database()
        with self._dashboard() as dashboard:
            self._keep_cluster_up(say, dashboard)

    @contextmanager
    def _dashboard(self) -> "Iterator[Keeper | None]":
        """The socket is there before anything is launched: an address that is taken is an error at once."""
        if self._wish.dashboard is None:
            yield None
            return
        from supernode.dashboard.keeper import Keeper

        keeper = Keeper(self.folder, self._wish.dashboard)
        try:
            yield keeper
        finally:
            keeper.close()

    def _keep_cluster_up(self, say: Callable[[str], None], dashboard: "Keeper | None") -> None:
        cluster = secrets.token_hex(4)
        launcher = self._launch(cluster)
        try:
            if not launcher.started.wait(_READY_WITHIN):
                raise ClusterFailed(f"not ready within {_READY_WITHIN:.0f} s")
            endpoint = sessions.unix_socket(launcher.folder, "router")
            nodes = self._wait_until_ready(endpoint)
            if nodes is None:
                return
            write_card(self.folder, Card(endpoint, cluster, os.getpid(), version("supernode")))
            listens = "".join(f", {each}" for each in self._wish.listen)
            if dashboard is not None:
                dashboard.start()
                listens += f", dashboard {dashboard.address}"
            say(f"up: {nodes} nodes ({self._wish.topology}) in {self.folder}{listens}")
            self._raise_unless_asked(self._ends.get())
        finally:
            remove_card(self.folder)
            launcher.close()

    def _try_the_database(self) -> None:
        """Before anything is launched: from then on one that is away is waited for."""
        from coordinator.database import url_in
        from coordinator.store import Store

        Store(self._wish.database or url_in(self.folder)).close()

    def _launch(self, cluster: str) -> Launcher:
        service = ServiceOptions(
            state=self.folder,
            database=self._wish.database,
            listen=self._wish.listen,
            max_queue=self._wish.max_queue,
            log_json=self._wish.log_json,
            keep_days=self._wish.keep_days,
            keep_records=self._wish.keep_records,
            allow_modules=self._wish.allow_modules,
        )
        return Launcher(cluster, self._wish.topology, self._ends.put, service=service)

    def _wait_until_ready(self, endpoint: str) -> int | None:
        """Until the coordinator says how many nodes there are; None if it is to end before."""
        until = time.monotonic() + _READY_WITHIN
        while True:
            try:
                with Client(Place.at(endpoint)) as client:
                    return len(client.status()["nodes"])
            except ClusterFailed:
                if time.monotonic() > until:
                    raise
            if not self._ends.empty():
                self._raise_unless_asked(self._ends.get())
                return None

    def _raise_unless_asked(self, reason: str | None) -> None:
        if reason is not None:
            raise ClusterFailed(reason)

    @contextmanager
    def _ending_by_signals(self) -> Iterator[None]:
        """Ctrl-C and SIGTERM end the cluster in good order."""
        kinds = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        before = [signal.signal(kind, lambda *_: self._ends.put(None)) for kind in kinds]
        try:
            yield
        finally:
            for kind, handler in zip(kinds, before, strict=True):
                signal.signal(kind, handler)
