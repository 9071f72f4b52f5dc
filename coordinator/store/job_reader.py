"""Read jobs from the store: their descriptions, states and epochs."""

import json
from typing import Any

from sqlalchemy import Select, and_, func, or_, select
from sqlalchemy.orm import undefer

from coordinator.jobs.states import ENDS
from coordinator.store.sessions import StoreSessions
from coordinator.store.stored_job import (
    Answered,
    Stored,
    Summary,
    known_row,
    row_of,
    summary_of,
    values_of,
    whole_rows,
)
from coordinator.store.tables import CheckpointRow, EpochRow, HostRow, JobRow, TransitionRow
from spy.past import Past

# A job that is kept alive may have any number of epochs and states. These bounds keep answers, and the database, small.
_FIRST_STATES, _LATEST_STATES = 10, 1000  # state changes of a job that `JobReader.transitions` returns
_MOST_EPOCHS = 1000  # epochs of a job that `JobReader.epochs` returns, the latest,
_MOST_DIRECTIVE_BYTES = 1 << 19  # and the bytes of their directives


class JobReader(StoreSessions):
    """The jobs of one cluster, to be read. Any thread may use it; it reads what is committed."""

    def unended(self) -> list[Stored]:
        """Return all jobs without an end, by number; jobs past their deadline whose nodes still stop are included."""
        with self.reading() as session:
            draining = and_(JobRow.status == "deadline", JobRow.ended.is_(None))
            found = whole_rows().where(or_(JobRow.status.not_in(ENDS), draining)).order_by(JobRow.number)
            rows = session.scalars(found)
            return [Stored(**values_of(row, Stored)) for row in rows]

    def newest(self, limit: int | None = None) -> list[Summary]:
        """Return the newest jobs, at most ``limit``, the newest last."""
        with self.reading() as session:
            rows = session.scalars(select(JobRow).order_by(JobRow.number.desc()).limit(limit))
            return [summary_of(row) for row in rows][::-1]

    def checkpoints(self, number: int) -> list[bytes]:
        """Return the checkpoints that are kept of a job, the latest first."""
        with self.reading() as session:
            this = select(CheckpointRow.data).where(CheckpointRow.number == number)
            return list(session.scalars(this.order_by(CheckpointRow.id.desc())))

    def hosts(self) -> list[tuple[bytes, bool]]:
        """Return the hosts that were stored last, see `Store.keep_hosts`."""
        with self.reading() as session:
            return [(row.data, row.given_up) for row in session.scalars(select(HostRow).order_by(HostRow.id))]

    def show(self, job: str) -> Stored:
        """Return a job with its problem files, answer and result.

        Raises:
            UnknownJob: if there is no job of that id.
        """
        with self.reading() as session:
            return Stored(**values_of(known_row(session, job, whole_rows()), Stored))

    def answer(self, job: str) -> Answered:
        """Return a job with its answer and result.

        Raises:
            UnknownJob: if there is no job of that id.
        """
        with self.reading() as session:
            with_answers = select(JobRow).options(undefer(JobRow.best_json), undefer(JobRow.result_json))
            return Answered(**values_of(known_row(session, job, with_answers), Answered))

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
            return summary_of(known_row(session, job))

    def at(self, number: int) -> Summary:
        """Return the short description of the job of that number.

        Raises:
            UnknownJob: if there is no such job.
        """
        with self.writing() as session:  # a reading session would not see what the open transaction has written
            return summary_of(row_of(session, number))

    def counts(self) -> dict[str, int]:
        """Return the number of jobs in each state; states without jobs are left out."""
        with self.reading() as session:
            rows = session.execute(select(JobRow.status, func.count()).group_by(JobRow.status).order_by(JobRow.status))
            return {row[0]: row[1] for row in rows}

    def transitions(self, number: int) -> list[tuple[str, float]]:
        """Return the states of a job so far with their times (Unix); of very many only the first and the latest."""
        with self.reading() as session:
            first, latest = map(session.execute, kept_states(number))
            rows = {row.id: (row.status, row.at) for row in (*first, *latest)}
        return [rows[number] for number in sorted(rows)]


def kept_states(number: int) -> tuple[Select[int, str, float], Select[int, str, float]]:
    """Return the queries for the state changes of a job that are kept: the first ones, and the latest in reverse."""
    found = select(TransitionRow.id, TransitionRow.status, TransitionRow.at).where(TransitionRow.number == number)
    first = found.order_by(TransitionRow.id).limit(_FIRST_STATES)
    latest = found.order_by(TransitionRow.id.desc()).limit(_LATEST_STATES)
    return first, latest
