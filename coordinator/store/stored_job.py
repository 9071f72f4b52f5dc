"""A job as the store has it: what is given to the store, what it returns, and how a job's row is found."""

from dataclasses import dataclass, field, fields
from typing import Any

from sqlalchemy import Select, select
from sqlalchemy.orm import Session, undefer

from coordinator.jobs.states import State, state_of
from coordinator.store.tables import JobRow
from problems.errors import BadInput
from wire.keys import ANYONE


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
        priority: of one client's jobs, those of a higher priority start earlier.
        client: the name of the client that submits it.
    """

    file: str
    digest: str
    kind: str
    topology: str
    cells: int
    priority: int = 0
    client: str = ANYONE


@dataclass(frozen=True)
class Summary:
    """The short description of a job.

    Attributes:
        job: the job's id, unique within the cluster.
        number: the job's number; jobs are numbered in the order of their submission.
        client: the name of the client that submitted it.
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
    client: str
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
        is_cancelled: whether a client has been told that it will be cancelled.
    """

    file: str = field(repr=False)
    file_now: str = field(repr=False)
    wiring: int
    is_cancelled: bool


def row_of(session: Session, number: int) -> JobRow:
    """Return the row of the job of that number.

    Raises:
        UnknownJob: if there is no such job.
    """
    row = session.get(JobRow, number)
    if row is None:
        raise UnknownJob(f"there is no job of number {number}")
    return row


def find_row(session: Session, job: str, query: Select[JobRow] | None = None) -> JobRow | None:
    """Return the row of the job of that id, by a ``query`` that says which columns to read; None if there is none."""
    query = select(JobRow) if query is None else query
    return session.scalar(query.where(JobRow.job == job))


def known_row(session: Session, job: str, query: Select[JobRow] | None = None) -> JobRow:
    """Return the row of the job of that id; see `find_row`.

    Raises:
        UnknownJob: if there is no such job.
    """
    row = find_row(session, job, query)
    if row is None:
        raise UnknownJob(f"there is no job {job!r}")
    return row


def whole_rows() -> Select[JobRow]:
    """Return a query that reads the large columns too, which are deferred otherwise."""
    return select(JobRow).options(undefer("*"))


def summary_of(row: JobRow) -> Summary:
    """Return the short description of the job in a row."""
    return Summary(**values_of(row, Summary))


def values_of(row: JobRow, kind: type[Summary]) -> dict[str, Any]:
    """Return the fields of a ``kind`` of description, by name, of the job in a row."""
    values = {each.name: getattr(row, each.name) for each in fields(kind)}
    return values | {"status": state_of(row.status)}
