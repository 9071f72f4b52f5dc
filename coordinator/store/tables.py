"""The tables of the store's database, as SQLAlchemy classes.

A change here needs a new version number: see `coordinator.store.sessions`. A further table does not: it is made in an
older database when that is opened.
"""

import json
from typing import Any

from sqlalchemy import BigInteger, Double, ForeignKey, Index, LargeBinary, String, Text
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column


class Base(DeclarativeBase):
    """The base class of all tables."""


class MetaRow(Base):
    """The version of the store's schema: one row."""

    __tablename__ = "meta"

    schema: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)


class JobRow(Base):
    """A job; see `coordinator.store.stored_job` for most columns.

    Attributes:
        is_cancelled: whether a client has been told that the job will be cancelled.
        bytes: about how many bytes an ended job takes, without its records.
        file: the problem file as it was submitted, as JSON.
        changed_file: the problem file of the latest epoch; None for a job in its first epoch.
        past_json: the sum of the earlier epochs (`spy.past.Past`), without their directives.
    """

    __tablename__ = "jobs"
    __table_args__ = (Index("size_of_ended", "ended", "bytes"),)

    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    job: Mapped[str] = mapped_column("id", String(64), unique=True)
    digest: Mapped[str] = mapped_column(String(64))
    kind: Mapped[str] = mapped_column(Text)
    topology: Mapped[str] = mapped_column(Text)
    cells: Mapped[int]
    priority: Mapped[int]
    client: Mapped[str] = mapped_column(String(64))
    status: Mapped[str] = mapped_column(String(16), index=True)
    fitness: Mapped[float | None] = mapped_column(Double)
    submitted: Mapped[float] = mapped_column(Double)
    started: Mapped[float | None] = mapped_column(Double)
    ended: Mapped[float | None] = mapped_column(Double)
    bytes: Mapped[int] = mapped_column(BigInteger, default=0)
    is_cancelled: Mapped[bool] = mapped_column(default=False)
    message: Mapped[str | None] = mapped_column(Text)
    nodes_json: Mapped[str] = mapped_column("nodes", Text, default="[]")
    wiring: Mapped[int] = mapped_column(BigInteger, default=0)
    epoch: Mapped[int] = mapped_column(default=0)
    # Large columns are deferred: they are read only by queries that ask for them.
    file: Mapped[str] = mapped_column(Text, deferred=True)
    changed_file: Mapped[str | None] = mapped_column(Text, deferred=True)
    best_json: Mapped[str | None] = mapped_column("best", Text, deferred=True)
    result_json: Mapped[str | None] = mapped_column("result", Text, deferred=True)
    past_json: Mapped[str | None] = mapped_column("past", Text, deferred=True)

    @property
    def nodes(self) -> tuple[int, ...]:
        """The job's nodes, in the order of its cells."""
        return tuple(json.loads(self.nodes_json))

    @property
    def file_now(self) -> str:
        """The problem file of the latest epoch, as JSON."""
        return self.file if self.changed_file is None else self.changed_file

    @property
    def best(self) -> dict[str, Any] | None:
        """The best verified answer; None if there is none."""
        return _maybe_json(self.best_json)

    @property
    def result(self) -> dict[str, Any] | None:
        """The result; None until the job has ended."""
        return _maybe_json(self.result_json)


class TransitionRow(Base):
    """A change of a job's state."""

    __tablename__ = "transitions"

    id: Mapped[int] = mapped_column(primary_key=True)
    number: Mapped[int] = mapped_column(ForeignKey("jobs.number"), index=True)
    status: Mapped[str] = mapped_column(String(16))
    at: Mapped[float] = mapped_column(Double)


class CheckpointRow(Base):
    """A checkpoint of a job that has not ended, as `coordinator.jobs.checkpoint.Checkpoint.encode` returns it."""

    __tablename__ = "checkpoints"

    id: Mapped[int] = mapped_column(primary_key=True)
    number: Mapped[int] = mapped_column(ForeignKey("jobs.number"), index=True)
    data: Mapped[bytes] = mapped_column(LargeBinary)


class HostRow(Base):
    """A host of nodes, as `wire.hosts.Host.encode` returns it; ``given_up`` if only its numbers are kept."""

    __tablename__ = "hosts"

    id: Mapped[int] = mapped_column(primary_key=True)
    data: Mapped[bytes] = mapped_column(LargeBinary)
    given_up: Mapped[bool]


class EpochRow(Base):
    """An epoch of a job after its first.

    Attributes:
        at: when it began, Unix time.
        generation: the generation after which the previous epoch ended; None until that is known.
        change_json: the directive that says why it followed the previous epoch.
    """

    __tablename__ = "epochs"
    __table_args__ = (Index("epoch_of_job", "number", "epoch"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    number: Mapped[int] = mapped_column(ForeignKey("jobs.number"))
    epoch: Mapped[int]
    at: Mapped[float] = mapped_column(Double)
    generation: Mapped[int | None] = mapped_column(BigInteger)
    change_json: Mapped[str] = mapped_column("change", Text)

    @property
    def directive(self) -> dict[str, Any]:
        """The directive as results contain it."""
        return {"epoch": self.epoch, "generation": self.generation, **json.loads(self.change_json)}

    @property
    def plain(self) -> dict[str, Any]:
        """The directive with the time at which the epoch began."""
        return self.directive | {"at": self.at}


class RecordRow(Base):
    """The base class of records: written once, deleted when they are old."""

    __abstract__ = True

    id: Mapped[int] = mapped_column(primary_key=True)
    at: Mapped[float] = mapped_column(Double, index=True)


class ImprovementRow(RecordRow):
    """A verified improvement, without its solution; see `wire.news.Improvement`."""

    __tablename__ = "improvements"

    number: Mapped[int] = mapped_column(ForeignKey("jobs.number"), index=True)
    seconds: Mapped[float] = mapped_column(Double)
    epoch: Mapped[int]
    generation: Mapped[int] = mapped_column(BigInteger)
    cell: Mapped[int]
    fitness: Mapped[float | None] = mapped_column(Double)
    feasible: Mapped[bool]


class HistoryRow(RecordRow):
    """An improvement as the cells noted it, equal for equal runs; see `spy.improvement_records.ImprovementRecord`."""

    __tablename__ = "history"

    number: Mapped[int] = mapped_column(ForeignKey("jobs.number"), index=True)
    epoch: Mapped[int]
    generation: Mapped[int] = mapped_column(BigInteger)
    cell: Mapped[int]
    evaluations: Mapped[int] = mapped_column(BigInteger)
    fitness: Mapped[float] = mapped_column(Double)


class LogRow(RecordRow):
    """A message of the log; see `wire.news.LogRecord`."""

    __tablename__ = "log"

    number: Mapped[int | None] = mapped_column(index=True)
    level: Mapped[str] = mapped_column(String(16))
    process: Mapped[str] = mapped_column(Text)
    text: Mapped[str] = mapped_column(Text)
    node: Mapped[int | None] = mapped_column(index=True)
    cell: Mapped[int | None]
    generation: Mapped[int | None] = mapped_column(BigInteger)


class StatisticsRow(RecordRow):
    """A sample of a job's statistics; see `wire.news.Statistics`."""

    __tablename__ = "statistics"

    number: Mapped[int] = mapped_column(ForeignKey("jobs.number"), index=True)
    epoch: Mapped[int]
    generation: Mapped[int] = mapped_column(BigInteger)
    evaluations: Mapped[int] = mapped_column(BigInteger)
    messages: Mapped[int] = mapped_column(BigInteger)
    received: Mapped[int] = mapped_column(BigInteger)
    lost: Mapped[int] = mapped_column(BigInteger)
    rejected: Mapped[int] = mapped_column(BigInteger)
    nodes_alive: Mapped[int]
    messages_per_second: Mapped[float] = mapped_column(Double)
    best: Mapped[float | None] = mapped_column(Double)
    median: Mapped[float | None] = mapped_column(Double)
    worst: Mapped[float | None] = mapped_column(Double)
    age: Mapped[int] = mapped_column(BigInteger)
    diversity: Mapped[float] = mapped_column(Double)
    exchange_seconds: Mapped[float | None] = mapped_column(Double)


def _maybe_json(written: str | None) -> dict[str, Any] | None:
    return None if written is None else json.loads(written)
