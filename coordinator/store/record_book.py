"""Records of what happened in every job: improvements, histories, statistics and the log, in the store's database.

Readers get them page by page: an hour of a run makes thousands of rows. The oldest records are deleted first.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Select, delete, func, select

from coordinator.store.database import storable
from coordinator.store.job_store import Store
from coordinator.store.tables import HistoryRow, ImprovementRow, JobRow, LogRow, RecordRow, StatisticsRow
from problems.errors import BadInput
from spy.improvement_records import ImprovementRecord
from wire.news import Improvement, LogRecord, Statistics
from wire.plain import plain

_PAGE = 2000  # rows in one answer
# Old records are looked for after so many new rows, or after ended jobs have come to this share of the bytes kept.
_LOOK_AFTER = 1000
_LOOK_AFTER_SHARE = 1 / 16
_DAY = 86400.0  # seconds

_TABLES: dict[str, type[ImprovementRow] | type[HistoryRow] | type[StatisticsRow]] = {
    "improvements": ImprovementRow,
    "history": HistoryRow,
    "statistics": StatisticsRow,
}


@dataclass(frozen=True)
class Keep:
    """How much is kept.

    Attributes:
        days: the age in days at which records and ended jobs are deleted.
        rows: the number of records of each kind to keep, the newest.
        bytes: the bytes of ended jobs to keep, their files, results and epochs together; the newest.
    """

    days: float = 30.0
    rows: int = 1_000_000
    bytes: int = 1 << 30


class RecordBook:
    """The records of a store; any thread may use it."""

    def __init__(self, store: Store, keep: Keep) -> None:
        self._store = store
        self._keep = keep
        self._unlooked = _LOOK_AFTER  # rows written since the last look for old ones; the first write looks

    def note_improvement(self, at: float, better: Improvement) -> None:
        """Store a verified improvement of a job, with its Unix time."""
        names = ("seconds", "epoch", "generation", "cell", "fitness", "feasible")
        values = {name: plain(getattr(better, name)) for name in names}
        self._note(ImprovementRow(at=at, number=better.job, **values))

    def note_history(self, at: float, number: int, epoch: int, records: Sequence[ImprovementRecord]) -> None:
        """Store the improvements that the cells noted in an epoch that has ended; they replace those stored before.

        A coordinator that takes over reports an epoch again if it gathers its reports again.
        """
        with self._store.writing() as session:
            session.execute(delete(HistoryRow).where(HistoryRow.number == number, HistoryRow.epoch == epoch))
            session.add_all(HistoryRow(at=at, number=number, **record._asdict()) for record in records)
        self._unlooked += len(records)

    def note_statistics(self, at: float, statistics: Statistics) -> None:
        """Store the statistics of a job, with their Unix time."""
        values = plain(statistics._asdict())
        self._note(StatisticsRow(at=at, number=values.pop("job"), **values))

    def note_log(self, record: LogRecord) -> None:
        """Store a log message of a process."""
        values = record._asdict()
        text = storable(values.pop("text"))
        self._note(LogRow(number=values.pop("job"), text=text, **values))

    def log(self, job: str | None, node: int | None, after: int) -> dict[str, Any]:
        """Return a page of the log.

        Args:
            job: only messages about the job of this id; None for all.
            node: only messages about this node; None for all.
            after: the id of the last record of the page before; 0 for the first page.

        Returns:
            As `page`; the column "job" has jobs' ids.

        Raises:
            UnknownJob: if there is no such job.
        """
        of_job = JobRow.job.label("job")
        names = ("id", "at", "level", "process", "text", "node", "cell", "generation")
        query = select(*(getattr(LogRow, name) for name in names), of_job)
        query = query.outerjoin(JobRow, JobRow.number == LogRow.number).where(LogRow.id > after)
        if job is not None:
            query = query.where(LogRow.number == self._store.summary(job).number)
        if node is not None:
            query = query.where(LogRow.node == node)
        return self._page([*names, "job"], query.order_by(LogRow.id))

    def page(self, kind: str, job: str, after: int) -> dict[str, Any]:
        """Return a page of a job's records, in the order in which they were stored.

        Args:
            kind: "improvements", "history" or "statistics".
            job: the job's id.
            after: the id of the last record of the page before; 0 for the first page.

        Returns:
            "columns": their names; "rows": lists of values, the first of each being the record's id; "more": whether
            another page follows.

        Raises:
            UnknownJob: if there is no such job.
            BadInput: if there is no such kind of record.
        """
        table = _TABLES.get(kind)
        if table is None:
            raise BadInput(f"kind: expected one of {', '.join(_TABLES)}, found {kind!r}")
        number = self._store.summary(job).number
        untold = (
            ("id", "number", "at") if table is HistoryRow else ("id", "number")
        )  # a history is a function of the run, equal for equal runs, so it shows no times
        columns = ["id", *(column.name for column in table.__table__.columns if column.name not in untold)]
        query = select(*(getattr(table, name) for name in columns))
        return self._page(columns, query.where(table.number == number, table.id > after).order_by(table.id))

    def forget_the_old(self, now: float) -> None:
        """Delete what is too old or too much, if enough was written since the last time; ``now`` is a Unix time."""
        ended = self._store.bytes_ended
        if self._unlooked < _LOOK_AFTER and ended < self._keep.bytes * _LOOK_AFTER_SHARE:
            return
        self._unlooked = 0
        before = now - self._keep.days * _DAY
        with self._store.writing() as session:
            for table in (*_TABLES.values(), LogRow):
                newest = session.scalar(select(func.max(table.id))) or 0
                session.execute(delete(table).where((table.id <= newest - self._keep.rows) | (table.at < before)))
        self._store.forget_before(before)
        self._store.forget_beyond(self._keep.bytes)

    def _page(self, columns: Sequence[str], query: Select[Any]) -> dict[str, Any]:
        with self._store.reading() as session:
            rows = [list(row) for row in session.execute(query.limit(_PAGE + 1))]  # one more tells whether more follow
        return {"columns": list(columns), "rows": rows[:_PAGE], "more": len(rows) > _PAGE}

    def _note(self, row: RecordRow) -> None:
        with self._store.writing() as session:
            session.add(row)
        self._unlooked += 1
