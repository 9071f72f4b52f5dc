"""Writes down what the dispatcher tells, and then publishes it: nobody hears of an end that a restart could take back.

The dispatcher does not wait for the disk: a thread of the recorder's own writes whatever has come in one transaction.
While the database is away it waits, and tries again.
"""

import contextlib
import dataclasses
import math
import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from coordinator.database import StoreFailed
from coordinator.job import Placement
from coordinator.log_lines import LogLines
from coordinator.record_book import RecordBook
from coordinator.states import ENDS, WrongTransition
from coordinator.store import Store, Summary, UnknownJob
from problems.errors import BadInput
from spy.improvement_records import ImprovementRecord
from spy.result import Result
from wire.jobs import JobState
from wire.news import Improvement, LogRecord, Statistics
from wire.plain import plain

_TRY_AGAIN = 0.5  # seconds
_PATIENCE = 5.0  # seconds
_SAMPLE_EVERY = 0.75  # seconds, of the spy's half seconds: every other one
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
    """The dispatcher's hooks.

    Args:
        store: where it is written.
        book: where is written how it went.
        lines: of the log.
        publish: called with each change of a state, once it is written.
        forget: called with the number of each job that has ended.
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
        self._measured: dict[int, float] = {}  # by job: when it was last written down how it is
        self._unwritten: dict[int, _Measured] = {}  # by job: how it has been since
        self._publish = publish
        self._forget = forget
        self._events: queue.SimpleQueue[_Event | None] = queue.SimpleQueue()
        self._known: dict[int, Summary] = {}  # what is published of jobs that have not ended
        self._late: set[int] = set()  # jobs whose deadline was told
        self._closing = threading.Event()
        self._write_lock = threading.Lock()
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Nothing is written or published meanwhile, so that a job's first news can come before what follows."""
        with self._write_lock:
            yield

    def changed(self, number: int, status: str, nodes: tuple[int, ...]) -> None:
        """A job's state, or its nodes."""
        at = time.time()
        if status == "deadline" and (job := self._known.get(number)) is not None:
            # Nobody waits for the disk then; who takes over finds that the deadline has passed, and says the same.
            self._late.add(number)
            self._publish(dataclasses.replace(state_of(job, at), status=status))
        self._events.put(_Changed(number, status, nodes, at))

    def placed(self, number: int, placement: Placement) -> None:
        """A job is about to begin in an epoch: return once that is written, or the database is away for long."""
        job = self._known.get(number)
        if job is not None and placement.why.get("do") == "update":
            self._known[number] = dataclasses.replace(job, fitness=None)
        written = threading.Event()
        self._events.put(_Placed(number, placement, written))
        written.wait(_PATIENCE)

    def improved(self, number: int, improvement: Improvement) -> None:
        """A better answer."""
        job = self._known.get(number)
        if job is not None and math.isfinite(improvement.fitness):
            self._known[number] = dataclasses.replace(job, fitness=improvement.fitness)
        self._events.put(_Improved(number, improvement, time.time()))

    def lived(self, number: int, epoch: int, records: Sequence[ImprovementRecord]) -> None:
        """An epoch has ended, in which there were these improvements."""
        self._events.put(_Lived(number, epoch, records, time.time()))

    def measured(self, statistics: Statistics) -> None:
        """How a job is; once a second is enough, and how it was at its end."""
        at = time.time()
        if at - self._measured.get(statistics.job, 0.0) >= _SAMPLE_EVERY:
            self._measured[statistics.job] = at
            self._unwritten.pop(statistics.job, None)
            self._events.put(_Measured(statistics.job, statistics, at))
        else:
            self._unwritten[statistics.job] = _Measured(statistics.job, statistics, at)

    def logged(self, record: LogRecord) -> None:
        """A process has something to say: it is written down, and shown."""
        self._events.put(_Logged(record.job, record))

    def ended(self, number: int, outcome: Result | Exception) -> None:
        """The end of a job."""
        if (last := self._unwritten.pop(number, None)) is not None:
            self._events.put(last)
        self._events.put(_Ended(number, outcome))

    def close(self) -> None:
        """Write what has come so far, and stop. Idempotent."""
        self._closing.set()
        self._events.put(None)
        self._thread.join()

    def _work(self) -> None:
        while events := self._batch():
            self._settle(events)

    def _batch(self) -> list[_Event]:
        """What has come, at least one; nothing at the end."""
        events: list[_Event] = []
        with contextlib.suppress(queue.Empty):
            event = self._events.get()
            while event is not None and len(events) < _MOST_AT_ONCE:
                events.append(event)
                event = self._events.get_nowait()
            self._events.put(event)
        return events

    def _settle(self, events: list[_Event]) -> None:
        """Write and publish these, however long it takes; if something is wrong with one, all but that one."""
        away = False
        while True:
            try:
                return self._commit(events)
            except StoreFailed as error:
                if not away:
                    self._lines.write(warning(str(error)))
                if not error.passing:
                    return self._settle_one_by_one(events, error)
                away = True
            if self._closing.wait(_TRY_AGAIN):
                return None

    def _settle_one_by_one(self, events: list[_Event], error: StoreFailed) -> None:
        """What cannot be written is left out, but for an end: somebody waits for that, if only without a result."""
        if len(events) > 1:
            for event in events:
                self._settle([event])
        elif isinstance(event := events[0], _Ended) and not isinstance(event.outcome, StoreFailed):
            self._settle([_Ended(event.number, error)])

    def _commit(self, events: list[_Event]) -> None:
        with self._write_lock:
            with self._store.transaction():
                for event in events:
                    self._write_record(event)
                states = [self._write(event) for event in _latest(events)]
                self._book.forget_the_old(time.time())
            for state in states:
                if state is not None:
                    self._publish(state)
        for event in events:
            if isinstance(event, _Ended):
                self._known.pop(event.number, None)
                self._late.discard(event.number)
                self._measured.pop(event.number, None)
                self._forget(event.number)
            elif isinstance(event, _Placed):
                event.written.set()

    def _write_record(self, event: _Event) -> None:
        if isinstance(event, _Improved):
            self._book.note_improvement(event.at, event.improvement)
        elif isinstance(event, _Lived):
            self._book.note_history(event.at, event.number, event.epoch, event.records)
        elif isinstance(event, _Measured):
            self._book.note_statistics(event.at, event.statistics)
        elif isinstance(event, _Logged):
            self._log(event.record)

    def _log(self, record: LogRecord) -> None:
        """Show it, and write it down; shown again if that has to be done again."""
        self._lines.write(record, None if record.job is None else self._name_of(record.job))
        self._book.note_log(record)

    def _name_of(self, number: int) -> str | None:
        with contextlib.suppress(UnknownJob):
            return self._store.at(number).job
        return None

    def _write(self, event: _Event) -> JobState | None:
        """Write one down; what there is to publish."""
        try:
            match event:
                case _Changed(number, status, nodes, at):
                    return self._write_change(number, status, nodes, at)
                case _Placed(number, placement, _):
                    self._store.note_placing(number, placement)
                case _Improved(number, improvement, _):
                    best = plain(dataclasses.asdict(improvement))
                    self._store.note_best(number, best["fitness"], best)
                case _Ended(number, outcome):
                    return self._write_end(number, outcome)
        except (WrongTransition, UnknownJob) as error:
            self._log(warning(str(error), event.number))
        return None

    def _write_change(self, number: int, status: str, nodes: tuple[int, ...], at: float) -> JobState | None:
        before = self._store.at(number)
        if before.status in ENDS:  # its deadline has passed; what its nodes do until they stop is nobody's business
            return None
        self._known.setdefault(number, before)
        if status != before.status:
            now = self._store.change(number, status, nodes=nodes or None, at=at)
            return None if number in self._late else state_of(now, at)
        if nodes and nodes != before.nodes:
            self._store.note_nodes(number, nodes)
        return None

    def _write_end(self, number: int, outcome: Result | Exception) -> JobState | None:
        """What was published at the deadline stays; the result comes later."""
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
    """What is published of a job that has come to another state."""
    return JobState(job.job, job.number, job.status, job.fitness, job.message, time.time() if at is None else at)


def _latest(events: list[_Event]) -> list[_Event]:
    """Without the improvements that a later one in the same batch replaces."""
    last = {event.number: event for event in events if isinstance(event, _Improved)}
    return [event for event in events if not isinstance(event, _Improved) or last[event.number] is event]


def warning(text: str, job: int | None = None) -> LogRecord:
    """What the coordinator has to say of something that went wrong."""
    return LogRecord("warning", "coordinator", text, time.time(), job=job)
