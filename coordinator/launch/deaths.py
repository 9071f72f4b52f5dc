"""The deaths of the processes that a zygote has forked: how each died, and whether too many die."""

import os
import signal
import time
from pathlib import Path

_LATELY = 60.0  # seconds in which deaths are counted
_MOST_DEATHS = 20  # allowed besides one for each process; beyond that something is wrong that no new process mends
_LONG_LIFE = 2.0  # seconds; a node that has lived so long has most likely begun a job
_CRASHES = {signal.SIGSEGV, signal.SIGBUS, signal.SIGILL, signal.SIGFPE, signal.SIGABRT, signal.SIGALRM}


class Deaths:
    """Counts deaths.

    Args:
        folder: the folder of the processes, in which nodes note when they run a user's code.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._born: dict[int, float] = {}  # by process, when it was forked, on the monotonic clock
        self._crashes: dict[str, str] = {}  # by name, the signal by which its process crashed last
        self._times: list[float] = []  # of recent deaths, on the monotonic clock

    def note_birth(self, process: int) -> None:
        """Note that a process has been forked."""
        self._born[process] = time.monotonic()

    def note(self, process: int, name: str, status: int) -> None:
        """Note whether a process has crashed, and its death, unless a job's code is the cause."""
        now, born = time.monotonic(), self._born.pop(process)
        crash = os.WTERMSIG(status) if os.WIFSIGNALED(status) and os.WTERMSIG(status) in _CRASHES else None
        self._crashes[name] = "" if crash is None else signal.Signals(crash).name
        self._times = [each for each in self._times if now - each < _LATELY]
        if crash is None or not self._is_fault_of_a_job(name, now - born):
            self._times.append(now)

    def crash_of(self, name: str) -> str:
        """Return the signal by which the last process of that name crashed; "" if it did not."""
        return self._crashes.get(name, "")

    def are_too_many(self, processes: int) -> bool:
        """Return whether more have died lately than so many processes may."""
        return len(self._times) > processes + _MOST_DEATHS

    def _is_fault_of_a_job(self, name: str, life: float) -> bool:
        """Return whether what crashed was most likely a job's code, which the job's conductor counts."""
        from node.suspects import runs_code  # here: the zygote imports nothing of the nodes before it is set up

        kind, _, number = name.partition(" ")
        return kind == "node" and (life >= _LONG_LIFE or runs_code(self._folder, int(number)))


def how(status: int) -> str:
    """Return in words how a process has ended."""
    if os.WIFSIGNALED(status):
        return f"killed by {signal.Signals(os.WTERMSIG(status)).name}"
    return f"ended with exit status {os.WEXITSTATUS(status)}"
