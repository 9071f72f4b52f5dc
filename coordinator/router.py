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
    """Route between all who connect to one of the ``endpoints``, until the process is ended.

    A byte is written to the descriptor ``ready`` when it listens.

    Raises:
        ClusterFailed: if it cannot listen there.
    """
    _, most_files = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most_files, most_files))  # one for each node; 1024 by default
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
    """What Zenoh says, without the places in its source, and at which endpoint as far as it tells."""
    named = [each for each in endpoints if each.partition("/")[2] in error]
    number = re.search(r"\(os error (\d+)\)", error)
    reason = error.partition(" at /")[0] if number is None else os.strerror(int(number[1]))
    return f"cannot listen at {' or '.join(named or endpoints)}: {reason}"
