"""Children that are stopped (SIGSTOP, a debugger, a suspended container): those that stay so for long count as dead."""

import os
import time

NODE_TIMEOUT = 15.0  # seconds


class StoppedChildren:
    """Notes which children are stopped, and since when.

    A lockstep torus waits for a stopped node for ever. The kernel tells a parent of a child that stops, so nobody has
    to guess from its silence, which might as well be a long evaluation.

    Args:
        patience: after how many seconds a stopped child counts as dead.
    """

    FLAGS = os.WUNTRACED | os.WCONTINUED
    """Flags for `os.waitpid`, so that it tells of these children too."""

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self._due: dict[int, float] = {}  # by process, when it counts as dead, on the monotonic clock

    def note(self, process: int, status: int) -> bool:
        """Note what `os.waitpid` has told; return whether the child has only stopped or goes on, and is not dead."""
        if os.WIFSTOPPED(status):
            self._due[process] = time.monotonic() + self._patience
            return True
        self._due.pop(process, None)
        return os.WIFCONTINUED(status)

    def seconds_left(self) -> float | None:
        """Return the seconds until the next one counts as dead; None if none is stopped."""
        due = min(self._due.values(), default=None)
        return None if due is None else max(0.0, due - time.monotonic())

    def dead(self) -> list[int]:
        """Return the processes that have been stopped for too long, and forget them."""
        now = time.monotonic()
        found = [process for process, due in self._due.items() if due <= now]
        for process in found:
            del self._due[process]
        return found
