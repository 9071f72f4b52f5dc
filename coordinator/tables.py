"""The tables of the store."""

import json
from typing import Any

from sqlalchemy import BigInteger, Double, ForeignKey, Index, String, Text
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column


class Base(DeclarativeBase):
    """All tables."""


class MetaRow(Base):
    """What the store says of itself."""

    __tablename__ = "meta"

    schema: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)


class JobRow(Base):
    """A job.

    Attributes:
        bytes: about what it takes once it has ended, without its records.
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
    status: Mapped[str] = mapped_column(String(16), index=True)
    fitness: Mapped[float | None] = mapped_column(Double)
    submitted: Mapped[float] = mapped_column(Double)
    started: Mapped[float | None] = mapped_column(Double)
    ended: Mapped[float | None] = mapped_column(Double)
    bytes: Mapped[int] = mapped_column(BigInteger, default=0)
    message: Mapped[str | None] = mapped_column(Text)
    nodes_json: Mapped[str] = mapped_column("nodes", Text, default="[]")
    wiring: Mapped[int] = mapped_column(BigInteger, default=0)
    epoch: Mapped[int] = mapped_column(default=0)
    # What may be large is read only where it is asked for.
    file: Mapped[str] = mapped_column(Text, deferred=True)
    changed_file: Mapped[str | None] = mapped_column(Text, deferred=True)
    best_json: Mapped[str | None] = mapped_column("best", Text, deferred=True)
    result_json: Mapped[str | None] = mapped_column("result", Text, deferred=True)
    past_json: Mapped[str | None] = mapped_column("past", Text, deferred=True)

    @property
    def nodes(self) -> tuple[int, ...]:
        """The nodes that it lives on."""
        return tuple(json.loads(self.nodes_json))

    @property
    def file_now(self) -> str:
        """The problem file as its world is now."""
        return self.file if self.changed_file is None else self.changed_file

    @property
    def best(self) -> dict[str, Any] | None:
        """The best verified answer."""
        return _maybe_json(self.best_json)

    @property
    def result(self) -> dict[str, Any] | None:
        """The result."""
        return _maybe_json(self.result_json)


class TransitionRow(Base):
    """A change of a job's state."""

    __tablename__ = "transitions"

    id: Mapped[int] = mapped_column(primary_key=True)
    number: Mapped[int] = mapped_column(ForeignKey("jobs.number"), index=True)
    status: Mapped[str] = mapped_column(String(16))
    at: Mapped[float] = mapped_column(Double)


class EpochRow(Base):
    """An epoch of a job after its first.

    Attributes:
        generation: after which the epoch before ended, once that is known.
        change_json: how it followed that one, as a directive.
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
        """As results have it."""
        return {"epoch": self.epoch, "generation": self.generation, **json.loads(self.change_json)}

    @property
    def plain(self) -> dict[str, Any]:
        """The same, and when it began."""
        return self.directive | {"at": self.at}


class RecordRow(Base):
    """Something that happened; written once, and forgotten when it is old."""

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
    """An improvement as the cells noted it, a function of the run; see `spy.improvement_records.ImprovementRecord`."""

    __tablename__ = "history"

    number: Mapped[int] = mapped_column(ForeignKey("jobs.number"), index=True)
    epoch: Mapped[int]
    generation: Mapped[int] = mapped_column(BigInteger)
    cell: Mapped[int]
    evaluations: Mapped[int] = mapped_column(BigInteger)
    fitness: Mapped[float] = mapped_column(Double)


class LogRow(RecordRow):
    """A line of the log; see `wire.news.LogRecord`."""

    __tablename__ = "log"

    number: Mapped[int | None] = mapped_column(index=True)
    level: Mapped[str] = mapped_column(String(16))
    process: Mapped[str] = mapped_column(Text)
    text: Mapped[str] = mapped_column(Text)
    node: Mapped[int | None] = mapped_column(index=True)
    cell: Mapped[int | None]
    generation: Mapped[int | None] = mapped_column(BigInteger)


class StatisticsRow(RecordRow):
    """How a job was in one second; see `wire.news.Statistics`."""

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
