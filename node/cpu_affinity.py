"""Placement of nodes on cores where nodes outnumber cores: which core a node is pinned to, and its time slice.

The kernel moves a thread to the core of the thread that wakes it. Among many nodes that wake each other all the time,
caches then hold little that helps anyone, and some nodes breed often while others wait. Blocks of the torus that are
pinned to one core each take turns evenly, and most neighbours share a core.
"""

import contextlib
import os
import time

from lowlevel import linux
from wire.control import Wiring

_CROWD = 8  # nodes for each core, from which on they are pinned; with fewer a core might idle while all its nodes wait
_NICENESS = 5  # added to that of the process: its weight among processes of the usual one is a third
LONG = 20e-3
"""Seconds of a long time slice, for nodes that wait for nobody and whose generations take long.

After the other nodes' turns no cache is warm, so a turn must be long enough to make up for that.
"""

CORES = sorted(os.sched_getaffinity(0))
"""The cores that nodes may use. Asked once, when the module is imported: a pinned node would see only its own core."""


def core_of(wiring: Wiring, cell: int) -> int | None:
    """Return the core for the node on ``cell``; None if its host has too few nodes to pin them.

    Each core gets a block of consecutive cells of its host, all of the same size up to one cell; on a torus a block is
    some rows.
    """
    hosts = wiring.hosts or ("",) * len(wiring.nodes)
    place, nodes = hosts[:cell].count(hosts[cell]), hosts.count(hosts[cell])
    return CORES[place * len(CORES) // nodes] if share_cores(nodes) else None


def share_cores(nodes: int) -> bool:
    """Return whether a host of so many nodes pins each of them to a core."""
    return nodes >= _CROWD * len(CORES)


class Pinning:
    """The core of this process's two threads, and the main thread's time slice, as they were asked for last.

    Attributes:
        network_thread: the id of Zenoh's thread; until that is known 0, which the kernel takes for the calling thread.
    """

    def __init__(self) -> None:
        self.network_thread = 0
        self._core: int | None = None
        self._turns = 0.0

    def pin(self, core: int | None, seconds: float) -> None:
        """Pin both threads to a core, or to none, and ask for time slices of ``seconds`` for the main thread."""
        if seconds != self._turns:
            self._turns = seconds
            linux.ask_for_turns(seconds)
        if core != self._core:
            self._core = core
            with contextlib.suppress(OSError):  # the core has been taken from this process, for instance by a cpuset
                for thread in (os.getpid(), self.network_thread):
                    os.sched_setaffinity(thread, CORES if core is None else {core})


def take_turns() -> None:
    """Schedule this thread, and those that it starts later, as batch threads with exact timers.

    A batch thread that wakes up does not preempt the running one, so there are fewer switches between nodes. Exact
    timers (a slack of 1 ns) keep the nap of `stand_back` short. The spy and the coordinator go first: a better solution
    is of use only once it is verified and told.
    """
    os.nice(_NICENESS)
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    linux.wake_up_promptly()


def stand_back() -> None:
    """Give other threads a chance to take this core, and the interpreter's lock, by the shortest possible sleep.

    sched_yield(2) does not serve. Linux 6.18 charges a yielding thread for the rest of its time slice, so threads that
    yield all the time run far ahead of all others in the scheduler's accounts. A thread that wakes up is placed between
    both groups, and so behind any thread that does not yield, for minutes (kernel workers stood still for two).
    """
    time.sleep(1e-9)
