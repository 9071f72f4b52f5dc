"""Write what the dispatcher reports to the store, then publish it.

In this order, no client ever sees an end that a restart of the coordinator could undo. The only exception is a
deadline, which is published at once: a coordinator that takes over would find that it has passed, too.

The dispatcher does not wait for the disk: its calls put events into a queue, and a thread of the recorder writes all
that are there in one transaction. While the database is away it waits and tries again.
"""

import contextlib
import dataclasses
import math
import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from coordinator.jobs.job import Placement
from coordinator.jobs.states import ENDS, WrongTransition
from coordinator.log_lines import LogLines
from coordinator.store.database import StoreFailed
from coordinator.store.job_store import Store
from coordinator.store.record_book import RecordBook
from coordinator.store.stored_job import Summary, UnknownJob
from problems.errors import BadInput
from spy.improvement_records import ImprovementRecord
from spy.result import Result
from wire.hosts import Host
from wire.jobs import JobState
from wire.news import Improvement, LogRecord, Statistics
from wire.plain import plain
from wire.strict import Rejected

_TRY_AGAIN = 0.5  # seconds between two attempts while the database is away
_PATIENCE = 5.0  # seconds that the beginning of an epoch may be held back by the database
_SAMPLE_EVERY = 0.75  # seconds between stored statistics: every other one of the spy's, which come twice a second
_MOST_AT_ONCE = 1000  # events in a transaction


@dataclass(frozen=True)
class _Changed:
    number: int
    status: str
    nodes: tuple[int, ...]
    at: float


@dataclass(frozen=True)
class _Improved:
    number: int
    improvement: Improvement
    at: float


@dataclass(frozen=True)
class _Lived:
    number: int
    epoch: int
    records: Sequence[ImprovementRecord]
    at: float


@dataclass(frozen=True)
class _Measured:
    number: int
    statistics: Statistics
    at: float


@dataclass(frozen=True)
class _Ended:
    number: int
    outcome: Result | Exception
    forget: Callable[[], None]


@dataclass(frozen=True)
class _Placed:
    number: int
    placement: Placement
    written: threading.Event


@dataclass(frozen=True)
class _Logged:
    number: int | None
    record: LogRecord


_Event = _Changed | _Placed | _Improved | _Lived | _Measured | _Ended | _Logged


class Recorder:
    """The dispatcher's hooks in a cluster that stays up.

    Any thread may call the hooks; they only queue events for the recorder's thread.

    Args:
        store: takes jobs and their states.
        book: takes records: improvements, statistics, the log.
        lines: shows the log.
        publish: called with each change of a state, once it is stored.
        forget: called with the number of each job that has ended, once that is stored.
    """

    def __init__(
        self,
        store: Store,
        book: RecordBook,
        lines: LogLines,
        publish: Callable[[JobState], None],
        forget: Callable[[int], None],
    ) -> None:
        self._store = store
        self._book = book
        self._lines = lines
        self._measured: dict[int, float] = {}  # by job, the time of its latest stored statistics
        self._unwritten: dict[int, _Measured] = {}  # by job, later statistics, stored only if they remain the last
        self._publish = publish
        self._forget = forget
        self._events: queue.SimpleQueue[_Event | None] = queue.SimpleQueue()
        self._known: dict[int, Summary] = {}  # jobs under way, with their latest fitness; published at a deadline
        self._found: list[LogRecord] = []  # while events are written; shown once they are
        self._late: set[int] = set()  # jobs whose deadline was published before it was stored
        self._closing = threading.Event()
        self._write_lock = threading.Lock()  # held while a batch is written and published
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Hold back the recorder's thread, so that a new job is stored and published before its first events are."""
        with self._write_lock:
            yield

    def changed(self, number: int, status: str, nodes: tuple[int, ...]) -> None:
        """Record a job's state and its nodes; publish a deadline at once."""
        at = time.time()
        if status == "deadline" and (job := self._known.get(number)) is not None:
            # Clients must not wait for the disk at a deadline. A coordinator that takes over would publish the same.
            self._late.add(number)
            self._publish(dataclasses.replace(state_of(job, at), status=status))
        self._events.put(_Changed(number, status, nodes, at))

    def placed(self, number: int, placement: Placement) -> None:
        """Record that a job is about to begin an epoch; return when that is stored, or the database is away for long.

        The nodes begin the epoch only after this. If the coordinator dies in between, the next one knows the epoch.
        """
        job = self._known.get(number)
        if job is not None and placement.why.get("do") == "update":
            self._known[number] = dataclasses.replace(job, fitness=None)
        written = threading.Event()
        self._events.put(_Placed(number, placement, written))
        written.wait(_PATIENCE)

    def improved(self, number: int, improvement: Improvement) -> None:
        """Record a better answer."""
        job = self._known.get(number)
        if job is not None and math.isfinite(improvement.fitness):
            self._known[number] = dataclasses.replace(job, fitness=improvement.fitness)
        self._events.put(_Improved(number, improvement, time.time()))

    def lived(self, number: int, epoch: int, records: Sequence[ImprovementRecord]) -> None:
        """Record the improvements of an epoch that has ended."""
        self._events.put(_Lived(number, epoch, records, time.time()))

    def measured(self, statistics: Statistics) -> None:
        """Record a job's statistics, about once a second; the last ones of a job are stored in any case."""
        at = time.time()
        if at - self._measured.get(statistics.job, 0.0) >= _SAMPLE_EVERY:
            self._measured[statistics.job] = at
            self._unwritten.pop(statistics.job, None)
            self._events.put(_Measured(statistics.job, statistics, at))
        else:
            self._unwritten[statistics.job] = _Measured(statistics.job, statistics, at)

    def logged(self, record: LogRecord) -> None:
        """Record a log message of a process, and show it."""
        self._events.put(_Logged(record.job, record))

    def ended(self, number: int, outcome: Result | Exception, forget: Callable[[], None] = lambda: None) -> None:
        """Record the end of a job, and then call ``forget``."""
        if (last := self._unwritten.pop(number, None)) is not None:
            self._events.put(last)
        self._events.put(_Ended(number, outcome, forget))

    def known_hosts(self) -> list[tuple[Host, bool]]:
        """Return the hosts that are stored, less those of another version of this program."""
        hosts = []
        for data, given_up in self._store.hosts():
            with contextlib.suppress(Rejected):
                hosts.append((Host.decode(data), given_up))
        return hosts

    def keep_hosts(self, hosts: Sequence[tuple[Host, bool]]) -> bool:
        """Store all hosts; return whether that worked. If not, log it: the next coordinator might not know them."""
        try:
            self._store.keep_hosts([(host.encode(), given_up) for host, given_up in hosts])
        except StoreFailed as error:
            self.logged(log_record("warning", f"the hosts are not stored: {error}"))
            return False
        return True

    def close(self) -> None:
        """Write what has come so far, and stop. Idempotent. If the database is away, these events are lost."""
        self._closing.set()
        self._events.put(None)
        self._thread.join()

    def _work(self) -> None:
        while events := self._batch():
            self._settle(events, may_grow=True)

    def _batch(self) -> list[_Event]:
        """Wait for an event; return all that have come by then, or none when the recorder is closed."""
        events: list[_Event] = []
        self._take(events, self._events.get())
        return events

    def _take(self, events: list[_Event], event: _Event | None) -> None:
        """Append an event and all that have come by now; show those of the log, whether they can be stored or not."""
        with contextlib.suppress(queue.Empty):
            while event is not None:
                events.append(event)
                if isinstance(event, _Logged):
                    self._show(event.record)
                if len(events) >= _MOST_AT_ONCE:
                    return
                event = self._events.get_nowait()
            self._events.put(None)  # the recorder is being closed; nothing comes after that

    def _settle(self, events: list[_Event], may_grow: bool = False) -> None:
        """Write and publish events, however long it takes; leave out single events that the database refuses.

        Args:
            events: the events.
            may_grow: whether to append what comes meanwhile, so that the log is shown.
        """
        away = False
        while True:
            try:
                return self._commit(events)
            except StoreFailed as error:
                if not away:
                    self._lines.write(log_record("warning", str(error)))
                if not error.passing:
                    return self._settle_one_by_one(events, error)
                away = True
            if self._closing.wait(_TRY_AGAIN):
                return None
            if may_grow and len(events) < _MOST_AT_ONCE:
                with contextlib.suppress(queue.Empty):
                    self._take(events, self._events.get_nowait())

    def _settle_one_by_one(self, events: list[_Event], error: StoreFailed) -> None:
        """Write each event in a transaction of its own, without those that the database refuses.

        An end is stored as a failure then: clients wait for it, even without a result.
        """
        if len(events) > 1:
            for event in events:
                self._settle([event])
        elif isinstance(event := events[0], _Ended) and not isinstance(event.outcome, StoreFailed):
            self._settle([dataclasses.replace(event, outcome=error)])

    def _commit(self, events: list[_Event]) -> None:
        """Write events in one transaction, then publish the new states.

        Raises:
            StoreFailed: if the database fails; then nothing of this is stored or published.
        """
        self._found.clear()
        with self._write_lock:
            with self._store.transaction():
                # Every improvement is a record, but only the latest of each job in this batch is its best answer.
                for event in events:
                    self._write_record(event)
                states = [self._write(event) for event in _latest(events)]
                self._book.forget_the_old(time.time())
            for state in states:
                if state is not None:
                    self._publish(state)
        for record in self._found:
            self._show(record)
        for event in events:
            if isinstance(event, _Placed):
                event.written.set()
        for event in events:
            if isinstance(event, _Ended):
                self._known.pop(event.number, None)
                self._late.discard(event.number)
                self._measured.pop(event.number, None)
                self._forget(event.number)
                event.forget()

    def _write_record(self, event: _Event) -> None:
        if isinstance(event, _Improved):
            self._book.note_improvement(event.at, event.improvement)
        elif isinstance(event, _Lived):
            self._book.note_history(event.at, event.number, event.epoch, event.records)
        elif isinstance(event, _Measured):
            self._book.note_statistics(event.at, event.statistics)
        elif isinstance(event, _Logged):
            self._book.note_log(event.record)

    def _log(self, record: LogRecord) -> None:
        """Store a log record that was found while events are written, and show it once they are."""
        self._book.note_log(record)
        self._found.append(record)

    def _show(self, record: LogRecord) -> None:
        self._lines.write(record, None if record.job is None else self._name_of(record.job))

    def _name_of(self, number: int) -> str | None:
        if (known := self._known.get(number)) is not None:
            return known.job
        with contextlib.suppress(UnknownJob, StoreFailed):
            return self._store.at(number).job
        return None

    def _write(self, event: _Event) -> JobState | None:
        """Write an event; return the state to publish, if there is one."""
        try:
            match event:
                case _Changed(number, status, nodes, at):
                    return self._write_change(number, status, nodes, at)
                case _Placed(number, placement, _):
                    self._store.note_placing(number, placement)
                case _Improved(number, improvement, _):
                    best = plain(dataclasses.asdict(improvement))
                    self._store.note_best(number, best["fitness"], best)
                case _Ended(number, outcome, _):
                    return self._write_end(number, outcome)
        except (WrongTransition, UnknownJob) as error:  # the other events of this batch must still be written
            self._log(log_record("warning", str(error), event.number))
        return None

    def _write_change(self, number: int, status: str, nodes: tuple[int, ...], at: float) -> JobState | None:
        before = self._store.at(number)
        if before.status in ENDS:  # its deadline has passed; what its nodes do until they stop concerns no client
            return None
        self._known.setdefault(number, before)
        # Each epoch reports its state, which is often the one before; then only the nodes may be new.
        if status != before.status:
            now = self._store.change(number, status, nodes=nodes or None, at=at)
            return None if number in self._late else state_of(now, at)
        if nodes and nodes != before.nodes:
            self._store.note_nodes(number, nodes)
        return None

    def _write_end(self, number: int, outcome: Result | Exception) -> JobState | None:
        """Store the result; the status "deadline", if published already, stays whatever the conductor's outcome is."""
        before = self._store.at(number)
        told = before.status == "deadline"
        if isinstance(outcome, Exception):
            said = str(outcome) if isinstance(outcome, BadInput) else f"{type(outcome).__name__}: {outcome}"
            ended = self._store.end(number, "deadline" if told else "failed", None, message=said)
            self._log(LogRecord("error", "coordinator", f"job failed: {said}", time.time(), job=number))
        else:
            status = "deadline" if told else outcome.status
            result = plain(outcome.to_json()) | {"job": before.job, "status": status, "solved": status == "solved"}
            decided = status in ("optimal", "infeasible")
            why = outcome.oracle if decided and outcome.oracle is not None else outcome.message
            ended = self._store.end(number, status, result, message=why)
        return None if told else state_of(ended)


def state_of(job: Summary, at: float | None = None) -> JobState:
    """Return the message that publishes a job's state; ``at`` is a Unix time, now if None."""
    return JobState(job.job, job.number, job.status, job.fitness, job.message, time.time() if at is None else at)


def _latest(events: list[_Event]) -> list[_Event]:
    """Return the events without the improvements that a later one of the same job replaces."""
    last = {event.number: event for event in events if isinstance(event, _Improved)}
    return [event for event in events if not isinstance(event, _Improved) or last[event.number] is event]


def log_record(level: str, text: str, job: int | None = None) -> LogRecord:
    """Return a line of the coordinator for the log; ``job`` is the number of the job concerned."""
    return LogRecord(level, "coordinator", text, time.time(), job=job)
