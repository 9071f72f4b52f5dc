"""Repeat a run in one process by its directives, to compare what comes of it."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from node.replay import replay
from problems import ProblemFile
from spy.past import Lived, Past
from spy.result import stop_reasons
from wire.report import Reason


class Repetition(NamedTuple):
    """The outcome of a run that is lived through once more.

    Attributes:
        history: its ``history_sha256``; None if it has none.
        fitness: the best fitness; None if there is none.
        reasons: why its cells have stopped by themselves; empty if a stop came from outside, or at the last generation.
    """

    history: str | None
    fitness: float | None
    reasons: tuple[Reason, ...]


def repeated(file: ProblemFile, directives: Sequence[dict[str, Any]]) -> Repetition:
    """Return what comes of a run with these directives.

    Raises:
        BadInput: if an epoch ends elsewhere, or a directive says that the run cannot be repeated.
    """
    *before, last = replay(file, directives)
    past = Past()
    for epoch, then in zip(before, [*before, last][1:], strict=True):
        past = past.and_then(Lived(epoch.file, epoch.reports, epoch.plan.epoch), then.why)
    lived = Lived(last.file, last.reports, last.plan.epoch)
    best = past.or_better(lived)
    reasons = stop_reasons(last.reports, "lockstep")
    return Repetition(past.and_then(lived).history, None if best is None else best.fitness, reasons)
