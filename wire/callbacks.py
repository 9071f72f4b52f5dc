"""Callbacks that Zenoh calls on the thread that received the message.

By default Zenoh's Python binding hands each message over to another thread, which runs the callback. That change of
threads would be most of the cost of an exchange, so these handlers avoid it (``indirect=False``). The price: a callback
must not block, since no further message is received meanwhile, and must not declare anything at its session.
"""

import ctypes
import threading
from collections.abc import Callable
from typing import Any

import zenoh

_thread = threading.local()


def direct(function: Callable[[Any], None], end: Callable[[], None] | None = None) -> Any:
    """Return a handler that calls ``function`` on the thread that received the message; ``function`` must not block.

    Use it for everything but the messages of exchanges (`frequent`).

    Args:
        function: takes the message: a sample, a query or a reply.
        end: called once, when no more messages will come; for a query, after its last reply.
    """

    def call(message: Any) -> None:
        _keep_thread_state()
        function(message)

    return frequent(call, end)


def frequent(function: Callable[[Any], None], end: Callable[[], None] | None = None) -> Any:
    """Return a handler for messages that arrive thousands of times a second: `direct` without its check in each call.

    It is only quick on a thread that has called a `direct` handler before, as a node's single network thread has. That
    call kept the thread's Python state. On another thread this handler works too, but CPython builds a state each time.
    """
    return zenoh.handlers.Callback(function, end, indirect=False)


def _keep_thread_state() -> None:
    """Keep this thread's Python state until the process ends.

    CPython creates a thread state before each call from a thread that it does not know, and frees it afterwards. That
    maps and unmaps 16 kB, a third of the cost of receiving a message.
    """
    # The mark is stored in the state itself, so a mark that is found proves that the state was kept.
    if not hasattr(_thread, "kept"):
        _thread.kept = True
        ctypes.pythonapi.PyGILState_Ensure()  # deliberately never released: the count of users stays above zero
