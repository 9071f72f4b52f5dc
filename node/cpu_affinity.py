"""How nodes share cores where there are more of them: who keeps to which core, and how long a turn is.

The kernel moves a thread to the core of whoever wakes it, so among many nodes that wake each other all the time caches
hold little for anyone, and some breed often while others wait. Blocks of the torus that keep to their cores take turns
evenly, and most neighbours are on the same core.
"""

import os
import time

from lowlevel import linux
from wire.control import Wiring

_CROWD = 8  # nodes on each core, at least: then a core has nothing to do only when all of them wait
LONG = 20e-3
"""Seconds: for nodes that wait for nobody and whose generations take long: after others' turns no cache is warm."""

CORES = sorted(os.sched_getaffinity(0))
"""Those that nodes may use: asked once, before any of them keeps to one."""


def core_of(wiring: Wiring, cell: int) -> int | None:
    """The core for the node on ``cell``; None if there are too few nodes on its host for that.

    The cells of a host, in their order, are dealt out in blocks of the same size: rows of the torus.
    """
    hosts = wiring.hosts or ("",) * len(wiring.nodes)
    place, nodes = hosts[:cell].count(hosts[cell]), hosts.count(hosts[cell])
    return CORES[place * len(CORES) // nodes] if share_cores(nodes) else None


def share_cores(nodes: int) -> bool:
    """Whether there are so many on a host that each keeps to a core."""
    return nodes >= _CROWD * len(CORES)


def take_turns() -> None:
    """Let this thread, and those that it starts, not interrupt each other: fewer switches between nodes."""
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    linux.wake_up_promptly()


def stand_back() -> None:
    """Let other threads have this core, and Python, if they want them.

    A nap, as short as can be, instead of sched_yield(2): Linux 6.18 counts all that is left of a turn as used by who
    yields. Who yields all the time runs far ahead of all others in its books; who wakes up is placed in between, behind
    any thread that does not yield, for minutes (the kernel's own workers stood still for two).
    """
    time.sleep(1e-9)
