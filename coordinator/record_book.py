"""What happened in every job, second by second, for those who look at it later; the oldest is forgotten first.

It is kept in the store's database. Whoever wants it takes it page by page: a run of an hour is thousands of rows.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Select, delete, func, select

from coordinator.store import Store, storable
from coordinator.tables import HistoryRow, ImprovementRow, JobRow, LogRow, RecordRow, StatisticsRow
from problems.errors import BadInput
from spy.improvement_records import ImprovementRecord
from wire.news import Improvement, LogRecord, Statistics
from wire.plain import plain

_PAGE = 2000  # rows in one answer
_LOOK_AFTER = 1000  # rows written, before what is too old is looked for,
_LOOK_AFTER_SHARE = 1 / 16  # or of all the bytes that are kept, ended
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
        days: records, and jobs that have ended, are forgotten when they are so old.
        rows: of each kind of record, the newest.
        bytes: of jobs that have ended, their files and results together; the newest.
    """

    days: float = 30.0
    rows: int = 1_000_000
    bytes: int = 1 << 30


class RecordBook:
    """The records of a store; any thread may use it."""

    def __init__(self, store: Store, keep: Keep) -> None:
        self._store = store
        self._keep = keep
        self._unlooked = _LOOK_AFTER  # rows since too old ones were looked for

    def note_improvement(self, at: float, better: Improvement) -> None:
        """A job has a better answer, at a Unix time."""
        names = ("seconds", "epoch", "generation", "cell", "fitness", "feasible")
        values = {name: plain(getattr(better, name)) for name in names}
        self._note(ImprovementRow(at=at, number=better.job, **values))

    def note_history(self, at: float, number: int, epoch: int, records: Sequence[ImprovementRecord]) -> None:
        """What the cells of a job noted in an epoch that has ended; told again, it takes the place of the former."""
        with self._store.writing() as session:
            session.execute(delete(HistoryRow).where(HistoryRow.number == number, HistoryRow.epoch == epoch))
            session.add_all(HistoryRow(at=at, number=number, **record._asdict()) for record in records)
        self._unlooked += len(records)

    def note_statistics(self, at: float, statistics: Statistics) -> None:
        """How a job is at a Unix time."""
        values = plain(statistics._asdict())
        self._note(StatisticsRow(at=at, number=values.pop("job"), **values))

    def note_log(self, record: LogRecord) -> None:
        """A process has something to say."""
        values = record._asdict()
        text = storable(values.pop("text"))
        self._note(LogRow(number=values.pop("job"), text=text, **values))

    def log(self, job: str | None, node: int | None, after: int) -> dict[str, Any]:
        """A page of the log, after the record of a given id; that of a job or a node only, if one is given.

        Returns:
            as `page`; the column "job" has ids.

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
        """Records of a job in the order of their coming, those after the one of a given id.

        Returns:
            "columns", "rows", the first of each row being its id, and whether there are "more".

        Raises:
            UnknownJob: if there is no such job.
            BadInput: if there are no such records.
        """
        table = _TABLES.get(kind)
        if table is None:
            raise BadInput(f"kind: expected one of {', '.join(_TABLES)}, found {kind!r}")
        number = self._store.summary(job).number
        untold = (
            ("id", "number", "at") if table is HistoryRow else ("id", "number")
        )  # a function of the run has no time
        columns = ["id", *(column.name for column in table.__table__.columns if column.name not in untold)]
        query = select(*(getattr(table, name) for name in columns))
        return self._page(columns, query.where(table.number == number, table.id > after).order_by(table.id))

    def forget_the_old(self, now: float) -> None:
        """If enough was written since the last time, forget what is older, or more, than is to be kept."""
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
            rows = [list(row) for row in session.execute(query.limit(_PAGE + 1))]
        return {"columns": list(columns), "rows": rows[:_PAGE], "more": len(rows) > _PAGE}

    def _note(self, row: RecordRow) -> None:
        with self._store.writing() as session:
            session.add(row)
        self._unlooked += 1
