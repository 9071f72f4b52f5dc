"""Pass on what spy and nodes publish about jobs: better answers, statistics and log messages."""

import contextlib
from collections.abc import Mapping

import zenoh

from coordinator.jobs.conductor import Conductor
from coordinator.jobs.hooks import Hooks
from coordinator.jobs.job import JobEntry
from wire.callbacks import direct
from wire.keys import Keys
from wire.news import Improvement, LogRecord, Statistics
from wire.strict import Rejected


class Listener:
    """Listens for all jobs of a dispatcher; all that it calls is called on Zenoh's thread.

    Args:
        session: a Zenoh session through the router.
        keys: the key expressions of the cluster.
        jobs: the jobs by number, as they are at any time.
        conductors: the conductors of those that run, likewise.
        hooks: called with statistics and log messages.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        jobs: Mapping[int, JobEntry],
        conductors: Mapping[int, Conductor],
        hooks: Hooks,
    ) -> None:
        self._jobs = jobs
        self._conductors = conductors
        self._hooks = hooks
        # One subscriber for all jobs: a declaration takes time, and each key ever declared some memory.
        self._subscribers = [
            session.declare_subscriber(keys.best, direct(self._hear_best)),
            session.declare_subscriber(keys.spy_stats, direct(self._hear_statistics)),
            session.declare_subscriber(keys.log, direct(self._hear_log)),
        ]

    def _hear_best(self, sample: zenoh.Sample) -> None:
        with contextlib.suppress(Rejected):
            better = Improvement.decode(sample.payload.to_bytes())
            conductor = self._conductors.get(better.job)
            if conductor is not None:
                conductor.job.improve(better)

    def _hear_statistics(self, sample: zenoh.Sample) -> None:
        with contextlib.suppress(Rejected):
            statistics = Statistics.decode(sample.payload.to_bytes())
            job = self._jobs.get(statistics.job)
            if job is not None:
                job.tell(statistics)
                self._hooks.measured(statistics)

    def _hear_log(self, sample: zenoh.Sample) -> None:
        with contextlib.suppress(Rejected):
            record = LogRecord.decode(sample.payload.to_bytes())
            for job in list(self._jobs.values()):
                if record.job in (None, job.spec.number):
                    job.log.record(record)
            self._hooks.logged(record)
