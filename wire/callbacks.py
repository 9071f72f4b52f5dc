"""Callbacks on Zenoh's own threads, without a Python thread in between."""

import ctypes
import threading
from collections.abc import Callable
from typing import Any

import zenoh

_thread = threading.local()


def direct(function: Callable[[Any], None], end: Callable[[], None] | None = None) -> Any:
    """A handler that calls ``function`` on the thread that received the message; it must not block.

    ``end`` is called once there will be no more messages.
    """

    def call(message: Any) -> None:
        _keep_thread_state()
        function(message)

    return frequent(call, end)


def frequent(function: Callable[[Any], None], end: Callable[[], None] | None = None) -> Any:
    """The same for messages that come thousands of times a second, on a thread that has called `direct` ones before."""
    return zenoh.handlers.Callback(function, end, indirect=False)


def _keep_thread_state() -> None:
    """Keep this thread's Python state for as long as the process lives.

    CPython makes a thread state before, and frees it after, each call from a thread that it does not know: 16 kB mapped
    and unmapped again, a third of what receiving costs.
    """
    if not hasattr(_thread, "kept"):
        _thread.kept = True
        ctypes.pythonapi.PyGILState_Ensure()  # never released, so it outlives this call
