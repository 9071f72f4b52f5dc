"""One job, as its submitter sees it, and the messages to its conductor."""

import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import topologies
from coordinator.errors import ClusterFailed
from coordinator.jobs.checkpoint import Checkpoint
from problems import ProblemFile
from spy.improvement_records import ImprovementRecord
from spy.least_improvement import LEAST
from spy.past import Past
from spy.result import Result
from spy.run_log import RunLog
from topologies import Topology
from wire.news import Improvement, Statistics

_LOOK_AGAIN = 0.2  # seconds
_MOST_CRASHES = 20  # of processes of one job, beside one on each cell: afterwards nodes evaluate in a process apart
_MOST_RECORDS = 1 << 16  # improvements kept of one job, which may be kept alive for days


# Defaults of fields. They are functions, so that a simulation can replace the clock and the queues of this module.
def _new_queue() -> "queue.SimpleQueue[int | Exception]":
    return queue.SimpleQueue()


def _now() -> float:
    return time.monotonic()


# Messages to a conductor, besides answers and reports -----------------------------------------------------------------
@dataclass(frozen=True)
class StopRequest:
    """A client or a deadline wants the job to stop, or its oracle has found that it has no solution."""

    reason: Literal["cancel", "deadline", "infeasible"]


@dataclass(frozen=True)
class Failure:
    """The job cannot continue: a process died that is not replaced, or (``closing``) the cluster is being closed."""

    message: str
    closing: bool = False


@dataclass(frozen=True)
class Replaced:
    """The process of a node (None: of the spy) has died, and a new process has taken its place."""

    node: int | None


@dataclass(frozen=True)
class Returned:
    """The process of a node was cut off from the router and is back: it may have missed a question."""

    node: int


@dataclass(frozen=True)
class Moved:
    """The cells shall go on, with their demes, on these nodes.

    Attributes:
        nodes: the nodes in the order of the cells. If there are more of them than cells, the torus takes further rows.
    """

    nodes: tuple[int, ...]


@dataclass(frozen=True)
class Change:
    """A client wants the job to continue in another epoch.

    Attributes:
        fields: fields of the problem that replace the old ones.
        run: settings of the run that replace the old ones.
        answer: receives the number of the new epoch, or the exception that says why there is none.
    """

    fields: dict[str, Any]
    run: dict[str, Any]
    answer: "queue.SimpleQueue[int | Exception]" = field(default_factory=_new_queue)


# ----------------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class JobSpec:
    """A job as it was submitted.

    Attributes:
        number: the job's number, unique within the cluster.
        file: the problem file, with the settings of the run.
        log: the path of the run log; None for no log.
        job: the job's id; empty in a `LocalCluster`, where results show the number instead.
        priority: of one client's jobs, those of a higher priority start earlier.
        submitted: when the job was submitted, on the monotonic clock; its deadline counts from then.
        past: the sum of its earlier epochs, if the job begins again because no node is left that has its demes.
        best: the best verified answer that it had then, to the problem of ``file``.
        first: the problem file that it was submitted with, if ``file`` is a later one.
        checkpoint: where the job is to go on, if it is not to begin.
        checkpoint_every: how many seconds there are from one checkpoint to the next; None for no checkpoints.
        keep_checkpoint: keeps a checkpoint; raises OSError if it cannot.
        say: writes a line to the log of the cluster.
        least_improvement: the least improvement that gets a line in the run log, as a share of the fitness before.
        client: the name of the client that submitted it.
    """

    number: int
    file: ProblemFile
    log: str | None = None
    job: str = ""
    priority: int = 0
    submitted: float = field(default_factory=_now)
    past: Past = field(default_factory=Past)
    best: Improvement | None = None
    first: ProblemFile | None = None
    checkpoint: Checkpoint | None = None
    checkpoint_every: float | None = None
    keep_checkpoint: Callable[[Checkpoint], None] = lambda _: None
    say: Callable[[str], None] = lambda _: None
    least_improvement: float = LEAST
    client: str = ""


@dataclass(frozen=True)
class Placement:
    """The latest epoch of a job and its nodes: what a coordinator must know to take over from a dead one.

    Attributes:
        epoch: the number of the epoch.
        file: the problem file that holds in it.
        nodes: the job's nodes, in the order of its cells.
        wiring: the number of the links between the nodes.
        why: the directive that says why this epoch followed the previous one.
        past: the sum of the earlier epochs; the one just before may be missing, as its cells may not have stopped yet.
        best: the best verified answer so far; only for a coordinator that takes over.
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
    """The event that a job begins another attempt after it has stalled; ``why`` is the attempt's directive."""

    why: Mapping[str, Any]


@dataclass(frozen=True)
class CheckpointFailed:
    """The event that a checkpoint could not be kept, as on a full disk; the job goes on. ``why`` names the file."""

    why: str


Event = Improvement | Statistics | BegunAnew | CheckpointFailed


class Job:
    """A job of a cluster. Any thread may use it; each improvement or event goes to one reader only."""

    def __init__(self, spec: JobSpec) -> None:
        self.spec = spec
        self.queue: queue.SimpleQueue[object] = queue.SimpleQueue()
        self._history: deque[ImprovementRecord] = deque(maxlen=_MOST_RECORDS)
        self._news: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
        self._ended = threading.Event()
        self._result: Result | None = None
        self._error: Exception | None = None

    def improvements(self) -> Iterator[Improvement]:
        """Yield each verified improvement as it comes, until the job ends.

        Raises:
            BadInput: if the problem turns out to be wrong where its module is imported.
        """
        for event in self.events():
            if isinstance(event, Improvement):
                yield event

    def events(self) -> Iterator[Event]:
        """Yield improvements, new attempts, and statistics over all nodes twice a second, until the job ends.

        Raises:
            BadInput: as `improvements`.
        """
        while (event := self._news.get()) is not None:
            yield event
        self._news.put(None)  # so that another iteration ends too
        if self._error is not None:
            raise self._error

    def result(self, timeout: float | None = None) -> Result:
        """Wait for the end of the job and return its result.

        If the cluster or the problem broke, the result's status is "failed" and its message says why.

        Args:
            timeout: seconds to wait; None for any time.

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
        """Return the improvements in all epochs that have ended; of very many only the latest.

        Equal lockstep runs have equal histories. The last epoch is included once the job has ended.
        """
        return list(self._history)

    def cancel(self) -> None:
        """Ask all cells to stop; the result is the best so far, with status "cancelled"."""
        self.queue.put(StopRequest("cancel"))

    def update(self, **fields: Any) -> int:
        """Change the problem while the job runs; the population continues in the changed problem.

        Args:
            fields: fields of the problem that replace the old ones.

        Returns:
            The number of the new epoch, once every node is prepared for it.

        Raises:
            BadInput: if the changed problem is not valid; the job continues with the old one.
            ClusterFailed: if the job has ended, or is being stopped.
        """
        return self._change(Change(fields, {}))

    def rewire(self, topology: str) -> int:
        """Link the job's cells as in another topology of as many cells; see `update`."""
        return self._change(Change({}, {"topology": topology}))

    def _change(self, change: Change) -> int:
        self.queue.put(change)
        while True:  # a conductor that ends does not answer what is left in its queue, so look at both
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
    """A job as the coordinator sees it.

    Args:
        spec: the job as it was submitted.
        keeps_events: whether to keep events for a reader; without one they would fill memory.
        cancel: called with the job's number to cancel it, also while it is queued. If None, its conductor gets the stop
            request.

    Attributes:
        log: its run log, which writes nothing if none was asked for.

    Raises:
        BadInput: if the run log cannot be written.
    """

    def __init__(self, spec: JobSpec, keeps_events: bool = True, cancel: Callable[[int], None] | None = None) -> None:
        super().__init__(spec)
        self._crashes = 0  # of its nodes' processes
        self.log = RunLog(spec.log, spec.least_improvement)
        self._keeps_events = keeps_events
        self._cancel = cancel

    def cancel(self) -> None:
        """See `Job`."""
        if self._cancel is None:
            super().cancel()
        else:
            self._cancel(self.spec.number)

    def replaced(self, node: int | None, crash: str) -> None:
        """Tell the conductor that a process has been replaced; see `Replaced`.

        A job whose problem makes processes ``crash`` (the signal, or "") fails, or it would harm the cluster's others.
        """
        self._crashes += bool(crash)
        if self._crashes > _MOST_CRASHES + topologies.parse(self.spec.file.run.topology).cells:
            why = f"the problem's code has crashed {self._crashes} processes, the last one by {crash}"
            if crash == "SIGALRM":
                why += ", since evaluations took longer than --eval-timeout"
            self.queue.put(Failure(why))
        else:
            self.queue.put(Replaced(node))

    def note(self, topology: Topology, records: Sequence[ImprovementRecord]) -> None:
        """Keep and log the improvements of an epoch that has ended."""
        self._history.extend(records)
        self.log.improvements(topology, records)

    def tell(self, event: Event) -> None:
        """Pass an event on to the reader, and statistics to the run log."""
        if isinstance(event, Statistics):
            self.log.statistics(event)
        if self._keeps_events:
            self._news.put(event)

    def end(self, outcome: Result | Exception) -> None:
        """End the job, with a result or with the exception that `result` and `events` are to raise."""
        if isinstance(outcome, Exception):
            self._error = outcome
        else:
            self._result = outcome
        self.log.close()
        self._ended.set()
        self._news.put(None)
