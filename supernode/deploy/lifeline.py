"""Standard input as the lifeline of a process that another machine has started: it brings the secret, and its end."""

import fcntl
import os
import re
import select
import signal
import sys

from problems.errors import BadInput
from wire.seal import SECRET_BYTES


def read_secret() -> bytes:
    """Return the cluster's secret, the first line of standard input.

    Raises:
        BadInput: if that is no secret.
    """
    text = b""  # byte by byte: what a larger buffer took of the input, `end_with_stdin` would not see
    while not text.endswith(b"\n") and (read := os.read(sys.stdin.fileno(), 1)):
        text += read
    if not re.fullmatch(rb"[0-9a-f]{%d}\n" % (2 * SECRET_BYTES), text):
        raise BadInput(f"--lifeline: expected a line of {2 * SECRET_BYTES} hexadecimal digits, found something else")
    return bytes.fromhex(text.decode())


def end_with_stdin() -> None:
    """Have the kernel send SIGHUP to this process when standard input ends, or brings anything more.

    A thread that waits for it was not taken, since a process with threads must not fork.
    """
    stdin = sys.stdin.fileno()
    fcntl.fcntl(stdin, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(stdin, fcntl.F_SETSIG, signal.SIGHUP)
    fcntl.fcntl(stdin, fcntl.F_SETFL, fcntl.fcntl(stdin, fcntl.F_GETFL) | os.O_ASYNC)
    if select.select([stdin], [], [], 0.0)[0]:  # it has ended before the kernel was asked
        os.kill(os.getpid(), signal.SIGHUP)
