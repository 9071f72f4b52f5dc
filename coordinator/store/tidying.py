"""Keep the store small: merge and delete rows of a job with many epochs, and weigh a job that has ended."""

import json

from sqlalchemy import delete, func, literal, select, update
from sqlalchemy.orm import Session

from coordinator.store.job_reader import kept_states
from coordinator.store.tables import EpochRow, JobRow, TransitionRow
from spy.past import SEVERAL, Past

_SMALL_BYTES = 1000  # estimated size of an ended job without its files, answer, result and epochs


def note_ends(session: Session, number: int, past: Past) -> None:
    """Store after which generation the latest epochs ended; of earlier ones it is stored already.

    Between two placements at most two epochs come to an end, so the last two directives are enough.
    """
    for directive in map(json.loads, past.texts[-2:]):
        if directive["do"] == SEVERAL:
            continue
        epoch = (EpochRow.number == number) & (EpochRow.epoch == directive["epoch"])
        session.execute(update(EpochRow).where(epoch).values(generation=directive["generation"]))


def forget_states(session: Session, number: int) -> None:
    """Delete the state changes of a job that `JobReader.transitions` no longer returns."""
    first, latest = (session.execute(query).all() for query in kept_states(number))  # by ascending, descending id
    between = TransitionRow.id.between(first[-1].id + 1, latest[-1].id - 1)
    session.execute(delete(TransitionRow).where(TransitionRow.number == number, between))


def merge_oldest_epochs(session: Session, number: int, past: Past) -> None:
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


def weigh(session: Session, number: int) -> int:
    """Store and return the size in bytes of a job that has ended: to add up all texts later would take seconds."""
    epochs = select(func.sum(func.length(EpochRow.change_json))).where(EpochRow.number == number).scalar_subquery()
    texts = JobRow.file, JobRow.changed_file, JobRow.best_json, JobRow.result_json, JobRow.past_json
    lengths = [func.coalesce(each, 0) for each in (epochs, *map(func.length, texts))]
    this, unseen = JobRow.number == number, {"synchronize_session": False}
    session.execute(
        update(JobRow).where(this).values(bytes=sum(lengths, literal(_SMALL_BYTES))), execution_options=unseen
    )
    return session.scalar(select(JobRow.bytes).where(this)) or 0
