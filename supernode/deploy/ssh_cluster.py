"""A cluster on plain hosts: router, coordinator and spy on this machine, an agent on each host, started by ssh.

Each process has a thread that starts it again when it dies. An agent's lifeline is its standard input: it brings the
secret, so that none is written to a file there, and the agent ends when the connection does.
"""

from __future__ import annotations

import contextlib
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path

from coordinator.jobs.node_hosts import PORTS
from problems.errors import BadInput
from supernode.deploy.addresses import free_port, own_address, own_endpoint
from supernode.deploy.engine_cluster import EngineCluster, shares, trust
from supernode.files.secret_file import read_or_make

_AGAIN, _LONGEST_PAUSE = 1.0, 30.0  # seconds until a process that has died is started again; doubled while it dies soon
_ENDED_WITHIN = 10.0  # seconds until a process that does not end is killed
_HOST = re.compile(r"(\w[\w.-]*@)?(\w[\w.-]*|\[[0-9a-fA-F:]+\])(:\d+)?")
# No questions, as nobody may be there to answer; a host that is silent for 15 s counts as gone.
_SSH = ("ssh", "-T", "-o", "BatchMode=yes", "-o", "ServerAliveInterval=5", "-o", "ServerAliveCountMax=3")
_LIFELINE = ("setpriv", "--pdeathsig", "TERM")  # of util-linux: the process ends when this one does, however that ends


class _KeptAlive:
    """A process that is started again when it ends.

    Args:
        command: the command.
        secret: what to write to its standard input, which stays open; None for no input.
        ends: whether it is not started again after status 0, since a client has ended it.

    Attributes:
        died_with: the status that it ended with last; None if it has not.
        is_over: whether it is not started again.
    """

    def __init__(self, command: Sequence[str], secret: str | None = None, *, ends: bool = False) -> None:
        self._ends = ends
        self._command = [*_LIFELINE, *command]
        self._secret = secret
        self._ending = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self.died_with: int | None = None
        self.is_over = False
        # Not a daemon: `--pdeathsig` is a matter of the thread that starts the process, which lives as long as that.
        self._thread = threading.Thread(target=self._keep, name=f"keeper of {command[0]}")
        self._thread.start()

    def _keep(self) -> None:
        pause = _AGAIN
        while not self._ending.is_set():
            began = time.monotonic()
            stdin = subprocess.DEVNULL if self._secret is None else subprocess.PIPE
            process = subprocess.Popen(self._command, stdin=stdin, start_new_session=True)
            self._process = process
            if process.stdin is not None and self._secret is not None:
                with contextlib.suppress(BrokenPipeError):
                    process.stdin.write(f"{self._secret}\n".encode())
                    process.stdin.flush()
            self.died_with = process.wait()
            if self._ends and self.died_with == 0:
                self.is_over = True
                return
            pause = _AGAIN if time.monotonic() - began > _LONGEST_PAUSE else min(2 * pause, _LONGEST_PAUSE)
            self._ending.wait(pause)

    def end(self) -> None:
        """Ask the process to end, without waiting for it."""
        self._ending.set()
        process = self._process
        if process is None:
            return
        if process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
        else:
            process.terminate()

    def wait(self) -> None:
        """Wait for its end after `end`; kill it if that takes long."""
        self._thread.join(_ENDED_WITHIN)
        if self._thread.is_alive() and self._process is not None:
            self._process.kill()
            self._thread.join()


class SshCluster(EngineCluster):
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
        super().__init__(given_up)
        for program, package in (("ssh", "openssh-client"), ("setpriv", "util-linux")):
            if shutil.which(program) is None:
                raise BadInput(f"--on: expected the program {program}, found none; install {package}")
        for host in hosts:
            if not _HOST.fullmatch(host):
                raise BadInput(f"--on: expected hosts such as user@host:22, found {host!r}")
        given = shares(nodes, len(hosts))
        port, first = free_port(), f"tcp/{_name_of(hosts[0])}:22"
        self._listen = listen or [f"tcp/{own_address(first)}:{port}"]
        self.connect = own_endpoint(self._listen[0], first)
        # Private, as mkdtemp makes it; not "supernode-", which is for folders that a lock keeps from being removed.
        self._folder = tempfile.TemporaryDirectory(prefix="sn-up-")
        self.nodes, self._hosts, self._trust = nodes, hosts, trust(modules)
        self._here: list[_KeptAlive] = []
        self._agents: list[_KeptAlive] = []
        try:
            self._start(given, port + 1, options, agent_options)
            self.wait_until_ready()
        except BaseException:
            self.close()
            raise

    def _start(
        self, given: Sequence[int], first_port: int, options: Sequence[str], agent_options: Sequence[str]
    ) -> None:
        file = Path(self._folder.name) / "secret"
        secret = read_or_make(file).hex()
        member = ("--connect", self.connect, *self._trust)
        known = ("--secret-file", str(file))
        for command in (
            ("router", "--insecure", "--listen", " ".join(self._listen)),
            ("coordinator", *member, *known, "--nodes", str(self.nodes), *options),
            ("spy", *member, *known),
        ):
            ends = command[0] == "coordinator"
            self._here.append(_KeptAlive([sys.executable, "-m", "supernode", *command], ends=ends))
        ports: dict[str, int] = defaultdict(lambda: first_port)  # by machine
        for number, (host, share) in enumerate(zip(self._hosts, given, strict=True)):
            where = (
                "--insecure",
                "--host",
                f"{_name_of(host)}-{number}",
                "--listen",
                f"tcp/0.0.0.0:{ports[_name_of(host)]}",
            )
            agent = ("node", *member, "--nodes", str(share), *where, "--lifeline", *agent_options)
            remote = shlex.join([sys.executable, "-m", "supernode", *agent])
            self._agents.append(_KeptAlive([*_SSH, f"ssh://{host}", f"exec {remote}"], secret))
            ports[_name_of(host)] += PORTS * share

    def is_over(self) -> bool:
        """Return whether a client has ended the coordinator."""
        _, coordinator, _ = self._here
        return coordinator.is_over

    def complaint(self) -> str | None:
        """Return which process has ended before the nodes joined."""
        for name, process in zip(("router", "coordinator", "spy"), self._here, strict=True):
            if process.died_with is not None:
                return f"the {name} has ended with status {process.died_with}; what it wrote is above"
        for host, agent in zip(self._hosts, self._agents, strict=True):
            if agent.died_with is not None:
                return f"{host}: ssh or the agent there ended with status {agent.died_with}; what it wrote is above"
        return None

    def close(self) -> None:
        """End all processes, here and on the hosts."""
        self._close_client()
        processes = [*self._agents, *reversed(self._here)]
        for process in processes:
            process.end()
        for process in processes:
            process.wait()
        self._folder.cleanup()


def _name_of(host: str) -> str:
    """Return the name or address of a host, without user and port."""
    return re.sub(r":\d+$", "", host.rpartition("@")[2]).strip("[]")
