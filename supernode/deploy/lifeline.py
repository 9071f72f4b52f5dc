"""Standard input as the lifeline of a process that another machine has started: it brings the secret, and its end."""

import os
import re
import signal
import sys

from coordinator.launch.lifeline import signal_the_end
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
    """End this process by SIGHUP when standard input ends, or brings anything more."""
    if signal_the_end(sys.stdin.fileno(), signal.SIGHUP):
        os.kill(os.getpid(), signal.SIGHUP)
