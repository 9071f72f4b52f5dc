"""Repeat a run in one process by its directives, to compare what comes of it."""

from collections.abc import Sequence
from typing import Any

from node.replay import replay
from problems import ProblemFile
from spy.past import Lived, Past


def repeated(file: ProblemFile, directives: Sequence[dict[str, Any]]) -> tuple[str | None, float | None]:
    """Return the history and the best fitness of a run with these directives.

    Raises:
        BadInput: if an epoch ends elsewhere, or a directive says that the run cannot be repeated.
    """
    *before, last = replay(file, directives)
    past = Past()
    for epoch, then in zip(before, [*before, last][1:], strict=True):
        past = past.and_then(Lived(epoch.file, epoch.reports, epoch.plan.epoch), then.why)
    lived = Lived(last.file, last.reports, last.plan.epoch)
    best = past.or_better(lived)
    return past.and_then(lived).history, None if best is None else best.fitness
