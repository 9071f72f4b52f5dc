"""Standard input as the lifeline of the zygote: it brings the configuration, and its end is that of the caller."""

import fcntl
import os
import select
import shutil
import signal
import sys
from pathlib import Path


def first_line(descriptor: int) -> bytes:
    """Read the configuration, the only thing ever written to standard input; exit if the caller is gone already."""
    line = b""
    while not line.endswith(b"\n"):
        piece = os.read(descriptor, 1 << 16)
        if not piece:
            os._exit(0)
        line += piece
    return line


def end_with_the_caller(folder: Path) -> None:
    """Make the end of standard input interrupt the zygote (SIGIO) while it still imports, which takes long."""

    def end(*_: object) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(0)

    signal.signal(signal.SIGIO, end)
    if signal_the_end(sys.stdin.fileno(), signal.SIGIO):
        end()


def signal_the_end(descriptor: int, kind: signal.Signals) -> bool:
    """Have the kernel send a signal to this process when a pipe ends; return whether it had ended before.

    A thread that waits for it was not taken, since a process with threads must not fork.
    """
    fcntl.fcntl(descriptor, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(descriptor, fcntl.F_SETSIG, kind)
    fcntl.fcntl(descriptor, fcntl.F_SETFL, fcntl.fcntl(descriptor, fcntl.F_GETFL) | os.O_ASYNC)
    return at_end(descriptor)


def at_end(descriptor: int) -> bool:
    """Return whether the other end of the pipe is closed, as nothing more is ever written to it."""
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(0))


def comes_first(awaited: int, lifeline: int) -> bool:
    """Wait until one of two pipes can be read or is closed; return False if that is ``lifeline``."""
    poll = select.poll()
    for descriptor in (awaited, lifeline):
        poll.register(descriptor, select.POLLIN)
    return lifeline not in dict(poll.poll())
