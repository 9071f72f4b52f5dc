"""A simulated cluster of several hosts, which join a coordinator and may be lost, leave and come back."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from coordinator.errors import ClusterFailed
from coordinator.jobs.client_limits import NO_LIMITS
from coordinator.launch import host as launch_host
from coordinator.service.joined import JoinedDispatcher
from node.node_config import NodeConfig
from problems.modules import Modules
from supernode.chaos.simulated.cluster import Cluster
from supernode.chaos.simulated.network import Network
from supernode.chaos.simulated.plans import DRAINED_WITHIN, Fault, PlannedHost
from supernode.chaos.simulated.world import Process, World
from wire.hosts import Host
from wire.seal import Seal

HOST_TIMEOUT = 10.0
"""Seconds that a host may stay away; shorter than usual, so that it is met."""

_REFUSED_AGAIN = 1.0  # seconds until a host whose agent has ended tries again


class _SimulatedHost:
    """One host: its agent, and its nodes once the coordinator has given them numbers.

    Attributes:
        planned: its name, and how many nodes it has.
        host: what it tells the coordinator; each start has another id.
        is_up: whether it runs.
        is_leaving: whether it has got SIGTERM.
        cut_off_until: until when it has no link to the router, or one on which all that it sends is held back.
    """

    def __init__(self, planned: PlannedHost) -> None:
        self.planned = planned
        self.host = Host("", planned.name, planned.nodes, planned.endpoint)
        self.is_up = False
        self.is_leaving = False
        self.cut_off_until = 0.0
        self.starts = 0


class JoinedCluster(Cluster):
    """The processes of a cluster whose nodes come with their hosts."""

    def __init__(
        self, world: World, network: Network, hosts: tuple[PlannedHost, ...], expected: int, state: Path, by_id: Any
    ) -> None:
        self._hosts = {planned.name: _SimulatedHost(planned) for planned in hosts}
        self._host_of: dict[int, _SimulatedHost] = {}
        self._expected = expected
        super().__init__(world, network, "", state, by_id)
        for planned in hosts:
            world.at(planned.at, partial(self._start_host, planned.name))

    def suffer(self, fault: Fault) -> None:
        """Carry out a fault. On the hub."""
        host = self._hosts.get(fault.whom)
        if host is None:
            return super().suffer(fault)
        self.world.say(str(fault))
        if fault.do == "kill":
            self._end_host(host, fault.seconds)
        elif fault.do in ("part", "hold"):
            cut = self._network.part if fault.do == "part" else self._network.hold
            for name in self._processes_of(host):
                cut(name, fault.other, fault.seconds)
            if fault.other == "router":
                host.cut_off_until = max(host.cut_off_until, self.world.now + fault.seconds)
        elif fault.do == "leave" and host.is_up:
            self._leave(host, fault.seconds)
        return None

    def nodes_of_hosts(self) -> dict[str, tuple[int, ...]]:
        """Return the nodes of each host that runs."""
        return {name: host.host.nodes for name, host in self._hosts.items() if host.is_up}

    def cut_off_until(self, node: int) -> float:
        """See `Cluster`."""
        host = self._host_of.get(node)
        return 0.0 if host is None else host.cut_off_until

    def _start_host(self, name: str) -> None:
        host = self._hosts[name]
        if host.is_up:
            return
        host.is_up, host.is_leaving = True, False
        host.starts += 1
        host.host = Host(f"{name}.{host.starts}", name, host.planned.nodes, host.planned.endpoint)
        self.world.say(f"start host {name}")
        self._start(f"agent {name}")

    def _end_host(self, host: _SimulatedHost, back_after: float) -> None:
        """End all processes of a host at once; it is started again after so many seconds."""
        if host.is_up:
            host.is_up = False
            for name in self._processes_of(host):
                self._forget(name).kill()
            self.world.at(self.world.now + back_after, partial(self._start_host, host.planned.name))

    def _leave(self, host: _SimulatedHost, back_after: float) -> None:
        """Let a host end once no job needs it, or after a while, as SIGTERM does."""
        if host.is_leaving:
            return
        host.is_leaving = True
        agent = self.processes.get(f"agent {host.planned.name}")
        if agent is not None:
            agent.signal(launch_host.LEAVE)
        start = host.starts

        def give_up() -> None:
            if host.starts == start:
                self._end_host(host, back_after)

        self.world.at(self.world.now + DRAINED_WITHIN, give_up)

    def _processes_of(self, host: _SimulatedHost) -> list[str]:
        names = [f"agent {host.planned.name}", *(f"node {node}" for node in host.host.nodes)]
        return [name for name in names if name in self.processes]

    def ended(self, process: Process) -> None:
        """Note that a process has ended by itself: a host whose agent says that no job needs it ends too."""
        kind, _, name = process.name.partition(" ")
        if kind == "agent" and process.status == launch_host.DRAINED:
            self.world.say(f"host {name} is drained")
            self._end_host(self._hosts[name], self.world.draw.uniform(0.5, 5.0))
        else:
            super().ended(process)

    def _start_again(self, name: str) -> None:
        kind, _, whose = name.partition(" ")
        host = self._hosts[whose] if kind == "agent" else self._host_of[int(whose)] if kind == "node" else None
        if host is None or host.is_up:  # else nobody is there who would start it
            super()._start_again(name)

    def _start_all(self) -> None:
        self._start("router")
        self._start("spy")
        self._start("coordinator", first=True)

    def _life_of(self, name: str, topology: str, first: bool) -> Callable[[], None]:
        kind, _, whose = name.partition(" ")
        return partial(self._attend, self._hosts[whose]) if kind == "agent" else super()._life_of(name, topology, first)

    def _attend(self, host: _SimulatedHost) -> None:
        """Be the agent of a host."""
        try:
            launch_host.attend(
                host.host,
                self.keys,
                self.router,
                None,
                Seal(self._secret),
                partial(self._fork_nodes, host),
                leaves=host.is_leaving,
            )
        except ClusterFailed as error:
            self.world.say(f"host {host.planned.name} is refused: {error}")
            self.world.at(self.world.now, lambda: self._end_host(host, _REFUSED_AGAIN))

    def _fork_nodes(self, host: _SimulatedHost, nodes: tuple[int, ...]) -> None:
        host.host = host.host.with_nodes(nodes)
        self.world.say(f"host {host.planned.name} has nodes {nodes}")
        start = host.starts

        def fork() -> None:
            if host.is_up and host.starts == start:
                for node in nodes:
                    self._host_of[node] = host
                    self._start(f"node {node}")

        self.world.at(self.world.now, fork)

    def _config(self, node: int, topology: str) -> NodeConfig:
        host = self._host_of.get(node)
        common = (self.router, self._secret, Modules())
        process = self.world.process
        if host is None or (process is not None and process.name == "spy"):
            return NodeConfig(self.keys.cluster, node, "", self._folder, *common, host="spy")
        folder = self._folder / host.planned.name
        return NodeConfig(self.keys.cluster, node, "", folder, *common, host=host.host.id)

    def _serve(self, first: bool) -> None:
        make_dispatcher = partial(
            JoinedDispatcher, seal=Seal(self._secret), limits=NO_LIMITS, host_timeout=HOST_TIMEOUT
        )
        self._be_the_coordinator(make_dispatcher, self._expected, joined=True)
