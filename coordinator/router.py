"""The embedded Zenoh router, in a process of its own: the control plane of a cluster."""

import os
import signal
from collections.abc import Sequence

from wire import sessions


def route(endpoints: Sequence[str], ready: int) -> None:
    """Route between all who connect to one of the ``endpoints``, until the process is ended.

    A byte is written to the descriptor ``ready`` when it listens.
    """
    sessions.use_runtime(sessions.ROUTER_RUNTIME)
    session = sessions.router(endpoints)
    os.write(ready, b"!")
    os.close(ready)
    while not session.is_closed():
        signal.pause()
