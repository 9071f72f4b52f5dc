"""Clusters whose processes this one starts, and starts again when they die: one thread keeps each of them alive.

When this process ends, however it ends, all of them do.
"""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path

from problems.errors import BadInput
from supernode.deploy.engine_cluster import EngineCluster, trust
from supernode.files.secret_file import read_or_make

_ENDED_WITHIN = 10.0  # seconds until a process that does not end is killed
_LIFELINE = ("setpriv", "--pdeathsig", "TERM")  # of util-linux: the process ends when this one does, however that ends
_HERE = ("router", "coordinator", "spy")


class KeptAlive:
    """A process that is started again when it ends.

    Args:
        command: the command.
        secret: what to write to its standard input, which stays open; None for no input.
        ends: whether it is not started again after status 0, since a client has ended it.
        pause, longest_pause: seconds until it is started again; doubled each time, up to the longest, while it dies
            soon.
        enter: called by the thread that starts the process, so that this is where that thread is.
        folder: the process's working directory; None for this one's.

    Attributes:
        how_it_ended: in words how it ended last, or why it could not be started; None if neither.
        is_over: whether it is not started again.
    """

    def __init__(
        self,
        command: Sequence[str],
        secret: str | None = None,
        *,
        ends: bool = False,
        pause: float = 1.0,
        longest_pause: float = 30.0,
        enter: Callable[[], None] = lambda: None,
        folder: Path | None = None,
    ) -> None:
        self._ends, self._pause, self._longest_pause = ends, pause, longest_pause
        self._enter, self._folder = enter, folder
        self._command = [*_LIFELINE, *command]
        self._secret = secret
        self._ending = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self.how_it_ended: str | None = None
        self.is_over = False
        # Not a daemon: `--pdeathsig` is a matter of the thread that starts the process, which lives as long as that.
        self._thread = threading.Thread(target=self._keep, name=f"keeper of {command[0]}")
        self._thread.start()

    @property
    def process(self) -> int | None:
        """The id of the process; None if it does not run now."""
        process = self._process
        return None if process is None or process.returncode is not None else process.pid

    def _keep(self) -> None:
        try:
            self._enter()
            self._start_again_and_again()
        except OSError as error:
            self.how_it_ended = f"could not be started: {error.strerror}"

    def _start_again_and_again(self) -> None:
        pause = self._pause
        while not self._ending.is_set():
            began = time.monotonic()
            process = self._process = self._start()
            if process.stdin is not None and self._secret is not None:
                with contextlib.suppress(BrokenPipeError):
                    process.stdin.write(f"{self._secret}\n".encode())
                    process.stdin.flush()
            status = process.wait()
            self.how_it_ended = f"ended with status {status}"
            if self._ends and status == 0:
                self.is_over = True
                return
            lived_long = time.monotonic() - began > self._longest_pause
            pause = self._pause if lived_long else min(2 * pause, self._longest_pause)
            self._ending.wait(pause)

    def _start(self) -> subprocess.Popen[bytes]:
        # What it writes goes to standard error: a command's own output may be one JSON object.
        stdin = subprocess.DEVNULL if self._secret is None else subprocess.PIPE
        return subprocess.Popen(self._command, stdin=stdin, stdout=2, start_new_session=True, cwd=self._folder)

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


class KeptAliveCluster(EngineCluster):
    """A cluster with router, coordinator and spy on this machine, and an agent on each host.

    Args:
        nodes: how many nodes there shall be on all hosts.
        listen: the endpoints where the router listens.
        connect: the endpoint by which all others reach it.
        options: further options of `supernode coordinator`, such as ``("--state", FOLDER)``.
        modules: users' modules whose problems may be run.
        given_up: whether nobody wants the cluster any more; asked while it starts.
    """

    def __init__(
        self,
        nodes: int,
        listen: Sequence[str],
        connect: str,
        *,
        options: Sequence[str] = (),
        modules: Sequence[str] = (),
        given_up: Callable[[], bool] = lambda: False,
    ) -> None:
        super().__init__(given_up)
        # Private, as mkdtemp makes it; not "supernode-", which is for folders that a lock keeps from being removed.
        self._folder = tempfile.TemporaryDirectory(prefix="sn-up-")
        self.nodes, self.connect, self._listen = nodes, connect, listen
        self._options, self._member = options, ("--connect", connect, *trust(modules))
        self._here: list[KeptAlive] = []
        self._agents: list[KeptAlive] = []

    def _start(self) -> None:
        """Start all processes, and wait until the nodes have joined.

        Raises:
            BadInput, ClusterFailed: if that fails; all processes have ended then.
        """
        try:
            file = Path(self._folder.name) / "secret"
            secret = read_or_make(file).hex()
            known = ("--secret-file", str(file))
            for command in (
                ("router", "--insecure", "--listen", " ".join(self._listen)),
                ("coordinator", *self._member, *known, "--nodes", str(self.nodes), *self._options),
                ("spy", *self._member, *known),
            ):
                self._here.append(self._keep_here(supernode_command(*command), ends=command[0] == "coordinator"))
            self._start_agents(secret)
            self.wait_until_ready()
        except BaseException:
            self.close()
            raise

    def _keep_here(self, command: Sequence[str], *, ends: bool) -> KeptAlive:
        """Start the router, the coordinator or the spy."""
        return KeptAlive(command, ends=ends)

    @abstractmethod
    def _start_agents(self, secret: str) -> None:
        """Start an agent on each host, and note them in ``_agents``, in their order."""

    @abstractmethod
    def _place_of(self, agent: int) -> str:
        """Return in words where an agent is."""

    def is_over(self) -> bool:
        """Return whether a client has ended the coordinator."""
        _, coordinator, _ = self._here
        return coordinator.is_over

    def complaint(self) -> str | None:
        """Return which process has ended before the nodes joined."""
        for name, process in zip(_HERE, self._here, strict=True):
            if process.how_it_ended is not None:
                return f"the {name} {process.how_it_ended}; what it wrote is above"
        for number, agent in enumerate(self._agents):
            if agent.how_it_ended is not None:
                return f"{self._place_of(number)} {agent.how_it_ended}; what it wrote is above"
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


def supernode_command(*words: str) -> list[str]:
    """Return the command that runs one of `supernode`."""
    return [sys.executable, "-m", "supernode", *words]


def check_programs(option: str, *programs: tuple[str, str]) -> None:
    """Check that programs are installed.

    Args:
        option: the option that needs them, for the error.
        programs: each with the package that has it; the program that ends processes with this one is always needed.

    Raises:
        BadInput: if one is missing.
    """
    for program, package in (*programs, (_LIFELINE[0], "util-linux")):
        if shutil.which(program) is None:
            raise BadInput(f"{option}: expected the program {program}, found none; install {package}")
