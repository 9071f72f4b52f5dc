"""One job, as whoever submitted it sees it, and the mail of its conductor."""

import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from coordinator.errors import ClusterFailed
from problems import ProblemFile, Run
from spy.improvement_records import ImprovementRecord
from spy.least_improvement import LEAST
from spy.past import Past
from spy.result import Result
from spy.run_log import RunLog
from topologies import Topology
from wire.news import Improvement, Statistics

_LOOK_AGAIN = 0.2  # seconds
_MOST_RECORDS = 1 << 16  # improvements of one job, which may be kept alive for days


# Mail: what a conductor is to know, beside answers and reports -------------------------------------------------------
@dataclass(frozen=True)
class StopRequest:
    """Somebody wants the job to stop, or its oracle has found that there is no way."""

    reason: Literal["cancel", "deadline", "infeasible"]


@dataclass(frozen=True)
class Failure:
    """The job cannot go on: a process died that nothing replaces, or (``closing``) the cluster is being closed."""

    message: str
    closing: bool = False


@dataclass(frozen=True)
class Replaced:
    """Another process lives in the place of a node, or of the spy if that is None: the one before has died."""

    node: int | None


@dataclass(frozen=True)
class Change:
    """Somebody wants the job to go on in another epoch.

    Attributes:
        fields: of the problem, each in the place of the old one.
        run: settings of the run, likewise.
        answer: takes the number of the new epoch, or why there is none.
    """

    fields: dict[str, Any]
    run: dict[str, Any]
    answer: "queue.SimpleQueue[int | Exception]" = field(default_factory=queue.SimpleQueue)


# ----------------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class JobSpec:
    """What was submitted.

    Attributes:
        number: of the job, unique in the cluster.
        log: a file for the run log.
        least_improvement: that is worth a line there, as a share of the fitness before.
        job: the job's name; its number if it was given none.
        submitted: on the monotonic clock.
        past: the epochs that it has lived in, if it begins again, when nobody is left who has its demes.
        best: the best verified answer that it had then, to the problem as it is now.
        first_run: the settings that it was submitted with, if others follow.
    """

    number: int
    file: ProblemFile
    log: str | None = None
    job: str = ""
    priority: int = 0
    submitted: float = field(default_factory=time.monotonic)
    past: Past = field(default_factory=Past)
    best: Improvement | None = None
    first_run: Run | None = None
    least_improvement: float = LEAST


@dataclass(frozen=True)
class Placement:
    """Where a job lives in its latest epoch: what a coordinator must know to take over from a dead one.

    Attributes:
        wiring: the number of the links between the nodes.
        why: how that epoch followed the one before, as a directive.
        past: the epochs before; that one's end may not be in it yet.
        best: the best verified answer so far, for a coordinator that takes over.
    """

    epoch: int
    file: ProblemFile
    nodes: tuple[int, ...]
    wiring: int
    why: Mapping[str, Any] = field(default_factory=dict)
    past: Past = field(default_factory=Past)
    best: Improvement | None = None


@dataclass(frozen=True)
class BegunAnew:
    """The job had stalled without an answer, and makes another attempt: ``why`` is its directive."""

    why: Mapping[str, Any]


Event = Improvement | Statistics | BegunAnew


class Job:
    """A job of a cluster."""

    def __init__(self, spec: JobSpec) -> None:
        self.spec = spec
        self.queue: queue.SimpleQueue[object] = queue.SimpleQueue()
        self._history: deque[ImprovementRecord] = deque(maxlen=_MOST_RECORDS)
        self._news: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
        self._ended = threading.Event()
        self._result: Result | None = None
        self._error: Exception | None = None

    def improvements(self) -> Iterator[Improvement]:
        """Each verified improvement as it comes; ends with the job.

        Raises:
            BadInput: if the problem turns out to be wrong where its module is imported.
        """
        for event in self.events():
            if isinstance(event, Improvement):
                yield event

    def events(self) -> Iterator[Event]:
        """Improvements, beginnings anew, and statistics of all its nodes twice a second; ends with the job."""
        while (event := self._news.get()) is not None:
            yield event
        self._news.put(None)  # for whoever asks again
        if self._error is not None:
            raise self._error

    def result(self, timeout: float | None = None) -> Result:
        """Wait for the end. If the cluster or the problem broke, the result's status is "failed" and it says why.

        Args:
            timeout: seconds.

        Raises:
            TimeoutError: if the job has not ended by then.
            BadInput: if the problem turns out to be wrong where its module is imported.
        """
        if not self._ended.wait(timeout):
            raise TimeoutError(f"job {self.spec.number} has not ended within {timeout} s")
        if self._error is not None:
            raise self._error
        assert self._result is not None
        return self._result

    def history(self) -> list[ImprovementRecord]:
        """Every improvement of its epochs that have ended: the same for equal lockstep runs; of very many the latest.

        Those of the last epoch are there when the job has ended.
        """
        return list(self._history)

    def cancel(self) -> None:
        """Ask all cells to stop; the result is the best so far, with status "cancelled"."""
        self.queue.put(StopRequest("cancel"))

    def update(self, **fields: Any) -> int:
        """Change the world while the job runs: each of the problem's fields that is given replaces the old one.

        The live population goes on in it. Returns the number of the new epoch once every node is ready for it.

        Raises:
            BadInput: if there can be no such world; the job goes on in the old one.
            ClusterFailed: if the job has ended.
        """
        return self._change(Change(fields, {}))

    def rewire(self, topology: str) -> int:
        """Let the job's cells neighbour each other as in another topology of as many cells; see `update`."""
        return self._change(Change({}, {"topology": topology}))

    def _change(self, change: Change) -> int:
        self.queue.put(change)
        while True:
            try:
                answer = change.answer.get(timeout=_LOOK_AGAIN)
            except queue.Empty:
                if self._ended.is_set():
                    raise ClusterFailed(f"job {self.spec.job} has ended") from None
                continue
            if isinstance(answer, Exception):
                raise answer
            return answer


class JobEntry(Job):
    """The same job, as the coordinator sees it.

    Args:
        told: whether somebody may ask for its events.
        cancel: how it is cancelled, even while it is queued; if not given, its conductor is told.

    Attributes:
        log: its run log, of which nothing is kept if none is wanted.

    Raises:
        BadInput: if the run log cannot be written.
    """

    def __init__(self, spec: JobSpec, told: bool = True, cancel: Callable[[int], None] | None = None) -> None:
        super().__init__(spec)
        self.log = RunLog(spec.log, spec.least_improvement)
        self._told = told
        self._cancel = cancel

    def cancel(self) -> None:
        """See `Job`."""
        if self._cancel is None:
            super().cancel()
        else:
            self._cancel(self.spec.number)

    def note(self, topology: Topology, records: Sequence[ImprovementRecord]) -> None:
        """An epoch has ended, in which there were these improvements."""
        self._history.extend(records)
        self.log.improvements(topology, records)

    def tell(self, event: Event) -> None:
        """Pass on what happens."""
        if isinstance(event, Statistics):
            self.log.statistics(event)
        if self._told:
            self._news.put(event)

    def end(self, outcome: Result | Exception) -> None:
        """The job has ended, with a result or with the user's mistake."""
        if isinstance(outcome, Exception):
            self._error = outcome
        else:
            self._result = outcome
        self.log.close()
        self._ended.set()
        self._news.put(None)
