"""A cluster on Ray: agents, router, coordinator and spy are actors that Ray keeps alive.

An actor runs one process of the cluster (docs/deploy.md) and ends when that process does; then Ray starts both again,
if need be on another machine. What a process writes goes to the actor's log, which Ray keeps and shows.
"""

from __future__ import annotations

import os
import secrets
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from coordinator.errors import ClusterFailed
from problems.errors import BadInput
from supernode.client.client import Client, ClientJob
from supernode.client.cluster_info import Place
from wire.seal import SECRET_BYTES

_READY_WITHIN = 300.0  # seconds; an actor on a new machine may compile kernels first
_ENDED_WITHIN = 20.0  # seconds; an actor whose machine is gone does not answer
_LOOK_AGAIN = 0.2  # seconds
_PORTS = 4  # of each node, see docs/deploy.md
_SIGNAL = "TERM"  # what a process gets when its actor dies, however that dies


class Role:
    """One process of the cluster, in an actor.

    Args:
        command: the arguments of `supernode`; ``<ADDRESS>``, ``<SECRET>`` and ``<FOLDER>`` stand for this machine, the
            secret's file, and a folder that an actor finds again when it is started anew on the same machine.
        secret: the cluster's secret.
        name: the actor's name, unique among all clusters.
    """

    def __init__(self, command: Sequence[str], secret: str, name: str) -> None:
        self._folder = Path(tempfile.gettempdir()) / f"supernode-{name}"
        self._folder.mkdir(mode=0o700, exist_ok=True)
        file = self._folder / "secret"
        file.touch(mode=0o600)
        file.write_text(secret, encoding="ascii")
        values = {"<ADDRESS>": _address(), "<SECRET>": str(file), "<FOLDER>": str(self._folder)}
        arguments = [_filled(each, values) for each in command]
        # util-linux' setpriv, since a signal by preexec_fn is not safe beside Ray's threads.
        lifeline = ["setpriv", "--pdeathsig", _SIGNAL]
        self._process = subprocess.Popen([*lifeline, sys.executable, "-m", "supernode", *arguments])
        self._is_ending = False
        threading.Thread(target=self._end_with_it, daemon=True).start()

    def _end_with_it(self) -> None:
        self._process.wait()
        if not self._is_ending:
            os._exit(1)  # Ray starts the actor again, and with it the process

    def end(self) -> None:
        """End the process, and remove what it has left on this machine."""
        self._is_ending = True
        self._process.kill()
        self._process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)

    def address(self) -> str:
        """Return the address of this machine, once the process has been started."""
        return _address()


def _filled(text: str, values: dict[str, str]) -> str:
    for name, value in values.items():
        text = text.replace(name, value)
    return text


def _address() -> str:
    import ray

    return str(ray.util.get_node_ip_address())  # type: ignore[no-untyped-call]


class RayCluster:
    """A cluster on the machines of a Ray cluster; a context manager with the interface of `LocalCluster`.

    The actors are spread over the machines (placement group ``SPREAD``), so that an agent whose machine goes comes
    back on another one within seconds, under its name and with its nodes' numbers. ``STRICT_SPREAD`` was not taken: it
    would leave an agent without a machine until Ray has a new one. Router, coordinator and spy share the first place;
    when its machine goes, so does the cluster::

        with supernode.RayCluster(nodes=64) as cluster:
            result = cluster.submit(supernode.load("examples/arm-ik.toml"), torus="8x8", seed=1).result()

    Args:
        nodes: how many nodes there shall be on all machines.
        address: the Ray cluster, such as ``ray://head:10001``; None: the one that this process is connected with, or
            that runs on this machine.
        hosts: the number of agents; by default one for each machine that Ray has.
        state: the folder that keeps the jobs, on the first machine or shared; by default they are kept until the end.

    Raises:
        BadInput: if Ray is not installed, or a number makes no sense.
        ClusterFailed: if the nodes have not joined in time.
    """

    def __init__(
        self, nodes: int = 16, *, address: str | None = None, hosts: int | None = None, state: str | None = None
    ) -> None:
        self._ray = _connected(address)
        self._hosts = len(_machines(self._ray)) if hosts is None else hosts
        if not 1 <= self._hosts <= nodes:
            raise BadInput(f"nodes: expected at least one for each of {self._hosts} hosts, found {nodes}")
        self._shares = [nodes // self._hosts + (host < nodes % self._hosts) for host in range(self._hosts)]
        self._secret = secrets.token_hex(SECRET_BYTES)
        self._name = secrets.token_hex(4)
        self._actors: list[Any] = []
        self._client: Client | None = None
        self._group = self._ray.util.placement_group([{"CPU": 1.0}] * self._hosts, strategy="SPREAD")
        try:
            self._start(nodes, state or "<FOLDER>")
        except BaseException:
            self.close()
            raise

    def _start(self, nodes: int, state: str) -> None:
        self._ray.get(self._group.ready(), timeout=_READY_WITHIN)
        self._port = self._on(0, _free_ports, 1 + _PORTS * nodes)
        router = self._actor(0, "router", "--listen", f"tcp/0.0.0.0:{self._port}")
        self.connect = f"tcp/{self._ray.get(router.address.remote())}:{self._port}"
        member = ("--connect", self.connect, "--secret-file", "<SECRET>")
        self._actor(0, "coordinator", *member, "--nodes", str(nodes), "--state", state)
        self._actor(0, "spy", *member)
        port = self._port + 1  # agents may share a machine
        for host, share in enumerate(self._shares):
            where = ("--host", f"agent-{host}", "--listen", f"tcp/<ADDRESS>:{port}")
            self._actor(host, "node", *member, "--nodes", str(share), *where)
            port += _PORTS * share
        self._client = self._reached(nodes)

    def _actor(self, bundle: int, *command: str) -> Any:
        """Start an actor at a place of the group, and return it."""
        strategy = self._ray.util.scheduling_strategies.PlacementGroupSchedulingStrategy(
            self._group, placement_group_bundle_index=bundle
        )
        share = 0.4 if command[0] == "node" else 0.2  # of the place's processor; four actors share the first one
        options = {"num_cpus": share, "max_restarts": -1, "scheduling_strategy": strategy}
        name = f"{self._name}-{len(self._actors)}"
        actor = self._ray.remote(Role).options(**options).remote(command, self._secret, name)
        self._actors.append(actor)
        return actor

    def _on(self, bundle: int, function: Any, *arguments: Any) -> Any:
        """Call a function at a place of the group, and return what it returns."""
        strategy = self._ray.util.scheduling_strategies.PlacementGroupSchedulingStrategy(
            self._group, placement_group_bundle_index=bundle
        )
        task = self._ray.remote(function).options(num_cpus=0.1, scheduling_strategy=strategy)
        return self._ray.get(task.remote(*arguments))

    def _reached(self, nodes: int) -> Client:
        """Return a client once so many nodes have joined."""
        until = time.monotonic() + _READY_WITHIN
        while time.monotonic() < until:
            try:
                client = Client(Place.at(self.connect))
            except ClusterFailed:
                continue
            while time.monotonic() < until:
                if len(client.status()["nodes"]) >= nodes:
                    return client
                time.sleep(_LOOK_AGAIN)
        raise ClusterFailed(f"{nodes} nodes have not joined within {_READY_WITHIN:.0f} s; Ray's logs say more")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def client(self) -> Client:
        """A client of the cluster."""
        assert self._client is not None, "made at the start"
        return self._client

    def submit(self, file: Any, **run: Any) -> ClientJob:
        """Submit a job; see `Client.submit`."""
        return self.client.submit(file, **run)

    def status(self) -> dict[str, Any]:
        """Return the state of the cluster; see `Client.status`."""
        return self.client.status()

    def close(self) -> None:
        """End all processes, and give the machines back to Ray."""
        if self._client is not None:
            self._client.close()
            self._client = None
        ending = [actor.end.remote() for actor in reversed(self._actors)]
        self._ray.wait(ending, num_returns=len(ending), timeout=_ENDED_WITHIN)
        for actor in self._actors:
            self._ray.kill(actor)
        self._actors.clear()
        self._ray.util.remove_placement_group(self._group)


def _connected(address: str | None) -> Any:
    """Return the module ray, connected with a cluster.

    Raises:
        BadInput: if it is not installed, or there is no cluster at the address.
    """
    try:
        import ray
        import ray.util.scheduling_strategies
    except ImportError:
        raise BadInput("ray: expected this package, found none; pip install 'supernode[ray]'") from None
    if not ray.is_initialized():
        try:
            ray.init(address=address or "auto", log_to_driver=False)
        except ConnectionError as error:
            raise BadInput(f"ray: expected a Ray cluster at {address or 'this machine'}, found none: {error}") from None
    return ray


def _machines(ray: Any) -> list[Any]:
    return [each for each in ray.nodes() if each["Alive"] and each["Resources"].get("CPU", 0) >= 1]


def _free_ports(count: int) -> int:
    """Return the first of a row of ports of which nobody uses the first now, below those that the kernel gives."""
    for first in range(20000, 32000, 100):
        with socket.socket() as probe:
            try:
                probe.bind(("", first))
            except OSError:
                continue
            if first + count < 32768:
                return first
    raise ClusterFailed("expected a free port from 20000 on, found none")
