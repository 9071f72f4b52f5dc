"""A cluster on Ray: agents, router, coordinator and spy are actors that Ray keeps alive.

An actor runs one process of the cluster (docs/deploy.md) and ends when that process does; then Ray starts both again,
if need be on another machine. What a process writes goes to the actor's log, which Ray keeps and shows.
"""

from __future__ import annotations

import os
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from coordinator.errors import ClusterFailed
from coordinator.jobs.node_hosts import PORTS
from problems.errors import BadInput
from supernode.deploy.addresses import FIRST_PORT, MOST_PORTS, free_port
from supernode.deploy.engine_cluster import READY_WITHIN, EngineCluster, shares, trust
from wire.seal import SECRET_BYTES

_ENDED_WITHIN = 20.0  # seconds; an actor whose machine is gone does not answer
_LOOK_AGAIN = 0.5  # seconds
_PATIENCE = 5.0  # seconds until a process that does not end is killed
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
        self._ends = command[0] == "coordinator"  # with status 0 only because a client has ended it
        # Not "supernode-", which is for folders that a lock keeps from being removed.
        self._folder = Path(tempfile.gettempdir()) / f"sn-ray-{name}"
        self._folder.mkdir(mode=0o700, exist_ok=True)
        file = self._folder / "secret"
        file.touch(mode=0o600)
        file.write_text(secret, encoding="ascii")
        values = {"<ADDRESS>": _address(), "<SECRET>": str(file), "<FOLDER>": str(self._folder)}
        arguments = [_filled(each, values) for each in command]
        # util-linux' setpriv, since a signal by preexec_fn is not safe beside Ray's threads.
        lifeline = ["setpriv", "--pdeathsig", _SIGNAL]
        self._process = subprocess.Popen([*lifeline, sys.executable, "-m", "supernode", *arguments])
        self._is_ending = self._is_over = False
        threading.Thread(target=self._end_with_it, daemon=True).start()

    def _end_with_it(self) -> None:
        self._is_over = self._process.wait() == 0 and self._ends
        if not self._is_ending and not self._is_over:
            os._exit(1)  # Ray starts the actor again, and with it the process

    def is_over(self) -> bool:
        """Return whether the process has ended because it was asked to, so that it is not started again."""
        return self._is_over

    def end(self) -> None:
        """End the process, and remove what it has left on this machine."""
        self._is_ending = True
        self._process.send_signal(signal.SIGHUP)  # which an agent does not take for a notice to drain
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
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

    return str(ray.util.get_node_ip_address())


class RayCluster(EngineCluster):
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
        hosts: the number of agents; by default one for each machine that Ray has, and no more than nodes.
        options: further options of `supernode coordinator`, such as ``("--state", FOLDER)``, on the first machine or
            shared; by default jobs are kept until the end.
        modules: users' modules whose problems may be run.
        agent_options: further options of `supernode node`.
        given_up: whether nobody wants the cluster any more; asked while it starts.

    Raises:
        BadInput: if Ray is not installed, or a number makes no sense.
        ClusterFailed: if the nodes have not joined in time.
    """

    def __init__(
        self,
        nodes: int = 16,
        *,
        address: str | None = None,
        hosts: int | None = None,
        options: Sequence[str] = (),
        modules: Sequence[str] = (),
        agent_options: Sequence[str] = (),
        given_up: Callable[[], bool] = lambda: False,
    ) -> None:
        super().__init__(given_up)
        self._ray, self._is_ours = _connected(address)
        machines = len(_machines(self._ray))
        if not machines:
            raise BadInput("ray: expected a machine with a processor, found none")
        given = shares(nodes, min(nodes, machines) if hosts is None else hosts)
        self._agent_options = agent_options
        self._secret, self._name = secrets.token_hex(SECRET_BYTES), secrets.token_hex(4)
        self._actors: list[Any] = []
        self._groups: list[Any] = []
        self._agents, self._trust = 0, trust(modules)
        try:
            group = self._spread(len(given))
            self._start(group, nodes, ("--state", "<FOLDER>", *options))
            self._add_agents(group, given)
            self.wait_until_ready()
        except BaseException:
            self.close()
            raise

    def grow(self, nodes: int) -> None:
        """Add an agent with so many nodes, on a machine that has room, and wait until they have joined.

        Raises:
            BadInput: if the number is less than 1.
            ClusterFailed: if they have not joined in time.
        """
        if nodes < 1:
            raise BadInput(f"nodes: expected at least 1, found {nodes}")
        self._add_agents(self._spread(1), [nodes])
        self.wait_until_ready()

    def _spread(self, places: int) -> Any:
        """Return a new placement group with so many places, once Ray has them."""
        group = self._ray.util.placement_group([{"CPU": 1.0}] * places, strategy="SPREAD")
        self._groups.append(group)
        until = time.monotonic() + READY_WITHIN
        while not self._ray.wait([group.ready()], timeout=_LOOK_AGAIN)[0]:
            self.refuse_given_up()
            if time.monotonic() >= until:
                raise ClusterFailed(f"Ray has not found {places} free processors within {READY_WITHIN:.0f} s")
        return group

    def _start(self, group: Any, nodes: int, options: Sequence[str]) -> None:
        """Start router, coordinator and spy at the first place of the group."""
        port = self._at(group, free_port)
        router = self._actor(group, 0, "router", "--insecure", "--listen", f"tcp/0.0.0.0:{port}")
        self.connect = f"tcp/{self._ray.get(router.address.remote())}:{port}"
        self._port = port + 1  # agents may share a machine, so each gets ports of its own
        self._coordinator = self._actor(group, 0, "coordinator", *self._member(), "--nodes", str(nodes), *options)
        self._actor(group, 0, "spy", *self._member())

    def _add_agents(self, group: Any, shares: Sequence[int]) -> None:
        """Start an agent with its share of nodes at each place of a group."""
        for place, share in enumerate(shares):
            where = ("--insecure", "--host", f"agent-{self._agents}", "--listen", f"tcp/<ADDRESS>:{self._port}")
            options = (*where, *self._agent_options)
            self._actor(group, place, "node", *self._member(), "--nodes", str(share), *options)
            # Modulo: so many agents are not on one machine.
            self._port = FIRST_PORT + (self._port - FIRST_PORT + PORTS * share) % MOST_PORTS
            self.nodes += share
            self._agents += 1

    def _member(self) -> tuple[str, ...]:
        return "--connect", self.connect, "--secret-file", "<SECRET>", *self._trust

    def _actor(self, group: Any, place: int, *command: str) -> Any:
        """Start an actor at a place of a group, and return it."""
        share = 0.4 if command[0] == "node" else 0.2  # of the place's processor; four actors share the first one
        options = {"num_cpus": share, "max_restarts": -1, "scheduling_strategy": self._strategy(group, place)}
        name = f"{self._name}-{len(self._actors)}"
        actor = self._ray.remote(Role).options(**options).remote(command, self._secret, name)
        self._actors.append(actor)
        return actor

    def _at(self, group: Any, function: Any) -> Any:
        """Call a function at the first place of a group, and return what it returns."""
        task = self._ray.remote(function).options(num_cpus=0.1, scheduling_strategy=self._strategy(group, 0))
        return self._ray.get(task.remote())

    def _strategy(self, group: Any, place: int) -> Any:
        strategies = self._ray.util.scheduling_strategies
        return strategies.PlacementGroupSchedulingStrategy(group, placement_group_bundle_index=place)

    def is_over(self) -> bool:
        """Return whether a client has ended the coordinator; not while its machine does not answer."""
        try:
            return bool(self._ray.get(self._coordinator.is_over.remote(), timeout=_ENDED_WITHIN))
        except (self._ray.exceptions.RayActorError, self._ray.exceptions.GetTimeoutError):
            return False

    def close(self) -> None:
        """End all processes, and give the machines back to Ray."""
        self._close_client()
        ending = [actor.end.remote() for actor in reversed(self._actors)]
        self._ray.wait(ending, num_returns=len(ending), timeout=_ENDED_WITHIN)
        for actor in self._actors:
            self._ray.kill(actor)
        self._actors.clear()
        for group in self._groups:
            self._ray.util.remove_placement_group(group)
        if self._is_ours:
            self._ray.shutdown()


def _connected(address: str | None) -> tuple[Any, bool]:
    """Return the module ray, connected with a cluster, and whether it was not before.

    Raises:
        BadInput: if it is not installed, there is no cluster at the address, or it is connected with one already.
    """
    try:
        import ray
        import ray.util.scheduling_strategies
    except ImportError:
        raise BadInput("ray: expected this package, found none; pip install 'supernode[ray]'") from None
    was_connected = ray.is_initialized()
    if was_connected and address is not None:
        raise BadInput(f"address: expected none, as this process has a connection with Ray already, found {address}")
    if not was_connected:
        try:
            ray.init(address=address or "auto", log_to_driver=False)
        except ConnectionError as error:
            raise BadInput(f"ray: expected a Ray cluster at {address or 'this machine'}, found none: {error}") from None
    return ray, not was_connected


def _machines(ray: Any) -> list[Any]:
    return [each for each in ray.nodes() if each["Alive"] and each["Resources"].get("CPU", 0) >= 1]
