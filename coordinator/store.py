"""What must outlive the coordinator: jobs, the changes of their states, their best answers and results, in a database.

What a method has written is safe on disk when it returns, so that a job which was acknowledged after `Store.add`
survives whatever happens to the process.
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
_FIRST_STATES, _LATEST_STATES = 10, 1000  # of a job, that are told
_MOST_EPOCHS = 1000  # of a job, the latest, that are told,
_MOST_TOLD = 1 << 19  # and bytes of what changed with them
_TIDY_EVERY = 100  # epochs of a job
_SMALL_BYTES = 1000  # about, of an ended job: all but its files, answer, result and epochs


class IdTaken(BadInput):
    """Another problem file was submitted under the same id before."""


class UnknownJob(BadInput):
    """There is no such job."""


@dataclass(frozen=True)
class Submission:
    """A job that is to be kept.

    Attributes:
        file: the problem file as JSON.
        digest: of the problem and its run settings: the same for the same job.
        cells: the nodes that it needs, linked as ``topology`` says.
    """

    file: str
    digest: str
    kind: str
    topology: str
    cells: int
    priority: int = 0


@dataclass(frozen=True)
class Summary:
    """A job in a line.

    Attributes:
        job: the id.
        number: its place in the order of coming.
        fitness: of the best verified answer, if there is a finite one.
        submitted: Unix time, seconds; ``started`` and ``ended`` too. A job ends at its deadline for all who wait for
            its answer; it has ``ended`` when its nodes have stopped and its result is here.
        message: why it failed, or what else there is to say.
        nodes: which it has, or had, in the order of its cells.
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
    """A job and its answer.

    Attributes:
        best: the best verified answer, decoded.
        result: as `spy.result.Result.to_json` makes it, once the job has ended.
        epoch: the number of the one that it is in.
    """

    best: dict[str, Any] | None
    result: dict[str, Any] | None
    epoch: int


@dataclass(frozen=True)
class Stored(Answered):
    """All about a job.

    Attributes:
        file: the problem file as JSON, as it was submitted.
        file_now: the same as its world is now.
        wiring: of its nodes' links.
    """

    file: str = field(repr=False)
    file_now: str = field(repr=False)
    wiring: int


class Store:
    """The jobs of one cluster, in the database at ``url``. Any thread may use it.

    Args:
        url: such as ``sqlite:////home/ada/jobs.sqlite`` or ``postgresql://ada@db.example/supernode``.

    Raises:
        StoreFailed: if the database cannot be opened, is of another version, or serves another coordinator.
    """

    def __init__(self, url: str) -> None:
        self._lock = threading.RLock()
        self._session: Session | None = None  # the transaction that is open
        self.bytes_ended = 0  # about, of the jobs that have ended since there was last looked for too many
        self._database = Database(url)
        try:
            with self._database.failing_clearly():
                Base.metadata.create_all(self._database.engine)
            self._check_schema()
            self._next_number = self._greatest_number() + 1
        except BaseException:
            self.close()
            raise

    @property
    def next_number(self) -> int:
        """What the next job will be numbered."""
        return self._next_number

    def close(self) -> None:
        """Let go of the database. Idempotent."""
        self._database.close()

    @contextlib.contextmanager
    def transaction(self) -> Iterator[None]:
        """What is written within is written at once, or not at all; it is safe when this ends.

        Raises:
            StoreFailed: if the database cannot do it.
        """
        with self.writing():
            yield

    # Writing ----------------------------------------------------------------------------------------------------------
    def add(self, new: Submission, job: str | None = None, at: float | None = None) -> tuple[Summary, bool]:
        """Keep a job as queued; or find it, if the same was added before. The second value is whether it is new.

        Args:
            new: the job.
            job: the id of the client's choice; without one, it gets one that is new.
            at: when it was submitted, Unix time.

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
            session.flush()  # before its transitions
            session.add_all(TransitionRow(number=row.number, status=each, at=at) for each in ("submitted", row.status))
            return _summary(row), True

    def withdraw(self, number: int) -> None:
        """Forget a job that was never acknowledged."""
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
        """A job's state changes.

        Args:
            number: of the job.
            status: the new state.
            nodes: that it has now, if that changes too.
            message: what there is to say of it.
            at: Unix time, if not now.

        Raises:
            WrongTransition: if that state cannot follow.
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
        """A job ends, with a result unless something broke. One whose deadline has passed is in that state already.

        Raises:
            WrongTransition: if it has ended before, or this is no end.
        """
        if state_of(status) not in ENDS:
            raise WrongTransition(f"{status!r} is no end")
        with self.writing() as session:
            row = _get(session, number)
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
        """A better answer of a job; ``fitness`` is None if it is not finite."""
        with self.writing() as session:
            row = _get(session, number)
            row.fitness = fitness
            row.best_json = json.dumps(best)

    def note_nodes(self, number: int, nodes: tuple[int, ...]) -> Summary:
        """A job lives on other nodes than before."""
        with self.writing() as session:
            row = _get(session, number)
            row.nodes_json = json.dumps(nodes)
            return _summary(row)

    def note_placing(self, number: int, placement: Placement) -> None:
        """A job is about to begin in an epoch, on these nodes. After an update it has no answer yet."""
        with self.writing() as session:
            row = _get(session, number)
            row.nodes_json = json.dumps(placement.nodes)
            row.wiring = placement.wiring
            row.epoch = placement.epoch
            row.topology = placement.file.run.topology
            row.past_json = placement.past.to_json()
            if placement.epoch > 0:
                row.changed_file = placement.file.to_json()
                if placement.why.get("do") == "update":
                    row.best_json = row.fitness = None
                change = json.dumps(dict(placement.why))
                session.add(EpochRow(number=number, epoch=placement.epoch, at=time.time(), change_json=change))
                session.flush()
                _note_ends(session, number, placement.past)
                if placement.epoch % _TIDY_EVERY == 0:
                    _forget_states(session, number)
                    _put_together(session, number, placement.past)

    def forget_before(self, at: float) -> None:
        """Forget jobs that ended before then, Unix time, and all that was written of them."""
        with self.writing() as session:
            old = select(JobRow.number).where(JobRow.ended < at)
            for table in (ImprovementRow, HistoryRow, StatisticsRow, EpochRow, TransitionRow):
                session.execute(delete(table).where(table.number.in_(old)))
            session.execute(delete(JobRow).where(JobRow.ended < at))

    def forget_beyond(self, size: int) -> None:
        """Forget the jobs that ended first, until the others take at most so many bytes; never the latest."""
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
        """All jobs that have not ended, in the order of coming; also those whose nodes stop, after the deadline."""
        with self.reading() as session:
            draining = and_(JobRow.status == "deadline", JobRow.ended.is_(None))
            found = _whole().where(or_(JobRow.status.not_in(ENDS), draining)).order_by(JobRow.number)
            rows = session.scalars(found)
            return [Stored(**_values(row, Stored)) for row in rows]

    def newest(self, limit: int | None = None) -> list[Summary]:
        """The newest jobs, newest last."""
        with self.reading() as session:
            rows = session.scalars(select(JobRow).order_by(JobRow.number.desc()).limit(limit))
            return [_summary(row) for row in rows][::-1]

    def show(self, job: str) -> Stored:
        """All about a job.

        Raises:
            UnknownJob: if there is none of that id.
        """
        with self.reading() as session:
            return Stored(**_values(_known(_find(session, job, _whole()), job), Stored))

    def answer(self, job: str) -> Answered:
        """A job and its answer.

        Raises:
            UnknownJob: if there is none of that id.
        """
        with self.reading() as session:
            with_answers = select(JobRow).options(undefer(JobRow.best_json), undefer(JobRow.result_json))
            return Answered(**_values(_known(_find(session, job, with_answers), job), Answered))

    def epochs(self, number: int) -> list[dict[str, Any]]:
        """What changed with each epoch of a job after the first, oldest first: a directive as in results, and "at".

        Of very many only the latest.
        """
        told: list[dict[str, Any]] = []
        room = _MOST_TOLD
        with self.reading() as session:
            latest_first = select(EpochRow).where(EpochRow.number == number).order_by(EpochRow.id.desc())
            for row in session.scalars(latest_first.limit(_MOST_EPOCHS).execution_options(yield_per=50)):
                room -= len(row.change_json)
                if told and room < 0:
                    break
                told.append(row.plain)
        return told[::-1]

    def past(self, number: int) -> tuple[Past, dict[str, Any]]:
        """What a job has lived through before its latest epoch, and how that one followed, as a directive."""
        why: dict[str, Any] = {}
        with self.reading() as session:
            written = session.scalar(select(JobRow.past_json).where(JobRow.number == number))
            past = Past() if written is None else Past.from_json(written)
            of_job = select(EpochRow).where(EpochRow.number == number).order_by(EpochRow.id)
            directives = []
            for epoch in session.scalars(of_job.execution_options(yield_per=50)):
                why = json.loads(epoch.change_json)
                if epoch.generation is not None:
                    directives.append(epoch.directive)
        return past.led_on(*directives), why

    def summary(self, job: str) -> Summary:
        """A job in a line.

        Raises:
            UnknownJob: if there is none of that id.
        """
        with self.reading() as session:
            return _summary(_known(_find(session, job), job))

    def at(self, number: int) -> Summary:
        """The job of that number, in a line.

        Raises:
            UnknownJob: if there is none.
        """
        with self.writing() as session:  # so that it knows of what the open transaction has written
            return _summary(_get(session, number))

    def counts(self) -> dict[str, int]:
        """How many jobs there are in each state that any is in."""
        with self.reading() as session:
            rows = session.execute(select(JobRow.status, func.count()).group_by(JobRow.status).order_by(JobRow.status))
            return {row[0]: row[1] for row in rows}

    def transitions(self, number: int) -> list[tuple[str, float]]:
        """The states of a job so far, and when each began (Unix time); of very many the first and the latest."""
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
        """The transaction that is open, or one for this."""
        with self._lock:
            if self._session is not None:
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
        """What has been written, by whomever."""
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
    """When the latest epochs ended that have; of those before it is known."""
    for directive in map(json.loads, past.texts[-2:]):
        if directive["do"] == SEVERAL:
            continue
        epoch = (EpochRow.number == number) & (EpochRow.epoch == directive["epoch"])
        session.execute(update(EpochRow).where(epoch).values(generation=directive["generation"]))


def _forget_states(session: Session, number: int) -> None:
    """Those of a job that are told no more."""
    of_job = select(TransitionRow.id).where(TransitionRow.number == number)
    first = session.scalars(of_job.order_by(TransitionRow.id).limit(_FIRST_STATES)).all()
    latest = session.scalars(of_job.order_by(TransitionRow.id.desc()).limit(_LATEST_STATES)).all()
    between = TransitionRow.id.between(first[-1] + 1, latest[-1] - 1)
    session.execute(delete(TransitionRow).where(TransitionRow.number == number, between))


def _put_together(session: Session, number: int, past: Past) -> None:
    """The directives of a job that its past has put together take one row too."""
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
    elif state == "queued":
        row.started, row.nodes_json = None, "[]"
    elif state in ENDS and state != "deadline":  # then nodes stop first; see `Store.end`
        row.ended = at
    session.add(TransitionRow(number=row.number, status=state, at=at))


def _weigh(session: Session, number: int) -> int:
    """Write down how many bytes are kept of a job that has ended: to read them all anew would take seconds later."""
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
    """Of rows with all that may be large."""
    return select(JobRow).options(undefer("*"))


def _taken(job: str, there: list[Any], new: list[Any]) -> str:
    """Why a problem file as JSON (its name, fields, settings, folder) is not the one of that id."""
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
    """``message`` without what a database cannot keep."""
    return message.replace("\0", "\\0").encode("utf-8", "replace").decode("utf-8")
