"""Between the service and the dispatcher: what each may ask of the other."""

from collections.abc import Sequence
from typing import Any, Protocol

import zenoh

from coordinator.job import JobEntry, JobSpec, Placement
from spy.improvement_records import ImprovementRecord
from spy.result import Result
from wire.keys import Keys
from wire.news import Improvement, LogRecord, Statistics


class Hooks(Protocol):
    """What the dispatcher tells, on any thread; nobody waits in there."""

    def changed(self, number: int, status: str, nodes: tuple[int, ...]) -> None:
        """A job's state, or the nodes that it lives on, in the order of its cells."""

    def placed(self, number: int, placement: Placement) -> None:
        """A job is about to begin in an epoch; when this returns it is known to whoever takes over."""

    def improved(self, number: int, improvement: Improvement) -> None:
        """A better answer was verified."""

    def lived(self, number: int, epoch: int, records: Sequence[ImprovementRecord]) -> None:
        """An epoch of a job has ended, in which there were these improvements; the same may be told again."""

    def measured(self, statistics: Statistics) -> None:
        """How a job is, twice a second."""

    def logged(self, record: LogRecord) -> None:
        """A process has something to say."""

    def ended(self, number: int, outcome: Result | Exception) -> None:
        """A job has ended, with a result or because something broke."""


class Dispatcher(Protocol):
    """What runs jobs. It refuses with `BadInput` or `coordinator.scheduler.QueueFull`, in words for the client."""

    @property
    def topology(self) -> str:
        """How the nodes were wired when they were launched: that of jobs that ask for none."""
        ...

    def submit(self, spec: JobSpec, *, accepted_before: bool = False) -> JobEntry:
        """Queue a job; one that was ``accepted_before`` is never too many, and no node may still be at it."""
        ...

    def adopt(self, spec: JobSpec, placement: Placement) -> JobEntry:
        """A job that runs already."""
        ...

    def cancel(self, number: int) -> None:
        """End a job, queued or running; nothing happens if it has ended already."""

    def update(self, number: int, fields: dict[str, Any]) -> int:
        """Another epoch for a job; its number, once all nodes are prepared."""
        ...

    def rewire(self, number: int, topology: str) -> int:
        """Another topology for a job, which makes another epoch; its number."""
        ...

    def nodes(self) -> list[dict[str, Any]]:
        """Each node, as `status` shows it."""
        ...

    def spy(self) -> int | None:
        """The process of the spy, if there is one."""
        ...

    def close(self) -> None:
        """Stop, without a word to the hooks."""


class MakeDispatcher(Protocol):
    """How a dispatcher is made."""

    def __call__(self, session: zenoh.Session, keys: Keys, nodes: int, hooks: Hooks) -> Dispatcher:
        """A dispatcher of that many nodes."""
        ...
