"""A simulated cluster on one machine: it starts router, spy, nodes and coordinator, and replaces those that die."""

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import topologies
from coordinator.jobs.client_limits import NO_LIMITS
from coordinator.jobs.hooks import MakeJobRunner
from coordinator.jobs.running import EVAL_TIMEOUT
from coordinator.service.launched import LaunchedDispatcher
from coordinator.service.process import Options, Service
from coordinator.store.database import url_in
from coordinator.store.record_book import Keep
from node.node_config import NodeConfig
from node.process import NodeProcess
from problems.modules import Modules
from spy.process import SpyProcess
from supernode.chaos.simulated.network import Network
from supernode.chaos.simulated.plans import Fault
from supernode.chaos.simulated.router import Router
from supernode.chaos.simulated.world import Process, World
from supernode.chaos.simulated.zenoh_module import Zenoh
from wire import sessions
from wire.keys import Keys
from wire.seal import SECRET_BYTES, Seal

_FORK = (0.02, 0.3)  # seconds from a death until the process that replaces the dead one runs
_NAME = "simulated"
_CHECKPOINT_EVERY = 2.0  # seconds


class Cluster:
    """The processes of one cluster.

    Args:
        world: the world that they live in.
        network: its network.
        topology: the topology of the nodes.
        state: the folder of the coordinator's database.
        by_id: takes all processes, by their ids.

    Attributes:
        processes: the living processes by name: "router", "spy", "coordinator", "node 0" and so on.
        nodes: what runs in the living processes of nodes, by node.
        spy: what runs in the living process of the spy; None while there is none.
        keys: the key expressions of the cluster.
        disk_fails_until: until when writes of the database fail.
    """

    def __init__(
        self,
        world: World,
        network: Network,
        topology: str,
        state: Path,
        by_id: dict[int, Process],
    ) -> None:
        self.world = world
        self.keys = Keys(_NAME)
        self.processes: dict[str, Process] = {}
        self._by_id = by_id
        self.nodes: dict[int, NodeProcess] = {}
        self.disk_fails_until = 0.0
        self.spy: SpyProcess | None = None
        self._network = network
        self._topology = topology
        self._state = state
        self._folder = Path(tempfile.gettempdir()) / _NAME
        self._secret = world.draw.randbytes(SECRET_BYTES)
        self.router = sessions.unix_socket(self._folder, "router")
        self._start_all()

    def _start_all(self) -> None:
        self._start("router")
        self._start("spy", self._topology)
        for node in range(topologies.parse(self._topology).cells):
            self._start(f"node {node}", self._topology)
        self._start("coordinator", first=True)

    @property
    def is_ready(self) -> bool:
        """Whether all processes that are there from the beginning have come up."""
        cells = topologies.parse(self._topology).cells if self._topology else 0
        return len(self.nodes) >= cells and self.spy is not None

    def suffer(self, fault: Fault) -> None:
        """Carry out a fault. On the hub."""
        self.world.say(str(fault))
        if fault.do == "kill":
            self.kill(fault.whom)
        elif fault.do == "stop" and (process := self.processes.get(fault.whom)) is not None:
            process.stop(fault.seconds)
        elif fault.do == "part":
            self._network.part(fault.whom, fault.other, fault.seconds)
        elif fault.do == "hold":
            self._network.hold(fault.whom, fault.other, fault.seconds)
        elif fault.do == "disk":
            self.disk_fails_until = max(self.disk_fails_until, self.world.now + fault.seconds)
        elif fault.weather is not None:
            self._network.change(fault.weather, fault.seconds)

    def nodes_of_hosts(self) -> dict[str, tuple[int, ...]]:
        """Return the nodes of each host that runs; empty if one zygote launched all nodes."""
        return {}

    def open_links(self, node: int) -> int:
        """Return how many sessions with its neighbours a node has open."""
        return self._network.open_peers(self.processes[f"node {node}"])

    def cut_off_until(self, node: int) -> float:
        """Return until when the host of a node has no link to the router, now or lately; 0 if it always had one."""
        return 0.0

    def kill(self, name: str) -> None:
        """Kill a process; another one takes its place soon."""
        process = self.processes.get(name)
        if process is not None:
            self.ended(process)

    def ended(self, process: Process) -> None:
        """Note that a process has ended, or end it."""
        if self.processes.get(process.name) is process:
            process.kill()
            self._replace(process.name)

    def _replace(self, name: str) -> None:
        self._forget(name)
        at = self.world.now + self.world.draw.uniform(*_FORK)
        self.world.at(at, lambda: self._start_again(name))

    def _forget(self, name: str) -> Process:
        """Forget a process that has died or is about to; return it."""
        kind, _, number = name.partition(" ")
        if kind == "node":
            self.nodes.pop(int(number), None)
        elif kind == "spy":
            self.spy = None
        return self.processes.pop(name)

    def _start_again(self, name: str) -> None:
        if name in self.processes:  # its host has been started again meanwhile
            return
        self.world.say(f"start {name}")
        self._start(name)

    def _start(self, name: str, topology: str = "", first: bool = False) -> None:
        process = self.processes[name] = Process(self.world, name)
        self._by_id[process.id] = process
        if name == "router":
            Router(self._network, process, [self.router])
        else:
            process.start(self._life_of(name, topology, first), "main")

    def _life_of(self, name: str, topology: str, first: bool) -> Callable[[], None]:
        """Return what the main thread of a process does."""
        kind, _, number = name.partition(" ")
        if kind == "node":
            return partial(self._live, int(number), topology)
        return partial(self._watch, topology) if kind == "spy" else partial(self._serve, first)

    def _config(self, node: int, topology: str) -> NodeConfig:
        return NodeConfig(_NAME, node, topology, self._folder, self.router, self._secret, Modules())

    def _live(self, node: int, topology: str) -> None:
        process = NodeProcess(self._config(node, topology))
        self.nodes[node] = process
        process.driver.run()

    def _watch(self, topology: str) -> None:
        self.spy = SpyProcess(self._config(0, topology))
        self.spy.run()

    def _serve(self, first: bool) -> None:
        make_dispatcher = partial(
            LaunchedDispatcher,
            seal=Seal(self._secret),
            topology=self._topology,
            wired=first,
            limits=NO_LIMITS,
            eval_timeout=EVAL_TIMEOUT,
        )
        self._be_the_coordinator(make_dispatcher, topologies.parse(self._topology).cells)

    def _be_the_coordinator(self, make_dispatcher: MakeJobRunner, nodes: int, *, joined: bool = False) -> None:
        store, every = url_in(self._state), _CHECKPOINT_EVERY
        options = Options(nodes, store, Keep(), log_json=True, checkpoint_every=every, joined=joined)
        session: Any = Zenoh(self._network).client(self.router)
        Service(session, self.keys, Modules(), options, make_dispatcher).serve()
