"""The interfaces between the service and the dispatcher: what a dispatcher reports, and what a service asks of it."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import zenoh

from coordinator.jobs.job import JobEntry, JobSpec, Placement
from spy.improvement_records import ImprovementRecord
from spy.result import Result
from wire.hosts import Host
from wire.keys import Keys
from wire.news import Improvement, LogRecord, Statistics


class Hooks(Protocol):
    """Callbacks of the dispatcher, which it calls on any thread.

    Only `placed` and those about hosts may wait: the dispatcher may hold its lock, or be on Zenoh's thread, when it
    calls the others.
    """

    def changed(self, number: int, status: str, nodes: tuple[int, ...]) -> None:
        """A job has entered a state, or has other nodes; ``nodes`` are in the order of its cells."""

    def placed(self, number: int, placement: Placement) -> None:
        """A job is about to begin an epoch. When this returns, a coordinator that takes over will know it."""

    def improved(self, number: int, improvement: Improvement) -> None:
        """A better answer was verified."""

    def lived(self, number: int, epoch: int, records: Sequence[ImprovementRecord]) -> None:
        """An epoch of a job has ended with these improvements; may be called again for the same epoch."""

    def measured(self, statistics: Statistics) -> None:
        """Statistics of a job have come, twice a second."""

    def logged(self, record: LogRecord) -> None:
        """A process has published a log message."""

    def ended(self, number: int, outcome: Result | Exception, forget: Callable[[], None]) -> None:
        """A job has ended, with a result or because something broke.

        Call ``forget`` once a coordinator that takes over will know that: until then it may need the nodes, which keep
        their reports, to end the job again.
        """

    def known_hosts(self) -> Sequence[tuple[Host, bool]]:
        """Return the hosts that the previous coordinator knew, each with whether it had given the host up."""
        ...

    def keep_hosts(self, hosts: Sequence[tuple[Host, bool]]) -> bool:
        """Hosts have come or gone; return whether a coordinator that takes over will know these."""
        ...


class NoHooks:
    """Hooks that do nothing."""

    def changed(self, number: int, status: str, nodes: tuple[int, ...]) -> None:
        """See `Hooks`."""

    def placed(self, number: int, placement: Placement) -> None:
        """See `Hooks`."""

    def improved(self, number: int, improvement: Improvement) -> None:
        """See `Hooks`."""

    def lived(self, number: int, epoch: int, records: Sequence[ImprovementRecord]) -> None:
        """See `Hooks`."""

    def measured(self, statistics: Statistics) -> None:
        """See `Hooks`."""

    def logged(self, record: LogRecord) -> None:
        """See `Hooks`."""

    def ended(self, number: int, outcome: Result | Exception, forget: Callable[[], None]) -> None:
        """See `Hooks`."""
        forget()

    def known_hosts(self) -> Sequence[tuple[Host, bool]]:
        """See `Hooks`."""
        return ()

    def keep_hosts(self, hosts: Sequence[tuple[Host, bool]]) -> bool:
        """See `Hooks`."""
        return True


class JobRunner(Protocol):
    """The interface that a service needs from its dispatcher, such as `service_dispatcher.ServiceDispatcher`.

    It refuses jobs with `BadInput` or `coordinator.jobs.scheduler.QueueFull`; the messages are for the client.
    """

    @property
    def topology(self) -> str:
        """The topology of the nodes at launch, which jobs get that ask for none."""
        ...

    def submit(self, spec: JobSpec, *, accepted_before: bool = False) -> JobEntry:
        """Queue a job. One that was ``accepted_before`` starts over and is never refused because the queue is full."""
        ...

    def adopt(self, spec: JobSpec, placement: Placement) -> JobEntry:
        """Take over a job that runs already."""
        ...

    def best_told(self, number: int) -> Improvement | None:
        """Return the best answer that clients were told of a job, which is forgotten then; None if nobody knows one."""
        ...

    def restored(self) -> None:
        """Note that all jobs of the previous coordinator are known now."""

    def cancel(self, number: int) -> None:
        """End a job, queued or running; nothing happens if it has ended already."""

    def update(self, number: int, fields: dict[str, Any]) -> int:
        """Replace fields of a job's problem; return the number of the new epoch once all nodes are prepared."""
        ...

    def rewire(self, number: int, topology: str) -> int:
        """Change a job's topology; return the number of the new epoch once all nodes are prepared."""
        ...

    def nodes(self) -> list[dict[str, Any]]:
        """Return each node as the command `status` shows it."""
        ...

    def placements(self) -> list[dict[str, Any]]:
        """Return how the jobs on several hosts are spread over them."""
        ...

    def spy(self) -> int | None:
        """Return the id of the spy's process; None if there is none."""
        ...

    def close(self) -> None:
        """Stop without calling any hook."""


class MakeJobRunner(Protocol):
    """A function that makes the dispatcher of a service."""

    def __call__(self, session: zenoh.Session, keys: Keys, nodes: int, hooks: Hooks) -> JobRunner:
        """Return a dispatcher of ``nodes`` nodes."""
        ...
