"""The signals that ask a command to end in good order."""

import queue
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

_T = TypeVar("_T")
_LOOK_AGAIN = 1.0  # seconds


@contextmanager
def on_ending_signals(action: Callable[[], object]) -> Iterator[None]:
    """Call ``action`` when SIGINT (Ctrl-C), SIGTERM or SIGHUP comes, instead of dying.

    The action runs in the middle of whatever the main thread does: it may put something into a `queue.SimpleQueue`, but
    must take no lock. Blocking the signals instead would not do: threads of libraries that started earlier, such as
    those of linear algebra, take the signals that the main thread blocks.
    """
    kinds = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(kind, lambda *_: action()) for kind in kinds]
    try:
        yield
    finally:
        for kind, handler in zip(kinds, before, strict=True):
            signal.signal(kind, handler)


def wait_for_an_end(ends: queue.SimpleQueue[_T]) -> _T:
    """Wait, on the main thread, for what the action of `on_ending_signals` or another thread puts, and return it.

    Python calls the action when the main thread next runs. A signal that another thread takes, or that comes just
    before a wait begins, does not end that wait: so no wait is longer than a second.
    """
    while True:
        try:
            return ends.get(timeout=_LOOK_AGAIN)
        except queue.Empty:
            continue
