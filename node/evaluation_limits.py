"""Limits of an evaluation in a user's own code; a process that exceeds them is ended."""

import os
import resource
import signal
from dataclasses import dataclass
from pathlib import Path

from genetics.arrays import Evaluate, Fitness, Genomes
from problems import EvaluationFailed


@dataclass(frozen=True)
class EvaluationLimits:
    """Limits of an evaluation in a user's own code; a process that exceeds them is ended.

    Attributes:
        seconds: of real time for one individual, times as many as are evaluated together; None for any time.
        memory: the bytes that a process may take beside what it has before its first job; None for any.
    """

    seconds: float | None = None
    memory: int | None = None

    def apply(self) -> None:
        """Limit this process from now on. Call it on the main thread, once the process has what it needs."""
        if self.seconds is not None:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)  # the process may have inherited that it is ignored
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGALRM})
        if self.memory is not None:
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a process that exceeds the limit aborts
            _, hard = resource.getrlimit(resource.RLIMIT_DATA)
            most = _data_bytes() + self.memory
            most = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(resource.RLIMIT_DATA, (most, most))

    def evaluate(self, evaluate: Evaluate, genomes: Genomes) -> Fitness:
        """Evaluate genomes; this process, to which the limits apply, ends by SIGALRM or SIGABRT if they are exceeded.

        Raises:
            EvaluationFailed: if ``evaluate`` does.
        """
        if self.seconds is not None:
            # The kernel ends the process, whatever loops: compiled code would hold up a handler in Python.
            signal.setitimer(signal.ITIMER_REAL, self.seconds * len(genomes))
        try:
            return evaluate(genomes)
        except EvaluationFailed as error:
            if self.memory is not None and isinstance(error.__cause__, MemoryError):
                os.abort()
            raise
        finally:
            if self.seconds is not None:
                signal.setitimer(signal.ITIMER_REAL, 0.0)


def _data_bytes() -> int:
    """Return the bytes that count for RLIMIT_DATA now."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(each for each in lines if each.startswith("VmData:")).split()[1]) << 10
