"""System calls of Linux that Python's standard library has no name for, each with an ordinary path."""

import contextlib
import ctypes
import os
import platform
import signal
import struct
import threading
from pathlib import Path

from lowlevel.capabilities import capabilities

_PR_SET_PDEATHSIG = 1
_PR_SET_TIMERSLACK = 29  # option of prctl(2): ns by which a sleep may be longer than asked for; by default 50,000
_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}  # the system call's number; the C library has no wrapper for it
_LOOK_EVERY = 0.2  # seconds
_LIBC = ctypes.CDLL(None)


def end_with_parent(parent: int) -> None:
    """Have this process killed when the one that started it ends; exit now if ``parent`` has ended already.

    The kernel sends SIGKILL when the *thread* that started this process ends, so that thread must live as long as its
    process. The ordinary path looks at the parent's number several times a second, on a thread of its own: a process
    that holds Python's lock for long outlives its parent for as long.
    """
    if capabilities().linux:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    else:
        threading.Thread(target=_end_without, args=(parent,), name="lifeline", daemon=True).start()
    if os.getppid() != parent:  # it may have ended before this process asked
        os._exit(1)


def _end_without(parent: int) -> None:
    never = threading.Event()
    while os.getppid() == parent:
        never.wait(_LOOK_EVERY)
    os.kill(os.getpid(), signal.SIGKILL)


def name_process(name: str) -> None:
    """Let `ps` and `top` show the first 15 bytes of ``name``, where the system has a file for it."""
    with contextlib.suppress(OSError):
        Path("/proc/self/comm").write_text(name)


def wake_up_promptly() -> None:
    """Let naps of this thread, and of those that it starts, end on time; else they may last 50 µs longer."""
    if capabilities().linux:
        _LIBC.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(1))


def ask_for_turns(seconds: float) -> None:
    """Ask for time slices of that length for the main thread: 0.1 to 100 ms, or 0 for the kernel's default.

    Before Linux 6.12, on other processors, and on the ordinary path the default stays. May be called on any thread of
    the process. A failure is ignored: a node runs with other time slices too.
    """
    number = _SCHED_SETATTR.get(platform.machine())
    if capabilities().linux and number is not None:
        # struct sched_attr: size, policy, flags, niceness, priority, and the time slice in ns (its sched_runtime).
        main, nice = os.getpid(), os.getpriority(os.PRIO_PROCESS, 0)  # the main thread's id is that of its process
        attributes = struct.pack("=IIQiIQQQ", 48, os.SCHED_BATCH, 0, nice, 0, round(seconds * 1e9), 0, 0)
        _LIBC.syscall(ctypes.c_long(number), main, attributes, 0)
