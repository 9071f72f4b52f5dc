"""A cluster on several hosts, all on this machine: each is an agent in a network namespace of its own."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from coordinator.launch import capacity
from supernode.chaos.network import Network
from supernode.deploy.engine_cluster import shares
from supernode.deploy.kept_alive import KeptAlive, KeptAliveCluster, check_programs, supernode_command

_ROUTER_PORT, _NODE_PORT = 7447, 7450
_PAUSE = 0.25  # seconds until a process that has died is started again, at first; later twice that


class HostedCluster(KeptAliveCluster):
    """A cluster whose router, coordinator and spy are at the hub of a network, and its nodes on the hosts.

    Nodes of different hosts have direct links.

    Args:
        network: the hosts.
        nodes: how many nodes there shall be on all hosts.
        state: the folder of the jobs; None for one that goes at the end.
        modules: users' modules whose problems may be run.
        folder: the folder of these modules.
        force: start the nodes even if this machine cannot hold so many.

    Raises:
        BadInput: if there are more hosts than nodes, this machine cannot hold so many nodes, or a program is missing.
        ClusterFailed: if the nodes have not joined in time.
    """

    def __init__(
        self,
        network: Network,
        nodes: int,
        state: Path | None = None,
        *,
        modules: Sequence[str] = (),
        folder: Path | None = None,
        force: bool = False,
    ) -> None:
        check_programs("--hosts")
        capacity.check(nodes, force=force)
        self._network, self._shares = network, shares(nodes, network.hosts)
        connect = f"tcp/{network.hub}:{_ROUTER_PORT}"
        super().__init__(nodes, [connect], connect, modules=modules)
        self._options = ("--state", str(state or Path(self._folder.name) / "state"))
        self._modules_folder = folder if modules else None
        self._force = ("--force",) if force else ()
        self._start()

    def _keep_here(self, command: Sequence[str], *, ends: bool) -> KeptAlive:
        return KeptAlive(command, ends=ends, pause=_PAUSE, longest_pause=_PAUSE, folder=self._modules_folder)

    def _start_agents(self, secret: str) -> None:
        for host, share in enumerate(self._shares):
            listen = f"tcp/{self._network.addresses[host]}:{_NODE_PORT}"
            where = ("--insecure", "--host", f"host{host}", "--listen", listen, "--lifeline", *self._force)
            command = supernode_command("node", *self._member, "--nodes", str(share), *where)
            self._agents.append(
                KeptAlive(
                    command,
                    secret,
                    pause=_PAUSE,
                    longest_pause=_PAUSE,
                    enter=partial(self._network.enter, host),
                    folder=self._modules_folder,
                )
            )

    def _place_of(self, agent: int) -> str:
        return f"the agent of host {agent}"

    def processes(self) -> dict[str, int]:
        """Return the ids of the processes that run now by name, such as "router", "host 1" and "node 7".

        That of a host is the process that ends all others of the host when it ends.
        """
        names = ["router", "coordinator", "spy", *(f"host {host}" for host in range(len(self._agents)))]
        kept = zip(names, [*self._here, *self._agents], strict=True)
        found = {name: process for name, each in kept if (process := each.process) is not None}
        for host in range(len(self._agents)):
            found |= self.nodes_on(host)
        return found

    def nodes_on(self, host: int) -> dict[str, int]:
        """Return the ids of the node processes that run on a host now, by name."""
        process = self._agents[host].process
        if process is None:
            return {}
        named = {_name_of(child): child for child in children_of(process)}
        return {name: child for name, child in named.items() if name.startswith("node ")}


def children_of(process: int) -> list[int]:
    """Return the ids of a process's children; none if it has ended. Linux only."""
    try:
        return [int(each) for each in Path(f"/proc/{process}/task/{process}/children").read_text().split()]
    except OSError:
        return []


def _name_of(process: int) -> str:
    """Return the name that a process of a host has given itself, such as "node 7"; "" if it has ended."""
    try:
        return Path(f"/proc/{process}/comm").read_text().strip().removeprefix("sn ")
    except OSError:
        return ""
