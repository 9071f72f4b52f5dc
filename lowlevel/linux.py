"""System calls of Linux that Python's standard library has no name for, each with an ordinary path."""

import ctypes
import os
import platform
import signal
import struct
import threading

from lowlevel.capabilities import capabilities

_PR_SET_PDEATHSIG = 1
_PR_SET_NAME = 15  # at most 15 bytes of it
_PR_SET_TIMERSLACK = 29  # nanoseconds by which a nap may be longer than asked for, else 50,000
_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}  # the number of the system call; the C library has no name for it
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
    """Let `ps` and `top` show the first 15 bytes of ``name``; the ordinary path leaves Python's name."""
    if capabilities().linux:
        _LIBC.prctl(_PR_SET_NAME, name.encode())


def wake_up_promptly() -> None:
    """Let naps of this thread, and of those that it starts, end on time; else they may last 50 µs longer."""
    if capabilities().linux:
        _LIBC.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(1))


def ask_for_turns(seconds: float) -> None:
    """Ask the scheduler for turns of that length for the main thread, from 0.1 to 100 ms; 0: as it likes.

    Linux before 6.12 ignores it, and so does the ordinary path: turns are as long as the kernel likes.
    """
    number = _SCHED_SETATTR.get(platform.machine())
    if capabilities().linux and number is not None:
        # struct sched_attr: size, policy, flags, niceness, priority, and the length of a turn in nanoseconds.
        main, nice = os.getpid(), os.getpriority(os.PRIO_PROCESS, 0)
        attributes = struct.pack("=IIQiIQQQ", 48, os.SCHED_BATCH, 0, nice, 0, round(seconds * 1e9), 0, 0)
        _LIBC.syscall(ctypes.c_long(number), main, attributes, 0)
