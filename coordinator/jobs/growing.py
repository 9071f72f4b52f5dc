"""Give free nodes to running jobs that grow, once it is quiet: then each job takes further rows of its torus."""

import threading
import time
from collections.abc import Mapping

from coordinator.jobs.alarms import NO_JOB, Alarms
from coordinator.jobs.job import JobEntry, Moved
from coordinator.jobs.scheduler import Scheduler

_QUIET = 1.0  # seconds without another free node: the nodes of a host come one by one, and each growth costs a halt


class Growing:
    """Lets jobs grow. Any thread may use it.

    Args:
        lock: the dispatcher's lock, which guards the others.
        scheduler: gives the nodes.
        jobs: the jobs that have not ended, by number.
    """

    def __init__(self, lock: threading.RLock, scheduler: Scheduler, jobs: Mapping[int, JobEntry]) -> None:
        self._lock = lock
        self._scheduler = scheduler
        self._jobs = jobs
        self._alarms = Alarms(lambda _: self._grow())

    def look_soon(self) -> None:
        """Look for free nodes after a while, because a job or a node has come, or nodes have become free."""
        with self._lock:
            grows = any(job.spec.file.run.grow for job in self._jobs.values())
        if grows:
            self._alarms.set(NO_JOB, time.monotonic() + _QUIET)

    def _grow(self) -> None:
        """Give the nodes that are still free to running jobs that grow. On the alarms' thread."""
        with self._lock:
            for number, job in self._jobs.items():
                nodes = self._scheduler.extend(number) if job.spec.file.run.grow else None
                if nodes is not None:
                    job.queue.put(Moved(nodes))
