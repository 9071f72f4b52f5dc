"""The zygote: the process from which router, spy and nodes are forked, and their lifeline.

It imports everything and loads all compiled kernels once, never opens a Zenoh session (a fork after that hangs), and
forks. Children share its memory and need no import of their own.

It lives exactly as long as the calling process holds the other end of its standard input: when that ends, however it
ends, the zygote kills its children, removes the folder of their sockets, and ends. If the zygote itself is killed, the
kernel kills the children (a parent-death signal), and the caller, who sees the end of its standard output, removes the
folder. On standard output it tells, one JSON object a line, which processes there are and how one died.
"""

import contextlib
import ctypes
import fcntl
import gc
import json
import os
import shutil
import signal
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from node.berth import Berth

_PR_SET_PDEATHSIG = 1
_WAKING = {signal.SIGCHLD, signal.SIGIO}
_LIBC = ctypes.CDLL(None)


def main() -> None:
    """Run as ``python -m coordinator.zygote CONFIG`` by the launcher."""
    config = json.loads(sys.argv[1])
    folder = Path(config["folder"])
    _end_with_the_caller(folder)
    Zygote(config["cluster"], config["topology"], folder).run()


def _end_with_the_caller(folder: Path) -> None:
    """While it is still importing, the end of standard input interrupts the zygote with SIGIO."""

    def end(*_: object) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(0)

    signal.signal(signal.SIGIO, end)
    descriptor = sys.stdin.fileno()
    fcntl.fcntl(descriptor, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(descriptor, fcntl.F_SETFL, fcntl.fcntl(descriptor, fcntl.F_GETFL) | os.O_ASYNC)
    if _at_end(descriptor):
        end()


def _at_end(descriptor: int) -> bool:
    """True iff the other end of the pipe is closed; nothing is ever written to it."""
    import select

    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(0))


class Zygote:
    """The forks of one cluster."""

    def __init__(self, cluster: str, topology: str, folder: Path) -> None:
        self.cluster = cluster
        self.topology = topology
        self.folder = folder
        self.children: dict[int, str] = {}  # process id to name

    def run(self) -> None:
        """Fork all, then wait for a death, of the caller or of a child: it ends everything."""
        import topologies

        self._warm_up()
        signal.pthread_sigmask(signal.SIG_BLOCK, _WAKING)
        if not self._fork_router():
            signal.sigwait({signal.SIGCHLD})
            self._one_died()
            return self._kill_all()
        self._fork("spy", self._spy)
        for node in range(topologies.parse(self.topology).cells):
            self._fork(f"node {node}", partial(self._node, node))
        _tell({"processes": {name: process for process, name in self.children.items()}})
        while not (_at_end(sys.stdin.fileno()) or self._one_died()):
            signal.sigwait(_WAKING)
        return self._kill_all()

    def _warm_up(self) -> None:
        """Import all that a child will need, and no more garbage collection of it: children share its pages."""
        import_all()
        import node.process
        import spy.process
        from coordinator import huge_pages

        self._spy_watch, self._node_live = spy.process.watch, node.process.live
        gc.collect()
        gc.freeze()
        huge_pages.collapse()

    def _fork_router(self) -> bool:
        """The router first: when it listens, the others need not try twice. Whether it does."""
        ready, tell = os.pipe()

        def route() -> None:
            from coordinator.router import route

            os.close(ready)
            route(self._berth(0).router, tell)

        self._fork("router", route)
        os.close(tell)
        listens = os.read(ready, 1) != b""  # else it has died
        os.close(ready)
        return listens

    def _spy(self) -> None:
        self._spy_watch(self._berth(0))

    def _node(self, node: int) -> None:
        self._node_live(self._berth(node))

    def _berth(self, node: int) -> "Berth":
        from node.berth import Berth
        from wire import sessions

        return Berth(self.cluster, node, self.topology, self.folder, sessions.unix_socket(self.folder, "router"))

    def _fork(self, name: str, live: Callable[[], None]) -> None:
        parent = os.getpid()
        process = os.fork()
        if process != 0:
            self.children[process] = name
            return
        try:
            _be_a_child(parent)
            live()
        except BaseException as error:
            sys.stderr.write(f"{name}: {type(error).__name__}: {error}\n")
        finally:
            os._exit(1)  # a child's life has no other end

    def _one_died(self) -> bool:
        """Tell of a child's death, if there was one: a cluster that lacks a process is no use, so all end."""
        process, status = os.waitpid(-1, os.WNOHANG)
        if process == 0:
            return False
        _tell({"died": self.children.pop(process), "how": _how(status)})
        return True

    def _kill_all(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)
        for process in self.children:
            os.kill(process, signal.SIGKILL)
        for process in self.children:
            os.waitpid(process, 0)
        shutil.rmtree(self.folder, ignore_errors=True)


def _be_a_child(parent: int) -> None:
    """Die with the zygote, take signals as any process does, and leave its pipes alone."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
    signal.signal(signal.SIGIO, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _WAKING)
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)
    os.close(nothing)


def import_all() -> None:
    """Everything that router, spy and nodes need, with all compiled kernels."""
    import problems.registry
    import spy.process  # noqa: F401

    problems.registry.warm_up()


def _how(status: int) -> str:
    if os.WIFSIGNALED(status):
        return f"killed by {signal.Signals(os.WTERMSIG(status)).name}"
    return f"ended with exit status {os.WEXITSTATUS(status)}"


def _tell(event: dict[str, Any]) -> None:
    with contextlib.suppress(BrokenPipeError):  # the caller is gone; the loop sees that
        sys.stdout.write(json.dumps(event) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
