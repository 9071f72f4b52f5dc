"""Report steps that take long to a listener, such as a program that prints them. Without a listener, do nothing."""

import contextlib
import threading
from collections.abc import Callable, Iterator

AFTER = 1.0  # seconds, before a step is reported
_listeners: list[Callable[[str], None]] = []


def set_listener(listener: Callable[[str], None]) -> None:
    """Set the listener, which is called with one line about each step that takes long.

    It replaces an earlier one. It is called on a timer's thread, not on the thread that is busy.
    """
    _listeners[:] = [listener]


@contextlib.contextmanager
def reporting_if_slow(what: str) -> Iterator[None]:
    """Report ``what`` to the listener if the body of this context takes longer than `AFTER` seconds."""
    timer = threading.Timer(AFTER, lambda: [listener(f"{what} ...") for listener in _listeners])
    timer.daemon = True
    if _listeners:
        timer.start()
    try:
        yield
    finally:
        timer.cancel()
