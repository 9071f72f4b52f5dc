"""Store what must survive the coordinator in a database: jobs, their state changes, best answers and results.

What a method writes is safe on disk when the method returns (within `Store.transaction`: when that ends). So a job that
is acknowledged after `Store.add` survives whatever happens to the process.
"""

import contextlib
import json
import secrets
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any

from sqlalchemy import Select, and_, delete, func, literal, or_, select, update
from sqlalchemy.orm import Session, undefer

from coordinator.database import Database, StoreFailed
from coordinator.job import Placement
from coordinator.states import ENDS, LIVING, State, WrongTransition, follow, state_of
from coordinator.tables import (
    Base,
    EpochRow,
    HistoryRow,
    ImprovementRow,
    JobRow,
    MetaRow,
    StatisticsRow,
    TransitionRow,
)
from problems.errors import BadInput
from spy.past import SEVERAL, Past

_SCHEMA = 4
_NEW_ID_BYTES = 4
# A job that is kept alive may have any number of epochs and states. These bounds keep answers, and the database, small.
_FIRST_STATES, _LATEST_STATES = 10, 1000  # state changes of a job that `Store.transitions` returns
_MOST_EPOCHS = 1000  # epochs of a job that `Store.epochs` returns, the latest,
_MOST_DIRECTIVE_BYTES = 1 << 19  # and the bytes of their directives
_TIDY_EVERY = 100  # epochs of a job between two clean-ups of its rows
_SMALL_BYTES = 1000  # estimated size of an ended job without its files, answer, result and epochs


class IdTaken(BadInput):
    """Another problem, or the same with other settings, was submitted under the same id before."""


class UnknownJob(BadInput):
    """There is no job of that id or number."""


@dataclass(frozen=True)
class Submission:
    """A job to be stored.

    Attributes:
        file: the problem file as JSON.
        digest: a digest of the problem and its run settings; equal for equal jobs.
        kind: the kind of the problem.
        topology: the topology of the job's cells.
        cells: the number of cells, which is the number of nodes that the job needs.
        priority: jobs of a higher priority start earlier.
    """

    file: str
    digest: str
    kind: str
    topology: str
    cells: int
    priority: int = 0


@dataclass(frozen=True)
class Summary:
    """The short description of a job.

    Attributes:
        job: the job's id, unique within the cluster.
        number: the job's number; jobs are numbered in the order of their submission.
        fitness: the fitness of the best verified answer; None if there is none, or it is not finite.
        submitted, started, ended: Unix times in seconds. At its deadline a job gets the status "deadline" at once, but
            ``ended`` only when its nodes have stopped and its result is stored.
        message: why the job failed, or another remark on its end.
        nodes: the nodes that it has, or had, in the order of its cells.
    """

    job: str
    number: int
    kind: str
    topology: str
    cells: int
    priority: int
    status: State
    fitness: float | None
    submitted: float
    started: float | None
    ended: float | None
    message: str | None
    nodes: tuple[int, ...]


@dataclass(frozen=True)
class Answered(Summary):
    """A job with its best answer and its result.

    Attributes:
        best: the best verified answer, decoded.
        result: the result as `spy.result.Result.to_json` returns it; None until the job has ended.
        epoch: the number of its latest epoch.
    """

    best: dict[str, Any] | None
    result: dict[str, Any] | None
    epoch: int


@dataclass(frozen=True)
class Stored(Answered):
    """Everything that the store knows of a job, except its epochs and states.

    Attributes:
        file: the problem file as it was submitted, as JSON.
        file_now: the problem file of the latest epoch, as JSON.
        wiring: the number of its nodes' links, see `wire.control.Wiring`.
    """

    file: str = field(repr=False)
    file_now: str = field(repr=False)
    wiring: int


class Store:
    """The jobs of one cluster, in a database. Any thread may use it.

    Writers take turns by a lock, since they share the open transaction; readers have sessions of their own and see only
    what is committed.

    Args:
        url: such as ``sqlite:////home/ada/jobs.sqlite`` or ``postgresql://ada@db.example/supernode``.

    Attributes:
        bytes_ended: about how many bytes the jobs take that have ended since the last `forget_beyond`.

    Raises:
        StoreFailed: if the database cannot be opened, is of another version, or serves another coordinator.
    """

    def __init__(self, url: str) -> None:
        self._lock = threading.RLock()  # re-entrant: methods write within `transaction`
        self._session: Session | None = None  # the open transaction; only the thread that holds the lock touches it
        self.bytes_ended = 0
        self._database = Database(url)
        try:
            with self._database.failing_clearly():
                Base.metadata.create_all(self._database.engine)
            self._check_schema()
            # Counted in memory, so that the number of a withdrawn job is not given again. This is safe: the database is
            # claimed by this process, so no other coordinator gives numbers.
            self._next_number = self._greatest_number() + 1
        except BaseException:
            self.close()
            raise

    @property
    def next_number(self) -> int:
        """The number of the next job."""
        return self._next_number

    def close(self) -> None:
        """Close the database, so that another coordinator may open it. Idempotent."""
        self._database.close()

    @contextlib.contextmanager
    def transaction(self) -> Iterator[None]:
        """Commit everything that is written within together, or nothing of it; it is on disk when this ends.

        Raises:
            StoreFailed: if the database fails.
        """
        with self.writing():
            yield

    # Writing ----------------------------------------------------------------------------------------------------------
    def add(self, new: Submission, job: str | None = None, at: float | None = None) -> tuple[Summary, bool]:
        """Store a new job as queued; if the same was added under the same id before, return that one.

        So a client that got no answer may submit again under the same id without creating a second job.

        Args:
            new: the job.
            job: the id that the client chose; if None, a new one is made.
            at: when the job was submitted, Unix time; now if None.

        Returns:
            The job, and whether it is new.

        Raises:
            IdTaken: if another job has that id.
        """
        with self.writing() as session:
            if job is not None and (there := _find(session, job)) is not None:
                if there.digest != new.digest:
                    raise IdTaken(_taken(job, json.loads(there.file), json.loads(new.file)))
                return _summary(there), False
            at = time.time() if at is None else at
            row = JobRow(
                **vars(new),
                number=self._next_number,
                job=_new_id(session) if job is None else job,
                status=follow("submitted", "queued"),
                submitted=at,
                nodes_json="[]",
            )
            self._next_number += 1
            session.add(row)
            session.flush()  # the job's row must be there before transitions refer to it
            session.add_all(TransitionRow(number=row.number, status=each, at=at) for each in ("submitted", row.status))
            return _summary(row), True

    def withdraw(self, number: int) -> None:
        """Delete a job that was never acknowledged to its client."""
        with self.writing() as session:
            session.execute(delete(EpochRow).where(EpochRow.number == number))
            session.execute(delete(TransitionRow).where(TransitionRow.number == number))
            session.execute(delete(JobRow).where(JobRow.number == number))

    def change(
        self,
        number: int,
        status: str,
        *,
        nodes: tuple[int, ...] | None = None,
        message: str | None = None,
        at: float | None = None,
    ) -> Summary:
        """Change a job's state and return the job.

        Args:
            number: the job's number.
            status: the new state.
            nodes: the nodes that the job has now; None if they stay the same.
            message: a remark on the change; None keeps the old one.
            at: when it happened, Unix time; now if None.

        Raises:
            WrongTransition: if the new state cannot follow the present one.
            UnknownJob: if there is no such job.
        """
        with self.writing() as session:
            row = _get(session, number)
            _change(session, row, status, time.time() if at is None else at)
            if nodes is not None:
                row.nodes_json = json.dumps(nodes)
            if message is not None:
                row.message = storable(message)
            return _summary(row)

    def end(self, number: int, status: str, result: dict[str, Any] | None, *, message: str | None = None) -> Summary:
        """End a job and return it.

        Args:
            number: the job's number.
            status: the final state. A job whose deadline has passed is in the state "deadline" already.
            result: the result as JSON; None if something broke.
            message: why the job failed, or another remark.

        Raises:
            WrongTransition: if the job has ended before, or the state is not final.
            UnknownJob: if there is no such job.
        """
        if state_of(status) not in ENDS:
            raise WrongTransition(f"expected a final state, found {status!r}")
        with self.writing() as session:
            row = _get(session, number)
            # At its deadline the job got this state already; now its nodes have stopped too.
            if not (status == row.status == "deadline" and row.ended is None):
                self.change(number, status)
            row.ended = row.ended or time.time()
            if message is not None:
                row.message = storable(message)
            if result is not None:
                row.result_json = json.dumps(result)
                row.fitness = result.get("fitness", row.fitness)
            session.flush()
            self.bytes_ended += _weigh(session, number)
            return _summary(row)

    def note_best(self, number: int, fitness: float | None, best: dict[str, Any]) -> None:
        """Store a better answer of a job; ``fitness`` is None if it is not finite."""
        with self.writing() as session:
            row = _get(session, number)
            row.fitness = fitness
            row.best_json = json.dumps(best)

    def note_nodes(self, number: int, nodes: tuple[int, ...]) -> Summary:
        """Store the nodes of a job, which have changed."""
        with self.writing() as session:
            row = _get(session, number)
            row.nodes_json = json.dumps(nodes)
            return _summary(row)

    def note_placing(self, number: int, placement: Placement) -> None:
        """Store that a job is about to begin an epoch, with everything that a coordinator needs to take over there.

        After an update the stored answer is removed: it solves another problem.
        """
        with self.writing() as session:
            row = _get(session, number)
            row.nodes_json = json.dumps(placement.nodes)
            row.wiring = placement.wiring
            row.epoch = placement.epoch
            row.topology = placement.file.run.topology
            row.past_json = placement.past.to_json()
            if placement.epoch > 0:  # the first epoch follows no directive, and its file is that of the submission
                row.changed_file = placement.file.to_json()
                if placement.why.get("do") == "update":
                    row.best_json = row.fitness = None
                change = json.dumps(dict(placement.why))
                session.add(EpochRow(number=number, epoch=placement.epoch, at=time.time(), change_json=change))
                session.flush()
                _note_ends(session, number, placement.past)
                if placement.epoch % _TIDY_EVERY == 0:
                    _forget_states(session, number)
                    _merge_oldest_epochs(session, number, placement.past)

    def forget_before(self, at: float) -> None:
        """Delete the jobs that ended before ``at`` (Unix time), with all their records."""
        with self.writing() as session:
            old = select(JobRow.number).where(JobRow.ended < at)
            for table in (ImprovementRow, HistoryRow, StatisticsRow, EpochRow, TransitionRow):
                session.execute(delete(table).where(table.number.in_(old)))
            session.execute(delete(JobRow).where(JobRow.ended < at))

    def forget_beyond(self, size: int) -> None:
        """Delete the jobs that ended first until the other ended jobs take at most ``size`` bytes; keep the latest."""
        self.bytes_ended = 0
        ended = select(JobRow.ended, JobRow.bytes).where(JobRow.ended.is_not(None)).subquery()
        with self.writing() as session:
            total, latest = session.execute(select(func.sum(ended.c.bytes), func.max(ended.c.ended))).one()
            if total is None or total <= size:
                return
            with_later = func.sum(ended.c.bytes).over(order_by=ended.c.ended.desc()).label("with_later")
            sums = select(ended.c.ended, with_later).subquery()
            first_kept = session.scalar(select(func.min(sums.c.ended)).where(sums.c.with_later <= size))
            self.forget_before(latest if first_kept is None else first_kept)

    # Reading ----------------------------------------------------------------------------------------------------------
    def unended(self) -> list[Stored]:
        """Return all jobs without an end, by number; jobs past their deadline whose nodes still stop are included."""
        with self.reading() as session:
            draining = and_(JobRow.status == "deadline", JobRow.ended.is_(None))
            found = _whole().where(or_(JobRow.status.not_in(ENDS), draining)).order_by(JobRow.number)
            rows = session.scalars(found)
            return [Stored(**_values(row, Stored)) for row in rows]

    def newest(self, limit: int | None = None) -> list[Summary]:
        """Return the newest jobs, at most ``limit``, the newest last."""
        with self.reading() as session:
            rows = session.scalars(select(JobRow).order_by(JobRow.number.desc()).limit(limit))
            return [_summary(row) for row in rows][::-1]

    def show(self, job: str) -> Stored:
        """Return a job with its problem files, answer and result.

        Raises:
            UnknownJob: if there is no job of that id.
        """
        with self.reading() as session:
            return Stored(**_values(_known(_find(session, job, _whole()), job), Stored))

    def answer(self, job: str) -> Answered:
        """Return a job with its answer and result.

        Raises:
            UnknownJob: if there is no job of that id.
        """
        with self.reading() as session:
            with_answers = select(JobRow).options(undefer(JobRow.best_json), undefer(JobRow.result_json))
            return Answered(**_values(_known(_find(session, job, with_answers), job), Answered))

    def epochs(self, number: int) -> list[dict[str, Any]]:
        """Return the directive of each epoch of a job after the first, oldest first, as in results, with its time "at".

        If there are very many, only the latest are returned.
        """
        told: list[dict[str, Any]] = []
        room = _MOST_DIRECTIVE_BYTES
        with self.reading() as session:
            latest_first = select(EpochRow).where(EpochRow.number == number).order_by(EpochRow.id.desc())
            for row in session.scalars(latest_first.limit(_MOST_EPOCHS).execution_options(yield_per=50)):
                room -= len(row.change_json)
                if told and room < 0:
                    break
                told.append(row.plain)
        return told[::-1]

    def past(self, number: int) -> tuple[Past, dict[str, Any]]:
        """Return the sum of a job's epochs before its latest one, and the latest one's directive.

        The sum lacks the epoch just before the latest if that had not ended when the latest was stored.
        """
        why: dict[str, Any] = {}
        with self.reading() as session:
            written = session.scalar(select(JobRow.past_json).where(JobRow.number == number))
            past = Past() if written is None else Past.from_json(written)
            of_job = select(EpochRow).where(EpochRow.number == number).order_by(EpochRow.id)
            directives = []
            for epoch in session.scalars(of_job.execution_options(yield_per=50)):
                why = json.loads(epoch.change_json)
                if epoch.generation is not None:  # else the epoch before it is not in the sum either
                    directives.append(epoch.directive)
        return past.led_on(*directives), why

    def summary(self, job: str) -> Summary:
        """Return the short description of a job.

        Raises:
            UnknownJob: if there is no job of that id.
        """
        with self.reading() as session:
            return _summary(_known(_find(session, job), job))

    def at(self, number: int) -> Summary:
        """Return the short description of the job of that number.

        Raises:
            UnknownJob: if there is no such job.
        """
        with self.writing() as session:  # a reading session would not see what the open transaction has written
            return _summary(_get(session, number))

    def counts(self) -> dict[str, int]:
        """Return the number of jobs in each state; states without jobs are left out."""
        with self.reading() as session:
            rows = session.execute(select(JobRow.status, func.count()).group_by(JobRow.status).order_by(JobRow.status))
            return {row[0]: row[1] for row in rows}

    def transitions(self, number: int) -> list[tuple[str, float]]:
        """Return the states of a job so far with their times (Unix); of very many only the first and the latest."""
        with self.reading() as session:
            columns = TransitionRow.id, TransitionRow.status, TransitionRow.at
            found = select(*columns).where(TransitionRow.number == number)
            first = session.execute(found.order_by(TransitionRow.id).limit(_FIRST_STATES))
            latest = session.execute(found.order_by(TransitionRow.id.desc()).limit(_LATEST_STATES))
            rows = {row.id: (row.status, row.at) for row in (*first, *latest)}
        return [rows[number] for number in sorted(rows)]

    # The database -----------------------------------------------------------------------------------------------------
    @contextlib.contextmanager
    def writing(self) -> Iterator[Session]:
        """Return the open transaction, or one of its own that is committed at the end.

        Raises:
            StoreFailed: if the database fails.
        """
        with self._lock:
            if self._session is not None:  # within `transaction`, which commits
                yield self._session
                return
            fresh = self._new_session(expire_on_commit=False)
            with self._database.failing_clearly(), fresh as session, session.begin():
                self._session = session
                try:
                    yield session
                finally:
                    self._session = None

    @contextlib.contextmanager
    def reading(self) -> Iterator[Session]:
        """Return a session that reads what is committed.

        Raises:
            StoreFailed: if the database fails.
        """
        with self._database.failing_clearly(), self._new_session() as session:
            yield session

    def _new_session(self, **options: Any) -> Session:
        return Session(self._database.engine, **options)

    def _greatest_number(self) -> int:
        with self.reading() as session:
            return session.scalar(select(func.max(JobRow.number))) or 0

    def _check_schema(self) -> None:
        with self.writing() as session:
            found = session.scalar(select(func.max(MetaRow.schema)))
            if found is None:
                session.add(MetaRow(schema=_SCHEMA))
            elif found != _SCHEMA:
                raise StoreFailed(f"store {self._database.name}: expected a store of version {_SCHEMA}, found {found}")


def _note_ends(session: Session, number: int, past: Past) -> None:
    """Store after which generation the latest epochs ended; of earlier ones it is stored already.

    Between two placements at most two epochs come to an end, so the last two directives are enough.
    """
    for directive in map(json.loads, past.texts[-2:]):
        if directive["do"] == SEVERAL:
            continue
        epoch = (EpochRow.number == number) & (EpochRow.epoch == directive["epoch"])
        session.execute(update(EpochRow).where(epoch).values(generation=directive["generation"]))


def _forget_states(session: Session, number: int) -> None:
    """Delete the state changes of a job that `Store.transitions` no longer returns."""
    of_job = select(TransitionRow.id).where(TransitionRow.number == number)
    first = session.scalars(of_job.order_by(TransitionRow.id).limit(_FIRST_STATES)).all()
    latest = session.scalars(of_job.order_by(TransitionRow.id.desc()).limit(_LATEST_STATES)).all()
    between = TransitionRow.id.between(first[-1] + 1, latest[-1] - 1)
    session.execute(delete(TransitionRow).where(TransitionRow.number == number, between))


def _merge_oldest_epochs(session: Session, number: int, past: Past) -> None:
    """Merge the rows of a job's oldest epochs as its past has merged their directives (see `spy.past.SEVERAL`)."""
    together = json.loads(past.texts[0]) if past.texts else {"do": None}
    if together["do"] != SEVERAL:
        return
    rows = (EpochRow.number == number, EpochRow.epoch <= together["epoch"])
    last = session.scalar(select(EpochRow).where(*rows).order_by(EpochRow.epoch.desc()).limit(1))
    if last is not None and json.loads(last.change_json)["do"] != SEVERAL:
        session.execute(delete(EpochRow).where(*rows, EpochRow.id != last.id))
        last.generation = together.pop("generation")
        last.change_json = json.dumps(together)


def _change(session: Session, row: JobRow, status: str, at: float) -> None:
    state = follow(state_of(row.status), status)
    row.status = state
    if state in LIVING and row.started is None:
        row.started = at
    elif state == "queued":  # the job has lost its nodes and starts over
        row.started, row.nodes_json = None, "[]"
    elif state in ENDS and state != "deadline":  # after a deadline the nodes must stop first, see `Store.end`
        row.ended = at
    session.add(TransitionRow(number=row.number, status=state, at=at))


def _weigh(session: Session, number: int) -> int:
    """Store and return the size in bytes of a job that has ended: to add up all texts later would take seconds."""
    epochs = select(func.sum(func.length(EpochRow.change_json))).where(EpochRow.number == number).scalar_subquery()
    texts = JobRow.file, JobRow.changed_file, JobRow.best_json, JobRow.result_json, JobRow.past_json
    lengths = [func.coalesce(each, 0) for each in (epochs, *map(func.length, texts))]
    this, unseen = JobRow.number == number, {"synchronize_session": False}
    session.execute(
        update(JobRow).where(this).values(bytes=sum(lengths, literal(_SMALL_BYTES))), execution_options=unseen
    )
    return session.scalar(select(JobRow.bytes).where(this)) or 0


def _get(session: Session, number: int) -> JobRow:
    row = session.get(JobRow, number)
    if row is None:
        raise UnknownJob(f"there is no job of number {number}")
    return row


def _find(session: Session, job: str, query: Select[JobRow] | None = None) -> JobRow | None:
    query = select(JobRow) if query is None else query
    return session.scalar(query.where(JobRow.job == job))


def _whole() -> Select[JobRow]:
    """Return a query that reads the large columns too, which are deferred otherwise."""
    return select(JobRow).options(undefer("*"))


def _taken(job: str, there: list[Any], new: list[Any]) -> str:
    """Return the message that the id of a job is taken; the two files are lists of name, fields, settings, folder."""
    if there[1] != new[1]:
        return f"another problem file was submitted as job {job!r} before"
    before, now = there[2], new[2]
    names = sorted(name for name in {*before, *now} if before.get(name) != now.get(name))
    changed = ", ".join(f"{name} {before.get(name, 'not given')}, now {now.get(name, 'not given')}" for name in names)
    return f"this problem was submitted as job {job!r} before with other settings ({changed}); give it another id"


def _new_id(session: Session) -> str:
    while _find(session, job := secrets.token_hex(_NEW_ID_BYTES)) is not None:
        pass
    return job


def _known(row: JobRow | None, job: str) -> JobRow:
    if row is None:
        raise UnknownJob(f"there is no job {job!r}")
    return row


def _summary(row: JobRow) -> Summary:
    return Summary(**_values(row, Summary))


def _values(row: JobRow, kind: type[Summary]) -> dict[str, Any]:
    values = {each.name: getattr(row, each.name) for each in fields(kind)}
    return values | {"status": state_of(row.status)}


def storable(message: str) -> str:
    """Return ``message`` without characters that a database cannot store: NUL (PostgreSQL) and lone surrogates."""
    return message.replace("\0", "\\0").encode("utf-8", "replace").decode("utf-8")
