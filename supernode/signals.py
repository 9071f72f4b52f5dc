"""The signals that ask a command to end in good order."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager


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
