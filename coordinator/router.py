"""The embedded Zenoh router, in a process of its own: the control plane of a cluster."""

import os
import signal

from wire import sessions


def route(endpoint: str, ready: int) -> None:
    """Route until the process is ended; a byte is written to the descriptor ``ready`` when it listens."""
    sessions.use_runtime(sessions.ROUTER_RUNTIME)
    session = sessions.router(endpoint)
    os.write(ready, b"!")
    os.close(ready)
    while not session.is_closed():
        signal.pause()
