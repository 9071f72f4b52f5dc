"""The embedded Zenoh router, in a process of its own: the control plane of a cluster."""

import os
import re
import resource
import signal
from collections.abc import Sequence

import zenoh

from coordinator.errors import ClusterFailed
from wire import sessions


def route(endpoints: Sequence[str], ready: int) -> None:
    """Run a router for everything that connects to one of the ``endpoints``, until the process is killed.

    Args:
        endpoints: Zenoh endpoints to listen at.
        ready: a descriptor that gets one byte, ``!``, when the router listens.

    Raises:
        ClusterFailed: if the router cannot listen there.
    """
    _, most_files = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most_files, most_files))  # each node takes one; the default is 1024
    sessions.use_runtime(sessions.ROUTER_RUNTIME)
    try:
        session = sessions.router(endpoints)
    except zenoh.ZError as error:
        raise ClusterFailed(_words(str(error), endpoints)) from error
    os.write(ready, b"!")
    os.close(ready)
    while not session.is_closed():
        signal.pause()


def _words(error: str, endpoints: Sequence[str]) -> str:
    """Return Zenoh's error as a sentence: without places in its source, with the endpoint as far as that is known."""
    named = [each for each in endpoints if each.partition("/")[2] in error]
    number = re.search(r"\(os error (\d+)\)", error)
    reason = error.partition(" at /")[0] if number is None else os.strerror(int(number[1]))
    return f"cannot listen at {' or '.join(named or endpoints)}: {reason}"
