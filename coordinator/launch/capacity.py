"""Estimate how many node processes this machine can hold, and refuse to start more.

The needs of a node were measured (docs/cluster.md): 3.3 MB of proportional set size when idle, 9.4 MB after ten minutes
of 1024 asynchronous nodes; three to five threads; one file descriptor of the router.
"""

import os
import resource
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from coordinator.launch import cgroups
from problems.errors import BadInput
from wire.sessions import MOST_SESSIONS

NODE_BYTES = 10 << 20
NODE_THREADS = 5
NODES_A_CORE = 1024  # twice the number that was measured, 1024 nodes on two cores
# Needs of the other processes: zygote, router, spy and coordinator.
_OTHER_BYTES = 200 << 20
_OTHER_THREADS = 40
_OTHER_DESCRIPTORS = 40  # of the router alone
_OTHER_SESSIONS = 100  # at the router, also those of a dashboard and of clients
_GIB = 1 << 30


@dataclass(frozen=True)
class Limit:
    """One limit of the machine.

    Attributes:
        nodes: how many nodes it allows.
        reason: a description of the limit, for error messages.
    """

    nodes: int
    reason: str


def check(nodes: int, *, force: bool = False, has_router: bool = True) -> None:
    """Refuse to start more nodes than this machine can hold.

    Args:
        nodes: how many are asked for.
        force: whether to start them nevertheless: then this does nothing.
        has_router: whether their router runs on this machine too.

    Raises:
        BadInput: if the machine cannot hold them; the message says how many it can hold, and which limit decides.
    """
    if force:
        return
    least = min(limits(has_router), key=lambda limit: limit.nodes)
    if nodes > least.nodes:
        raise BadInput(
            f"expected at most {least.nodes} nodes, which is what this machine can hold now ({least.reason}),"
            f" found {nodes}; ask for fewer, or insist with --force (in Python: force=True)"
        )


def limits(has_router: bool = True, root: Path = cgroups.ROOT) -> list[Limit]:
    """Return every limit that applies now; ``root`` is where /proc and /sys are looked for."""
    found = [_cores(), *_memory(root), *_threads(root)]
    return [*found, *_router()] if has_router else found


def _cores() -> Limit:
    cores = len(os.sched_getaffinity(0))
    return Limit(cores * NODES_A_CORE, f"{cores} cores may take {NODES_A_CORE} nodes each")


def _memory(root: Path) -> Iterator[Limit]:
    available = _kilobytes_available(root)
    if available is not None:
        yield _memory_limit(available << 10, "of memory are available")
    left = cgroups.memory_left(root)
    if left is not None:
        yield _memory_limit(left, "are left of this control group's memory limit")


def _memory_limit(left: int, words: str) -> Limit:
    nodes = max(0, left - _OTHER_BYTES) // NODE_BYTES
    return Limit(nodes, f"{left / _GIB:.1f} GiB {words}, and a node may need {NODE_BYTES >> 20} MiB")


def _kilobytes_available(root: Path) -> int | None:
    for line in _text(root / "proc/meminfo").splitlines():
        if line.startswith("MemAvailable:"):
            return int(line.split()[1])
    return None


def _threads(root: Path) -> Iterator[Limit]:
    """Yield every limit on threads; Linux counts each thread as a process."""
    running = _threads_running(root)
    for name in ("pid_max", "threads-max"):
        most = _text(root / "proc/sys/kernel" / name).strip()
        if most.isdigit():
            yield _thread_limit(int(most) - running, f"of kernel.{name}")
    left = cgroups.processes_left(root)
    if left is not None:
        yield _thread_limit(left, "of this control group's pids.max")
    most_of_user, _ = resource.getrlimit(resource.RLIMIT_NPROC)
    if most_of_user != resource.RLIM_INFINITY and os.getuid() != 0:  # the kernel does not apply this limit to root
        yield _thread_limit(most_of_user - _threads_of_user(root), "of this user's process limit (ulimit -u)")


def _thread_limit(left: int, words: str) -> Limit:
    nodes = max(0, left - _OTHER_THREADS) // NODE_THREADS
    return Limit(nodes, f"{max(0, left)} threads are left {words}, and a node may need {NODE_THREADS}")


def _threads_running(root: Path) -> int:
    """Return the number of threads of the whole system, from proc_loadavg(5): "0.1 0.1 0.1 1/247 4711"."""
    fields = _text(root / "proc/loadavg").split()
    return int(fields[3].partition("/")[2]) if len(fields) > 3 else 0


def _threads_of_user(root: Path) -> int:
    """Return the number of threads of this process's user."""
    count = 0
    for folder in (root / "proc").glob("[0-9]*"):
        try:
            if folder.stat().st_uid == os.getuid():
                count += sum(1 for _ in (folder / "task").iterdir())
        except OSError:  # the process has ended meanwhile
            continue
    return count


def _router() -> Iterator[Limit]:
    yield Limit(MOST_SESSIONS - _OTHER_SESSIONS, f"a router takes {MOST_SESSIONS} sessions")
    _, most_files = resource.getrlimit(resource.RLIMIT_NOFILE)  # the router raises its own limit to this
    if most_files != resource.RLIM_INFINITY:
        nodes = max(0, most_files - _OTHER_DESCRIPTORS)
        yield Limit(nodes, f"a router may open {most_files} files (ulimit -Hn), one for each node")


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""
