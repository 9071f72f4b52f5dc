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
    descriptor = sys.stdin.fileno()
    fcntl.fcntl(descriptor, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(descriptor, fcntl.F_SETFL, fcntl.fcntl(descriptor, fcntl.F_GETFL) | os.O_ASYNC)
    if at_end(descriptor):  # it may have ended before the signal was switched on
        end()


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
