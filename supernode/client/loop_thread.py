"""An asyncio loop in a thread of its own, for callers that block."""

import asyncio
import threading
from collections.abc import Coroutine
from typing import Any, TypeVar

from coordinator.errors import ClusterFailed

_Value = TypeVar("_Value")


class LoopThread:
    """An asyncio loop in a daemon thread, on which blocking callers run coroutines."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="supernode client", daemon=True)
        self._thread.start()
        self.runs = True

    def run(self, work: Coroutine[Any, Any, _Value]) -> _Value:
        """Run ``work`` on the loop and return its value; if the caller is interrupted, cancel it.

        Called on the loop's own thread it would wait for itself for ever.
        """
        if not self.runs:
            # A coroutine that is neither awaited nor closed would cause a warning.
            work.close()
            raise ClusterFailed("the client is closed")
        # Ctrl-C interrupts the caller's wait, not the loop: the coroutine must be cancelled by hand.
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise

    def stop(self) -> None:
        """End the thread and the worker threads of its loop."""
        asyncio.run_coroutine_threadsafe(self._loop.shutdown_default_executor(), self._loop).result()
        self.runs = False
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
