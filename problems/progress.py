"""Tells people what takes long, if the program that uses these packages wants them told."""

import contextlib
import threading
from collections.abc import Callable, Iterator

AFTER = 1.0  # seconds
_listeners: list[Callable[[str], None]] = []


def tell(listener: Callable[[str], None]) -> None:
    """From now on call ``listener``, on a thread of its own, with one line about each thing that takes long."""
    _listeners[:] = [listener]


@contextlib.contextmanager
def telling(what: str) -> Iterator[None]:
    """Tell ``what`` is being done, if it is not done within `AFTER` seconds."""
    timer = threading.Timer(AFTER, lambda: [listener(f"{what} ...") for listener in _listeners])
    timer.daemon = True
    if _listeners:
        timer.start()
    try:
        yield
    finally:
        timer.cancel()
