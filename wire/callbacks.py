"""Callbacks that Zenoh calls on the thread that received the message.

By default Zenoh's Python binding hands each message over to another thread, which runs the callback. That change of
threads would be most of the cost of an exchange, so these handlers avoid it (``indirect=False``). The price: a callback
must not block, since no further message is received meanwhile, and must not declare anything at its session.
"""

from collections.abc import Callable
from typing import Any

import zenoh

from lowlevel import thread_state


def direct(function: Callable[[Any], None], end: Callable[[], None] | None = None) -> Any:
    """Return a handler that calls ``function`` on the thread that received the message; ``function`` must not block.

    Use it for everything but the messages of exchanges (`frequent`).

    Args:
        function: takes the message: a sample, a query or a reply.
        end: called once, when no more messages will come; for a query, after its last reply.
    """

    def call(message: Any) -> None:
        thread_state.keep()
        function(message)

    return frequent(call, end)


def frequent(function: Callable[[Any], None], end: Callable[[], None] | None = None) -> Any:
    """Return a handler for messages that arrive thousands of times a second: `direct` without its check in each call.

    It is only quick on a thread that has called a `direct` handler before, as a node's single network thread has. That
    call kept the thread's Python state (`lowlevel.thread_state`). On another thread this handler works too, but CPython
    builds a state for each message.
    """
    return zenoh.handlers.Callback(function, end, indirect=False)
