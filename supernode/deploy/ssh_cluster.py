"""A cluster on plain hosts: router, coordinator and spy on this machine, an agent on each host, started by ssh.

An agent's lifeline is its standard input: it brings the secret, so that none is written to a file there, and the agent
ends when the connection does.
"""

from __future__ import annotations

import re
import shlex
from collections import defaultdict
from collections.abc import Callable, Sequence

from coordinator.jobs.node_hosts import PORTS
from problems.errors import BadInput
from supernode.deploy.addresses import free_port, own_address, own_endpoint
from supernode.deploy.engine_cluster import shares
from supernode.deploy.kept_alive import KeptAlive, KeptAliveCluster, check_programs, supernode_command

_HOST = re.compile(r"(\w[\w.-]*@)?(\w[\w.-]*|\[[0-9a-fA-F:]+\])(:\d+)?")
# No questions, as nobody may be there to answer; a host that is silent for 15 s counts as gone.
_SSH = ("ssh", "-T", "-o", "BatchMode=yes", "-o", "ServerAliveInterval=5", "-o", "ServerAliveCountMax=3")


class SshCluster(KeptAliveCluster):
    """A cluster on hosts that ssh reaches without a question; supernode is at the same path on each as here.

    Args:
        hosts: the hosts, such as ``host``, ``user@host`` or ``host:port``.
        nodes: how many nodes there shall be on all hosts.
        listen: where the router listens, the endpoint for the hosts first; by default a free port at the address by
            which this machine reaches the first host.
        options: further options of `supernode coordinator`, such as ``("--state", FOLDER)``.
        modules: users' modules whose problems may be run.
        agent_options: further options of `supernode node`.
        given_up: whether nobody wants the cluster any more; asked while it starts.

    Raises:
        BadInput: if a host makes no sense, or there are fewer nodes than hosts.
        ClusterFailed: if the nodes have not joined in time.
    """

    def __init__(
        self,
        hosts: Sequence[str],
        nodes: int,
        *,
        listen: Sequence[str] = (),
        options: Sequence[str] = (),
        modules: Sequence[str] = (),
        agent_options: Sequence[str] = (),
        given_up: Callable[[], bool] = lambda: False,
    ) -> None:
        check_programs("--on", ("ssh", "openssh-client"))
        for host in hosts:
            if not _HOST.fullmatch(host):
                raise BadInput(f"--on: expected hosts such as user@host:22, found {host!r}")
        self._given, self._hosts, self._agent_options = shares(nodes, len(hosts)), hosts, agent_options
        port, first = free_port(), f"tcp/{_name_of(hosts[0])}:22"
        listen = listen or [f"tcp/{own_address(first)}:{port}"]
        connect = own_endpoint(listen[0], first)
        super().__init__(nodes, listen, connect, options=options, modules=modules, given_up=given_up)
        self._first_port = port + 1
        self._start()

    def _start_agents(self, secret: str) -> None:
        ports: dict[str, int] = defaultdict(lambda: self._first_port)  # by machine
        for number, (host, share) in enumerate(zip(self._hosts, self._given, strict=True)):
            where = (
                "--insecure",
                "--host",
                f"{_name_of(host)}-{number}",
                "--listen",
                f"tcp/0.0.0.0:{ports[_name_of(host)]}",
            )
            agent = ("node", *self._member, "--nodes", str(share), *where, "--lifeline", *self._agent_options)
            remote = shlex.join(supernode_command(*agent))
            self._agents.append(KeptAlive([*_SSH, f"ssh://{host}", f"exec {remote}"], secret))
            ports[_name_of(host)] += PORTS * share

    def _place_of(self, agent: int) -> str:
        return f"{self._hosts[agent]}: ssh or the agent there"


def _name_of(host: str) -> str:
    """Return the name or address of a host, without user and port."""
    return re.sub(r":\d+$", "", host.rpartition("@")[2]).strip("[]")
