"""The life of a cluster that takes jobs: that of `supernode up`, until somebody ends it, or for one run that is shown.

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
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from coordinator.errors import ClusterFailed
from coordinator.launcher import Launcher, ServiceOptions
from problems.errors import BadInput
from supernode.client import Client
from supernode.cluster_info import ClusterInfo, Place, occupy, remove_card, write_info
from wire import sessions

if TYPE_CHECKING:
    from supernode.dashboard.keeper import Keeper
    from supernode.dashboard.listen_address import ListenAddress

_READY_WITHIN = 120.0  # seconds; a thousand nodes on two cores take less than ten


@dataclass(frozen=True)
class LaunchRequest:
    """What `up` was asked for; see its options, and `coordinator.launcher.ServiceOptions`."""

    topology: str
    service: ServiceOptions
    dashboard: "ListenAddress | None" = None
    force: bool = False


@dataclass(frozen=True)
class Up:
    """A cluster that answers.

    Attributes:
        cluster: its name.
        endpoint: of its router.
        nodes: how many it has.
        dashboard: the address of its dashboard, if it has one.
    """

    cluster: str
    endpoint: str
    nodes: int
    dashboard: str | None


def launch_request_of(options: argparse.Namespace, folder: Path) -> LaunchRequest:
    """The options, checked, for a cluster in that state folder.

    Raises:
        BadInput: if one is wrong.
    """
    check_library("up")
    for endpoint in options.listen:
        Place.at(endpoint, "--listen")
    if options.max_queue is not None and options.max_queue < 0:
        raise BadInput(f"--max-queue: expected at least 0, found {options.max_queue}")
    keep_days, keep_records = check_keep(options.keep_days, options.keep_records)
    service = ServiceOptions(
        state=folder.absolute(),
        database=options.database,
        listen=tuple(options.listen),
        max_queue=options.max_queue,
        log_json=options.log_json,
        keep_days=keep_days,
        keep_records=keep_records,
        allow_modules=tuple(options.allow_module),
    )
    return LaunchRequest(_topology(options), service, wanted_address(options), options.force)


def check_library(command: str) -> None:
    """What a cluster that takes jobs needs beside the rest.

    Raises:
        BadInput: if it is missing.
    """
    if importlib.util.find_spec("sqlalchemy") is None:
        raise BadInput(f"{command}: expected sqlalchemy to be installed: pip install 'supernode[service]'")


def wanted_address(options: argparse.Namespace) -> "ListenAddress | None":
    """Where a dashboard is asked to listen, if one is.

    Raises:
        BadInput: if it cannot be there.
    """
    if options.dashboard is None:
        if options.dashboard_token_file is not None:
            raise BadInput("--dashboard-token-file: expected --dashboard too")
        return None
    from supernode.dashboard.listen_address import door_of

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
        raise BadInput(f"--topology: {error}") from None


class _AskedToEndError(Exception):
    """Somebody wants the cluster to end."""


class Supervisor:
    """One cluster."""

    def __init__(self, request: LaunchRequest) -> None:
        self._wish = request
        self._ends: queue.SimpleQueue[str | None] = queue.SimpleQueue()  # why it ends; None if it was asked to

    def run(self, folder: Path, say: Callable[[str], None], occupied: Callable[[], None] = lambda: None) -> None:
        """Start, ``say`` one line when the cluster answers, and keep it up until Ctrl-C, a signal or `down`.

        Args:
            folder: its state folder, where others find it.
            say: is told how many nodes there are, and where.
            occupied: called when the folder is this cluster's, before any process is started.

        Raises:
            BadInput: if the state folder cannot be used.
            StoreFailed: if the database cannot be used.
            ClusterFailed: if a cluster is up there already, or this one does not come up or breaks.
        """
        lock = occupy(folder)
        try:
            occupied()
            with self._ending_by_signals(), suppress(_AskedToEndError):
                self._try_the_database(folder)
                with self.up() as up:
                    write_info(folder, ClusterInfo(up.endpoint, up.cluster, os.getpid(), version("supernode")))
                    say(self._line(folder, up))
                    self._wait_for_the_end()
        finally:
            remove_card(folder)
            os.close(lock)

    @contextmanager
    def up(self) -> Iterator[Up]:
        """The cluster, from when it answers on.

        Raises:
            BadInput: if its dashboard cannot be where it should, or this machine cannot hold so many nodes.
            ClusterFailed: if it does not come up.
        """
        cluster = secrets.token_hex(4)
        with self._dashboard() as dashboard:
            request = self._wish
            launcher = Launcher(cluster, request.topology, self._ends.put, service=request.service, force=request.force)
            try:
                if not launcher.started.wait(_READY_WITHIN):
                    raise ClusterFailed(f"not ready within {_READY_WITHIN:.0f} s")
                endpoint = sessions.unix_socket(launcher.folder, "router")
                nodes = self._wait_until_ready(endpoint)
                if dashboard is not None:
                    dashboard.start(endpoint)
                yield Up(cluster, endpoint, nodes, None if dashboard is None else dashboard.address)
            finally:
                launcher.close()

    @contextmanager
    def _dashboard(self) -> "Iterator[Keeper | None]":
        """The socket is there before anything is launched: an address that is taken is an error at once."""
        if self._wish.dashboard is None:
            yield None
            return
        from supernode.dashboard.keeper import Keeper

        keeper = Keeper(self._wish.dashboard, single=self._wish.service.state is None)
        try:
            yield keeper
        finally:
            keeper.close()

    def _line(self, folder: Path, up: Up) -> str:
        listens = "".join(f", {each}" for each in self._wish.service.listen)
        dashboard = "" if up.dashboard is None else f", dashboard {up.dashboard}"
        return f"up: {up.nodes} nodes ({self._wish.topology}) in {folder}{listens}{dashboard}"

    def _try_the_database(self, folder: Path) -> None:
        """Before anything is launched: from then on one that is away is waited for."""
        from coordinator.database import url_in
        from coordinator.store import Store

        Store(self._wish.service.database or url_in(folder)).close()

    def _wait_until_ready(self, endpoint: str) -> int:
        """Until the coordinator says how many nodes there are."""
        until = time.monotonic() + _READY_WITHIN
        while True:
            try:
                with Client(Place.at(endpoint)) as client:
                    return len(client.status()["nodes"])
            except ClusterFailed:
                if time.monotonic() > until:
                    raise
            if not self._ends.empty():
                self._wait_for_the_end()

    def _wait_for_the_end(self) -> NoReturn:
        reason = self._ends.get()
        if reason is None:
            raise _AskedToEndError
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
