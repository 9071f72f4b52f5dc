"""Start, supervise and end a cluster that takes jobs: for `supernode up`, or for one run that a dashboard shows.

The process that runs this is the cluster's lifeline: when it ends, however it ends, every process of the cluster does.
"""

import argparse
import importlib.util
import os
import queue
import secrets
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import topologies
from coordinator.errors import ClusterFailed
from coordinator.launch.compilation import compile_missing
from coordinator.launch.launcher import Launcher, ServiceOptions
from coordinator.launch.sandbox import node_memory
from problems.errors import BadInput
from supernode.client.client import Client
from supernode.client.cluster_info import ClusterInfo, Place, occupy, remove_info, write_info
from supernode.deploy.engine_cluster import ENGINE_CLUSTER, EngineCluster
from supernode.launch.engines import start_on
from supernode.signals import on_ending_signals, wait_for_an_end
from wire import sessions

if TYPE_CHECKING:
    from supernode.dashboard.keeper import Keeper
    from supernode.dashboard.listen_address import ListenAddress

_LOOK_AGAIN = 0.2  # seconds
_READY_WITHIN = 120.0  # seconds to start the processes, and as long for the coordinator to answer; 1024 nodes take ten


@dataclass(frozen=True)
class LaunchRequest:
    """The cluster that `up` was asked for.

    Attributes:
        topology: how the nodes are linked, and how many there are.
        service: the options of a cluster that stays up.
        dashboard: where its dashboard listens; None for none.
        force: start it even if this machine cannot hold so many nodes.
        engine: where its processes run, if not on this machine; see `supernode.launch.engines`.
    """

    topology: str
    service: ServiceOptions
    dashboard: "ListenAddress | None" = None
    force: bool = False
    engine: str | None = None


@dataclass(frozen=True)
class Up:
    """A cluster that answers.

    Attributes:
        cluster: the cluster's name.
        endpoint: the endpoint of its router.
        nodes: how many nodes it has.
        dashboard: the address of its dashboard; None if it has none.
        processes: returns the ids of its processes by name, such as "node 7"; nothing if an engine runs them.
    """

    cluster: str
    endpoint: str
    nodes: int
    dashboard: str | None = None
    processes: Callable[[], Mapping[str, int]] = dict


def launch_request_of(options: argparse.Namespace, folder: Path, keys: Path | None) -> LaunchRequest:
    """Check the options of `up` and return the request for a cluster in a state folder.

    Args:
        options: the options.
        folder: the state folder.
        keys: the router's key folder; None for a cluster without keys.

    Raises:
        BadInput: if an option is wrong.
    """
    check_library("up")
    for endpoint in options.listen:
        Place.at(endpoint, "--listen")
    if options.max_queue is not None and options.max_queue < 0:
        raise BadInput(f"--max-queue: expected at least 0, found {options.max_queue}")
    if options.client_nodes is not None and options.client_nodes < 1:
        raise BadInput(f"--client-nodes: expected at least 1, found {options.client_nodes}")
    if options.sandbox and options.on is not None:
        raise BadInput(f"--sandbox: expected none with --on, whose nodes need a network, found --on {options.on}")
    keep_days, keep_records = check_keep(options.keep_days, options.keep_records)
    service = ServiceOptions(
        state=folder.absolute(),
        database=options.database,
        listen=tuple(options.listen),
        max_queue=options.max_queue,
        client_nodes=options.client_nodes,
        log_json=options.log_json,
        keep_days=keep_days,
        keep_records=keep_records,
        allow_modules=tuple(options.allow_module),
        node_timeout=options.node_timeout,
        eval_timeout=options.eval_timeout,
        node_memory=node_memory(options.node_memory, options.sandbox),
        checkpoint_every=options.checkpoint,
        keys=keys,
        sandbox=options.sandbox,
    )
    return LaunchRequest(_topology(options), service, wanted_address(options), options.force, options.on)


def check_library(command: str) -> None:
    """Check that the library is installed that only clusters that take jobs need.

    Args:
        command: the command that needs it, for the error.

    Raises:
        BadInput: if it is missing.
    """
    if importlib.util.find_spec("sqlalchemy") is None:
        raise BadInput(f"{command}: expected sqlalchemy to be installed: pip install 'supernode[service]'")


def wanted_address(options: argparse.Namespace) -> "ListenAddress | None":
    """Return where the options ask the dashboard to listen; None if no dashboard is asked for.

    Raises:
        BadInput: if the dashboard cannot listen there.
    """
    if options.dashboard is None:
        for name in ("token_file", "cert", "key", "insecure"):
            if getattr(options, f"dashboard_{name}"):
                raise BadInput(f"--dashboard-{name.replace('_', '-')}: expected --dashboard too")
        return None
    from supernode.dashboard.listen_address import listen_address_of

    return listen_address_of(
        options.dashboard,
        options.dashboard_token_file,
        options.dashboard_cert,
        options.dashboard_key,
        options.dashboard_insecure,
    )


def check_keep(days: float, records: int) -> tuple[float, int]:
    """Return the arguments if they are valid limits on what a store keeps.

    Raises:
        BadInput: if not.
    """
    if not days > 0:  # so that NaN is refused too
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
    """A signal or a client asked the cluster to end."""


class Supervisor:
    """Runs one cluster."""

    def __init__(self, request: LaunchRequest) -> None:
        self._request = request
        # Why the cluster ends; None if it was asked to. Signal handlers and the launcher's thread put, `run` takes.
        # A `Queue` could deadlock when a handler interrupts its own thread; the put of a SimpleQueue is reentrant.
        self._ends: queue.SimpleQueue[str | None] = queue.SimpleQueue()

    def run(self, folder: Path, say: Callable[[str], None], occupied: Callable[[], None] = lambda: None) -> None:
        """Start the cluster, report when it answers, and keep it up until Ctrl-C, a signal or `down`.

        Args:
            folder: the state folder, where clients find the cluster.
            say: called once with a line for people: how many nodes there are, and where.
            occupied: called when this process holds the folder's lock, before any process is started.

        Raises:
            BadInput: if the state folder cannot be used.
            StoreFailed: if the database cannot be used.
            ClusterFailed: if a cluster is up in the folder already, or this one does not come up or breaks.
        """
        lock = occupy(folder)
        try:
            occupied()
            with on_ending_signals(lambda: self._ends.put(None)), suppress(_AskedToEndError):
                self._try_the_database(folder)
                with self.up() as up:
                    write_info(folder, ClusterInfo(up.endpoint, up.cluster, os.getpid(), version("supernode")))
                    say(self._line(folder, up))
                    self._wait_for_the_end()
        finally:
            # The entry is removed before the lock is released: the next cluster in this folder writes its own.
            remove_info(folder)
            os.close(lock)

    @contextmanager
    def up(self) -> Iterator[Up]:
        """Start the cluster, yield it once it answers, and end it.

        Raises:
            BadInput: if the dashboard cannot listen at its address, this machine cannot hold so many nodes, or there is
                no such engine.
            ClusterFailed: if the cluster does not come up.
        """
        start = self._on_this_machine if self._request.engine is None else self._on_an_engine
        with self._dashboard() as dashboard, start() as up:
            if dashboard is not None:
                dashboard.start(up.endpoint)
            yield replace(up, dashboard=None if dashboard is None else dashboard.address)

    @contextmanager
    def _on_this_machine(self) -> Iterator[Up]:
        """Start the cluster on this machine; yield it once it answers."""
        cluster = secrets.token_hex(4)
        request = self._request
        compile_missing()
        launcher = Launcher(cluster, request.topology, self._ends.put, service=request.service, force=request.force)
        try:
            if not launcher.started.wait(_READY_WITHIN):
                raise ClusterFailed(f"not ready within {_READY_WITHIN:.0f} s")
            endpoint = sessions.unix_socket(launcher.folder, "router")
            nodes = self._wait_until_ready(endpoint)
            yield Up(cluster, endpoint, nodes, processes=lambda: dict(launcher.processes))
        finally:
            launcher.close()

    @contextmanager
    def _on_an_engine(self) -> Iterator[Up]:
        """Start the cluster on an engine; yield it."""
        request = self._request
        assert request.engine is not None, "that is why this is called"
        nodes = topologies.parse(request.topology).cells
        try:
            cluster = start_on(
                request.engine, nodes, request.service, lambda: not self._ends.empty(), force=request.force
            )
        except ClusterFailed:
            if not self._ends.empty():  # it was asked to end while it started
                self._wait_for_the_end()
            raise
        with cluster, self._looking_for_the_end_of(cluster, request.engine):
            yield Up(ENGINE_CLUSTER, cluster.connect, cluster.nodes)

    @contextmanager
    def _looking_for_the_end_of(self, cluster: EngineCluster, engine: str) -> Iterator[None]:
        """Look, on another thread, whether a client has ended the cluster."""
        done = threading.Event()

        def look() -> None:
            while not done.wait(_LOOK_AGAIN):
                try:
                    is_over, why = cluster.is_over(), None
                except Exception as error:  # of the engine, which has any kind
                    is_over, why = True, f"{engine}: {type(error).__name__}: {error}"
                if is_over:
                    self._ends.put(why)
                    return

        thread = threading.Thread(target=look, name="end of the engine's cluster")
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()

    @contextmanager
    def _dashboard(self) -> "Iterator[Keeper | None]":
        """Open the dashboard's socket before anything is launched, so that an address that is taken fails at once."""
        if self._request.dashboard is None:
            yield None
            return
        from supernode.dashboard.keeper import Keeper

        keeper = Keeper(self._request.dashboard, single=self._request.service.state is None)
        try:
            yield keeper
        finally:
            keeper.close()

    def _line(self, folder: Path, up: Up) -> str:
        listens = "".join(f", {each}" for each in self._request.service.listen)
        dashboard = "" if up.dashboard is None else f", dashboard {up.dashboard}"
        engine = "" if self._request.engine is None else f" on {self._request.engine}, {up.endpoint},"
        return f"up: {up.nodes} nodes ({self._request.topology}){engine} in {folder}{listens}{dashboard}"

    def _try_the_database(self, folder: Path) -> None:
        """Open the database once before anything is launched: a wrong URL fails here.

        Once it runs, the coordinator waits for a database that does not answer instead of failing.
        """
        from coordinator.store.database import url_in
        from coordinator.store.job_store import Store

        Store(self._request.service.database or url_in(folder)).close()

    def _wait_until_ready(self, endpoint: str) -> int:
        """Wait until the coordinator answers, and return how many nodes there are."""
        until = time.monotonic() + _READY_WITHIN
        while True:
            try:
                with Client(Place.at(endpoint)) as client:
                    return len(client.status()["nodes"])
            except ClusterFailed:
                if time.monotonic() > until:
                    raise
            # A cluster that has failed, or was asked to end, will never answer: do not wait for it.
            if not self._ends.empty():
                self._wait_for_the_end()

    def _wait_for_the_end(self) -> NoReturn:
        reason = wait_for_an_end(self._ends)
        if reason is None:
            raise _AskedToEndError
        raise ClusterFailed(reason)
