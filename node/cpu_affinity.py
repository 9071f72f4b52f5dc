"""How nodes share cores where there are more of them: who keeps to which core, and how long a turn is.

The kernel moves a thread to the core of whoever wakes it, so among many nodes that wake each other all the time caches
hold little for anyone, and some breed often while others wait. Blocks of the torus that keep to their cores take turns
evenly, and most neighbours are on the same core.
"""

import ctypes
import os
import platform
import struct
import time

from wire.control import Wiring

_PR_SET_TIMERSLACK = 29  # nanoseconds by which a nap may be longer than asked for, else 50,000
_CROWD = 8  # nodes on each core, at least: then a core has nothing to do only when all of them wait
LONG = 20e-3
"""Seconds: for nodes that wait for nobody and whose generations take long: after others' turns no cache is warm."""
_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}  # Linux's number of the system call; the C library has no name for it
_LIBC = ctypes.CDLL(None)

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
    _LIBC.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(1))


def stand_back() -> None:
    """Let other threads have this core, and Python, if they want them.

    A nap, as short as can be, instead of sched_yield(2): Linux 6.18 counts all that is left of a turn as used by who
    yields. Who yields all the time runs far ahead of all others in its books; who wakes up is placed in between, behind
    any thread that does not yield, for minutes (the kernel's own workers stood still for two).
    """
    time.sleep(1e-9)


def take_turns_of(seconds: float) -> None:
    """Ask for turns of that length for the main thread, from 0.1 to 100 ms; 0: as long as the kernel likes.

    Before Linux 6.12 they are always as long as the kernel likes.
    """
    if (number := _SCHED_SETATTR.get(platform.machine())) is not None:
        # struct sched_attr: size, policy, flags, niceness, priority, and the length of a turn in nanoseconds.
        main, nice = os.getpid(), os.getpriority(os.PRIO_PROCESS, 0)
        attributes = struct.pack("=IIQiIQQQ", 48, os.SCHED_BATCH, 0, nice, 0, round(seconds * 1e9), 0, 0)
        _LIBC.syscall(ctypes.c_long(number), main, attributes, 0)
