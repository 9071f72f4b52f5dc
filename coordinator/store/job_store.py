"""Store what must survive the coordinator in a database: jobs, their state changes, best answers and results.

What a method writes is safe on disk when the method returns (within `Store.transaction`: when that ends). So a job that
is acknowledged after `Store.add` survives whatever happens to the process.
"""

import json
import secrets
import time
from collections.abc import Iterable
from typing import Any

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from coordinator.jobs.checkpoint import KEPT
from coordinator.jobs.job import Placement
from coordinator.jobs.states import ENDS, LIVING, WrongTransition, follow, state_of
from coordinator.store.database import storable
from coordinator.store.job_reader import JobReader
from coordinator.store.stored_job import IdTaken, Submission, Summary, find_row, row_of, summary_of
from coordinator.store.tables import (
    CheckpointRow,
    EpochRow,
    HistoryRow,
    HostRow,
    ImprovementRow,
    JobRow,
    StatisticsRow,
    TransitionRow,
)
from coordinator.store.tidying import forget_states, merge_oldest_epochs, note_ends, weigh

_NEW_ID_BYTES = 4
_TIDY_EVERY = 100  # epochs of a job between two clean-ups of its rows


class Store(JobReader):
    """The jobs of one cluster, in a database, to be read and written. Any thread may use it.

    Args:
        url: such as ``sqlite:////home/ada/jobs.sqlite`` or ``postgresql://ada@db.example/supernode``.

    Attributes:
        bytes_ended: about how many bytes the jobs take that have ended since the last `forget_beyond`.

    Raises:
        StoreFailed: if the database cannot be opened, is of another version, or serves another coordinator.
    """

    def __init__(self, url: str) -> None:
        super().__init__(url)
        self.bytes_ended = 0
        try:
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
            if job is not None and (there := find_row(session, job)) is not None:
                if there.digest != new.digest:
                    raise IdTaken(_taken(job, json.loads(there.file), json.loads(new.file)))
                return summary_of(there), False
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
            return summary_of(row), True

    def withdraw(self, number: int) -> None:
        """Delete a job that was never acknowledged to its client."""
        with self.writing() as session:
            session.execute(delete(CheckpointRow).where(CheckpointRow.number == number))
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
            row = row_of(session, number)
            _change(session, row, status, time.time() if at is None else at)
            if nodes is not None:
                row.nodes_json = json.dumps(nodes)
            if message is not None:
                row.message = storable(message)
            return summary_of(row)

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
            row = row_of(session, number)
            # At its deadline the job got this state already; now its nodes have stopped too.
            if not (status == row.status == "deadline" and row.ended is None):
                self.change(number, status)
            row.ended = row.ended or time.time()
            session.execute(delete(CheckpointRow).where(CheckpointRow.number == number))
            if message is not None:
                row.message = storable(message)
            if result is not None:
                row.result_json = json.dumps(result)
                row.fitness = result.get("fitness", row.fitness)
            session.flush()
            self.bytes_ended += weigh(session, number)
            return summary_of(row)

    def note_cancel(self, number: int) -> None:
        """Store that a client wants a job cancelled: a coordinator that takes over must know."""
        with self.writing() as session:
            row_of(session, number).is_cancelled = True

    def note_best(self, number: int, fitness: float | None, best: dict[str, Any]) -> None:
        """Store a better answer of a job; ``fitness`` is None if it is not finite."""
        with self.writing() as session:
            row = row_of(session, number)
            row.fitness = fitness
            row.best_json = json.dumps(best)

    def keep_checkpoint(self, number: int, data: bytes) -> None:
        """Store a checkpoint of a job, and delete the oldest beyond `KEPT`."""
        with self.writing() as session:
            session.add(CheckpointRow(number=number, data=data))
            session.flush()
            this = CheckpointRow.number == number
            kept = select(CheckpointRow.id).where(this).order_by(CheckpointRow.id.desc()).limit(KEPT)
            session.execute(delete(CheckpointRow).where(this, CheckpointRow.id.not_in(list(session.scalars(kept)))))

    def keep_hosts(self, hosts: Iterable[tuple[bytes, bool]]) -> None:
        """Store all hosts, encoded, each with whether it was given up, in the place of those that were stored."""
        with self.writing() as session:
            session.execute(delete(HostRow))
            session.add_all([HostRow(data=data, given_up=given_up) for data, given_up in hosts])

    def note_nodes(self, number: int, nodes: tuple[int, ...]) -> Summary:
        """Store the nodes of a job, which have changed."""
        with self.writing() as session:
            row = row_of(session, number)
            row.nodes_json = json.dumps(nodes)
            return summary_of(row)

    def note_placing(self, number: int, placement: Placement) -> None:
        """Store that a job is about to begin an epoch, with everything that a coordinator needs to take over there.

        After an update the stored answer is removed: it solves another problem.
        """
        with self.writing() as session:
            row = row_of(session, number)
            row.nodes_json = json.dumps(placement.nodes)
            row.wiring = placement.wiring
            row.epoch = placement.epoch
            row.topology = placement.file.run.topology
            row.past_json = placement.past.to_json()
            known = select(EpochRow).where(EpochRow.number == number, EpochRow.epoch == placement.epoch)
            if session.scalar(known) is not None:  # it goes on in that epoch, from a checkpoint
                note_ends(session, number, placement.past)
            elif placement.epoch > 0:  # the first epoch follows no directive, and its file is that of the submission
                row.changed_file = placement.file.to_json()
                if placement.why.get("do") == "update":
                    row.best_json = row.fitness = None
                change = json.dumps(dict(placement.why))
                session.add(EpochRow(number=number, epoch=placement.epoch, at=time.time(), change_json=change))
                session.flush()
                note_ends(session, number, placement.past)
                if placement.epoch % _TIDY_EVERY == 0:
                    forget_states(session, number)
                    merge_oldest_epochs(session, number, placement.past)

    def forget_before(self, at: float) -> None:
        """Delete the jobs that ended before ``at`` (Unix time), with all their records."""
        with self.writing() as session:
            old = select(JobRow.number).where(JobRow.ended < at)
            for table in (CheckpointRow, ImprovementRow, HistoryRow, StatisticsRow, EpochRow, TransitionRow):
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

    def _greatest_number(self) -> int:
        with self.reading() as session:
            return session.scalar(select(func.max(JobRow.number))) or 0


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


def _taken(job: str, there: list[Any], new: list[Any]) -> str:
    """Return the message that the id of a job is taken; the two files are lists of name, fields, settings, folder."""
    if there[1] != new[1]:
        return f"another problem file was submitted as job {job!r} before"
    before, now = there[2], new[2]
    names = sorted(name for name in {*before, *now} if before.get(name) != now.get(name))
    changed = ", ".join(f"{name} {before.get(name, 'not given')}, now {now.get(name, 'not given')}" for name in names)
    return f"this problem was submitted as job {job!r} before with other settings ({changed}); give it another id"


def _new_id(session: Session) -> str:
    while find_row(session, job := secrets.token_hex(_NEW_ID_BYTES)) is not None:
        pass
    return job
