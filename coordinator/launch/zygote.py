"""The zygote: the process that router, spy and nodes are forked from, and that ends them.

It imports everything and loads all compiled kernels once, then forks; children share its memory and import nothing. It
never opens a Zenoh session, since a fork after that hangs.

It is the supervisor too: it replaces every process that dies, unless the first death is to end the cluster. In a
cluster that stays up it forks the coordinator as well.

Lifelines: the zygote runs exactly as long as the calling process holds the other end of its standard input. When the
caller ends, however it ends, the zygote kills its children, removes the folder of their sockets and exits. If the
zygote itself is killed, the kernel kills its children (parent-death signal), and the caller, which then reads the end
of the zygote's standard output, removes the folder. On standard output the zygote writes one JSON object a line: the
ids of the processes, again after each replacement, and at the end why the cluster ended.

The zygote has one thread. SIGCHLD and SIGIO are blocked once it forks, and `sigwait` takes them in one place.
"""

import contextlib
import gc
import json
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coordinator.errors import ClusterFailed
from coordinator.launch.deaths import Deaths, how
from coordinator.launch.folders import make_folder
from coordinator.launch.imports import import_all
from coordinator.launch.lifeline import at_end, comes_first, end_with_the_caller, first_line
from coordinator.launch.sandbox import Sandbox, sandbox_of
from coordinator.launch.stopped import NODE_TIMEOUT, StoppedChildren
from lowlevel import capabilities, linux
from wire.members import Identity

if TYPE_CHECKING:
    from coordinator.log_lines import LogLines
    from node.core_token import CoreTokens
    from node.evaluation_limits import EvaluationLimits
    from node.node_config import NodeConfig
    from problems.modules import Modules

_DOWN = 100  # exit status of a coordinator that a client told to end the cluster
_WAKING = {signal.SIGCHLD, signal.SIGIO}  # a child has died; standard input has ended
_MOVED_FROM = 256  # nodes: with fewer, moving memory to files takes longer than the forks that it makes quicker


def main() -> None:
    """Run as ``python -m coordinator.launch.zygote`` by the launcher, which writes a line to standard input first."""
    config = json.loads(first_line(sys.stdin.fileno()))
    folder = Path(config["folder"])
    end_with_the_caller(folder)
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)  # else a terminal may stop a background process that writes the log
    try:
        lock = make_folder(folder)  # inherited by every process of the cluster: without any the folder is stale
    except OSError as error:
        return _tell({"failed": f"the zygote cannot make {folder}: {error.strerror}"})
    from node.evaluation_limits import EvaluationLimits

    service = config["service"]
    zygote = Zygote(
        config["cluster"],
        config["topology"],
        folder,
        bytes.fromhex(config["secret"]),
        _modules(service),
        service,
        config["kinds"],
        replaces=config["replaces"],
        node_timeout=config["node_timeout"],
        limits=EvaluationLimits(*config["limits"]),
    )
    zygote.run()
    return os.close(lock)


def _modules(service: dict[str, Any] | None) -> "Modules":
    from problems.modules import AnyModules, Modules

    if service is None:
        return AnyModules()  # only the calling process can submit jobs: nobody else reaches the router's socket
    return Modules(service["allow_modules"], service["modules"] and Path(service["modules"]))


class Zygote:
    """Forks the processes of one cluster and ends them."""

    name = "zygote"  # of this process in the log

    def __init__(
        self,
        cluster: str,
        topology: str,
        folder: Path,
        secret: bytes,
        modules: "Modules",
        service: dict[str, Any] | None = None,
        kinds: Collection[str] | None = None,
        *,
        replaces: bool = True,
        node_timeout: float = NODE_TIMEOUT,
        limits: "EvaluationLimits",
    ) -> None:
        self._stopped = StoppedChildren(node_timeout)
        self._limits = limits
        self._replaces = replaces  # processes that die; if not, the first death ends the cluster
        self.cluster = cluster
        self.secret = secret
        self.modules = modules
        self.topology = topology
        self.folder = folder
        keys = None if service is None else service["keys"]
        self._router_identity = None if keys is None else Identity.read(Path(keys))  # the others use sockets
        self.service = service  # `coordinator.launch.launcher.ServiceOptions`, as JSON has them
        self._kinds = kinds  # of problem, whose kernels are loaded; None for all
        self.children: dict[int, str] = {}  # running children, process id to name
        self._core_tokens: CoreTokens = {}
        self._sandbox = Sandbox()  # for nobody, until `run` makes another one
        self._nothing = os.open(os.devnull, os.O_RDWR)
        self._deaths = Deaths(folder)

    def run(self) -> None:
        """Fork all processes, then wait for the end of the caller or the death of a child; kill all at the end."""
        import topologies

        topology = topologies.parse(self.topology)
        topology.neighbours(topologies.ROOT)  # a random graph is built here, not in each child
        self._warm_up(topology.cells)
        signal.pthread_sigmask(signal.SIG_BLOCK, _WAKING)
        signal.signal(signal.SIGIO, signal.SIG_DFL)  # from now on `sigwait` takes it, and `finally` below cleans up
        try:
            self._fork_all(topology.cells)
            # A signal that comes between the look and `sigwait` stays pending, so nothing is missed.
            while not (at_end(sys.stdin.fileno()) or self._one_died()):
                self._wait_for_a_signal()
        except ClusterFailed as error:
            _tell({"failed": str(error)})
        finally:
            self._kill_all()

    def _wait_for_a_signal(self) -> None:
        """Wait for a signal that wakes this process, or until a stopped child counts as dead."""
        left = self._stopped.seconds_left()
        if left is None:
            signal.sigwait(_WAKING)
        else:
            signal.sigtimedwait(_WAKING, left)

    def _fork_all(self, nodes: int) -> None:
        """Fork every process and report their ids; stop when the caller ends meanwhile.

        Raises:
            ClusterFailed: if the router cannot listen, or the system refuses the sandbox or so many processes.
        """
        self._sandbox = sandbox_of(self.service)
        complaint = self._fork_router()
        if complaint is not None:
            raise ClusterFailed(f"router {complaint}")
        self._fork("spy", partial(self._spy, self.topology))
        for node in range(nodes):
            if at_end(sys.stdin.fileno()):  # the look takes 3 µs, a fork 1 to 3 ms
                return
            self._fork(f"node {node}", partial(self._node, node, self.topology))
        if self.service is not None:
            self._fork("coordinator", partial(self._coordinate, first=True))
            self._report_ordinary_paths()
        self._tell_processes()

    def _tell_processes(self, died: str | None = None) -> None:
        """Tell the caller the ids of all processes, and which one ``died`` and was replaced."""
        _tell({"processes": {name: process for process, name in self.children.items()}, "died": died})

    def _warm_up(self, nodes: int) -> None:
        """Import everything that a child needs, and arrange memory so that children write to few shared pages."""
        gc.disable()  # hardly anything is garbage while modules are imported
        import_all(self._kinds, with_coordinator=self.service is not None)
        import node.core_token
        import node.process
        import spy.process
        from wire import sessions

        # Here, since it would touch forty pages in each child.
        if self._router_identity is None:
            sessions.log_nothing()
        else:
            sessions.log_refusals()
        self._core_tokens = node.core_token.for_all_cores(nodes)
        self._spy_watch, self._node_live = spy.process.watch, node.process.live
        gc.enable()
        gc.freeze()  # a collection in a child would write to the header of every object, and so copy their pages
        if capabilities().fork_memory:
            from lowlevel import fork_memory

            fork_memory.forget_lookups()
            fork_memory.fill_holes()
            fork_memory.join_mappings()
            if nodes >= _MOVED_FROM:  # last: what the zygote writes to a page afterwards makes it anonymous again
                fork_memory.move_to_files()

    def _report_ordinary_paths(self) -> None:
        """Say in one line which low-level parts are not used here, and why."""
        if reasons := capabilities().reasons:
            parts = "; ".join(f"{part}: {reason}" for part, reason in reasons.items())
            self._log("info", f"ordinary paths are taken: {parts}", self.name)

    def _fork_router(self) -> str | None:
        """Fork the router and wait until it listens, so that the others connect at once; return why it does not."""
        ready, tell = os.pipe()
        listen = [self._config(0).router, *(self.service["listen"] if self.service is not None else ())]

        def route() -> None:
            from coordinator.launch.router import route

            os.close(ready)
            try:
                route(listen, tell, self._router_identity, self._log_lines())
            except ClusterFailed as error:
                os.write(tell, str(error).encode())

        self._fork("router", route)
        os.close(tell)
        with os.fdopen(ready, "rb") as pipe:
            if not comes_first(ready, sys.stdin.fileno()):
                return "was given up: the caller has ended"
            said = pipe.read(1)
            if said == b"!":
                return None
            return (said + pipe.read()).decode() or "ended before it listened"

    def _spy(self, topology: str) -> None:
        self._spy_watch(self._config(0, topology))

    def _node(self, node: int, topology: str) -> None:
        self._node_live(self._config(node, topology))

    def _coordinate(self, first: bool = False) -> None:
        from coordinator.service.launched import coordinate

        assert self.service is not None, "only for a cluster that stays up"
        coordinate(self._config(0, self.topology), self.service, first)
        os._exit(_DOWN)

    def _config(self, node: int, topology: str = "") -> "NodeConfig":
        from node.node_config import NodeConfig
        from wire import sessions

        router = sessions.unix_socket(self.folder, "router")
        common = (self.folder, router, self.secret, self.modules)
        crash = self._deaths.crash_of(f"node {node}")
        tokens, limits = self._core_tokens, self._limits
        return NodeConfig(self.cluster, node, topology, *common, core_tokens=tokens, crash=crash, limits=limits)

    def _fork(self, name: str, live: Callable[[], None]) -> None:
        """Fork a child that calls ``live``.

        Raises:
            ClusterFailed: if the system refuses another process.
        """
        parent = os.getpid()
        try:
            process = os.fork()
        except OSError as error:
            raise ClusterFailed(f"{name} could not be forked: {error.strerror}") from error
        if process != 0:
            self.children[process] = name
            self._deaths.note_birth(process)
            return
        try:
            self._sandbox.enter(name)
            _be_a_child(parent, name, self._nothing)
            live()
        except BaseException as error:
            self._log("error", f"{type(error).__name__}: {error}", name, name)
        finally:
            os._exit(1)  # never return into the parent's code; ``live`` exits by itself if it has another status

    def _one_died(self) -> bool:
        """Replace children that have died; return True if the cluster must end instead, after reporting why.

        One signal may stand for several deaths, so this asks until there is no further one.
        """
        while True:
            process, status = os.waitpid(-1, os.WNOHANG | StoppedChildren.FLAGS) if self.children else (0, 0)
            if process == 0:
                break
            if self._stopped.note(process, status):
                continue
            name = self.children.pop(process, None)  # None: an orphan, if this is process 1 of a container
            if name is not None:
                self._deaths.note(process, name, status)
                if self._is_the_end(name, status):
                    return True
                self._log("warning", f"{name} {how(status)}: another one takes its place", self.name, name)
                self._fork_again(name)
                self._tell_processes(f"{name} {how(status)}")
        for process in self._stopped.dead():
            self._log("warning", f"{self.children[process]} has been stopped for too long", self.name)
            os.kill(process, signal.SIGKILL)
        return False

    def _log(self, level: str, text: str, process: str, about: str = "") -> None:
        """Write a line to the log; what writes it is imported only now, since this is rare."""
        from wire.news import LogRecord

        kind, _, number = about.partition(" ")
        node = int(number) if kind == "node" else None
        self._log_lines().write(LogRecord(level, process, text, time.time(), node))

    def _log_lines(self) -> "LogLines":
        from coordinator.log_lines import LogLines

        return LogLines(self.cluster, None if self.service is None else self.service["log_json"])

    def _is_the_end(self, name: str, status: int) -> bool:
        """Return whether this death ends the cluster, and report why if it does."""
        if self.service is not None and os.WIFEXITED(status) and os.WEXITSTATUS(status) == _DOWN:
            _tell({"down": name})
            return True
        if not self._replaces or self._deaths.are_too_many(len(self.children)):
            _tell({"failed": f"{name} {how(status)}"})
            return True
        return False

    def _fork_again(self, name: str) -> None:
        """Fork a process in the place of a dead one.

        A new node or spy gets no topology, so it makes no links: the links of its neighbours may have changed since the
        launch, and the conductor of its job gives it the right ones.
        """
        kind, _, number = name.partition(" ")
        if kind == "router":
            with contextlib.suppress(FileNotFoundError):
                (self.folder / "router.sock").unlink()
            complaint = self._fork_router()
            if complaint is not None:  # its exit is another death, after which it is forked again
                self._log("warning", f"router: {complaint}", self.name, name)
        elif kind == "coordinator":
            self._fork(name, self._coordinate)
        elif kind == "spy":
            self._fork(name, partial(self._spy, ""))
        else:
            self._fork(name, partial(self._node, int(number), ""))

    def _kill_all(self) -> None:
        """Kill all children and remove the folder; the router last, so that its end says that all others are gone."""
        shutil.rmtree(self.folder, ignore_errors=True)
        routers = [process for process, name in self.children.items() if name == "router"]
        for processes in (self.children.keys() - set(routers), routers):
            for process in processes:
                os.kill(process, signal.SIGKILL)
            for process in processes:
                os.waitpid(process, 0)
        shutil.rmtree(self.folder, ignore_errors=True)


def _be_a_child(parent: int, name: str, nothing: int) -> None:
    """Set up a child: a name for `ps`, an end with the zygote, unblocked signals, and no hold on the zygote's pipes."""
    linux.name_process(f"sn {name}")
    linux.end_with_parent(parent)
    if os.getsid(0) == parent and not name.startswith("node "):  # a crowd's session is for nodes, see `launcher._CROWD`
        os.setsid()
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _WAKING)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)  # else the caller could not see the end of the zygote's output while a child runs
    os.close(nothing)


def _tell(event: dict[str, Any]) -> None:
    """Write an event to the caller, see `coordinator.launch.launcher.Launcher`."""
    with contextlib.suppress(BrokenPipeError):  # the caller is gone; the main loop notices that
        sys.stdout.write(json.dumps(event) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
