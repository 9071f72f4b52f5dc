"""What a job has lived through, added up epoch by epoch: of an epoch that has ended nothing else need be kept.

A job that is kept alive while its world moves has as many epochs as it was told of updates; what is known of it must
not grow with all that each of their cells had to report.
"""

import hashlib
import json
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import topologies
from problems import ProblemFile
from topologies import ROOT
from wire.exchange import Champion
from wire.report import Report, Staleness

MOST_BYTES = 4 << 20
"""Of the directives of one job, as JSON; when there are more, the older ones are put together."""


SEVERAL = "several"
"""What a directive does that stands for those that were put together."""

_FEWEST = 2  # directives that are never put together


@dataclass(frozen=True)
class Lived:
    """What became of a job in one of its epochs.

    Attributes:
        reports: of the cells that told of their end in it.
        number: of the epoch.
    """

    file: ProblemFile
    reports: Sequence[Report] = ()
    number: int = 0


@dataclass(frozen=True)
class Messages:
    """Counted over cells."""

    sent: int = 0
    received: int = 0
    lost: int = 0
    rejected: int = 0


@dataclass(frozen=True)
class Past:
    """The epochs of a job so far.

    Attributes:
        epochs: how many.
        generations: of all of them, as far as anybody has told.
        evaluations: by all cells.
        history: over the digests of all cells, epoch by epoch; None if not everything is known. Epochs that a node
            died in are left out: what that node lived through nobody knows.
        champion: the best that cells knew when they stopped, in epochs of the same problem as the next one. An epoch
            that a node died in says nothing: what others knew then is another in each repetition.
        texts: the directives, as JSON, which takes a tenth of the room.
        text_bytes: what they come to.
    """

    epochs: int = 0
    generations: int = 0
    evaluations: int = 0
    messages: Messages = field(default_factory=Messages)
    staleness: Staleness = field(default_factory=lambda: Staleness(0, 0, 0, 0))
    history: str | None = ""
    champion: Champion | None = None
    texts: tuple[str, ...] = ()
    text_bytes: int = 0

    @property
    def directives(self) -> list[dict[str, Any]]:
        """How each epoch but the first followed the one before, and after which generation."""
        return [json.loads(text) for text in self.texts]

    def and_then(self, epoch: Lived, why: Mapping[str, Any] | None = None) -> "Past":
        """With another epoch that has ended, and ``why`` there is one after it, if there is, as a directive."""
        reports = epoch.reports
        died = why is not None and why.get("do") == "replace"
        generations = lived_for(reports, died) if reports else 0
        past = replace(
            self,
            epochs=epoch.number + 1,
            generations=self.generations + generations,
            evaluations=self.evaluations + sum(report.evaluations for report in reports),
            messages=_counted(self.messages, reports),
            staleness=_added(self.staleness, reports),
            history=self.history if died else self._history_with(epoch),
            champion=self._champion_after(epoch, None if why is None else why.get("do")),
        )
        return past if why is None else past.led_on({"epoch": epoch.number + 1, "generation": generations, **why})

    def _champion_after(self, epoch: Lived, do: str | None) -> Champion | None:
        if do in (None, "update", "retry"):  # an attempt was judged at its end, and may be coded otherwise
            return None
        return self.champion if do == "replace" else self.or_better(epoch)

    def _history_with(self, epoch: Lived) -> str | None:
        whole = len(epoch.reports) == topologies.parse(epoch.file.run.topology).cells
        if epoch.file.run.mode == "lockstep":  # else it was halted somewhere on the way, as when a node dies
            whole = whole and len({report.generation for report in epoch.reports}) == 1
        if self.history is None or not whole or epoch.number > self.epochs:
            return None
        digests = b"".join(report.digest for report in sorted(epoch.reports, key=lambda report: report.cell))
        return hashlib.sha256(bytes.fromhex(self.history) + digests).hexdigest()

    def or_better(self, epoch: Lived) -> Champion | None:
        """The best that cells know at the end of an ``epoch`` of the same problem, or knew before."""
        now, before = best_known(epoch.reports, epoch.file.run.spy), self.champion
        if before is None or (now is not None and now.fitness <= before.fitness):
            return now
        return before._replace(generation=0)  # there it is known from the beginning

    def led_on(self, *directives: Mapping[str, Any]) -> "Past":
        """With more directives, the latest."""
        texts = (*self.texts, *map(json.dumps, directives))
        size = self.text_bytes + sum(map(len, texts[len(self.texts) :]))
        while size > MOST_BYTES and len(texts) > _FEWEST:
            texts = _shortened(texts)
            size = sum(map(len, texts))
        return replace(self, texts=texts, text_bytes=size)

    def to_json(self) -> str:
        """All but the directives."""
        messages = [self.messages.sent, self.messages.received, self.messages.lost, self.messages.rejected]
        champion = None if self.champion is None else [*self.champion[:-1], self.champion.genome.hex()]
        counts = [self.epochs, self.generations, self.evaluations, messages, self.staleness]
        return json.dumps([*counts, self.history, champion])

    @staticmethod
    def from_json(text: str) -> "Past":
        """The inverse of `to_json`."""
        epochs, generations, evaluations, messages, staleness, history, champion = json.loads(text)
        known = None
        if champion is not None:
            fitness, generation, cell, genome = champion
            known = Champion(fitness, generation, cell, bytes.fromhex(genome))
        return Past(epochs, generations, evaluations, Messages(*messages), Staleness(*staleness), history, known)


def best_known(reports: Sequence[Report], spy: str) -> Champion | None:
    """The best champion that the cells know at the end; under the paper's spy only what the root knows counts."""
    known = [report.champion for report in reports if spy == "champion" or report.cell == ROOT]
    return min((champion for champion in known if champion is not None), default=None)


def stopped_after(reports: Sequence[Report]) -> int:
    """The generation after which the cells stopped; in async mode the (lower) median."""
    return statistics.median_low(report.generation for report in reports)


def lived_for(reports: Sequence[Report], halted: bool) -> int:
    """Generations of an epoch. Where cells halted since one had died, the next epoch counts from the furthest."""
    return max(report.generation for report in reports) if halted else stopped_after(reports)


def _counted(before: Messages, reports: Sequence[Report]) -> Messages:
    return Messages(
        before.sent + sum(report.sent for report in reports),
        before.received + sum(report.received for report in reports),
        before.lost + sum(report.lost for report in reports),
        before.rejected + sum(report.rejected for report in reports),
    )


def _added(before: Staleness, reports: Sequence[Report]) -> Staleness:
    all_of = [before, *(report.staleness for report in reports)]
    return Staleness(
        sum(each.immigrants for each in all_of),
        sum(each.behind for each in all_of),
        max(each.furthest for each in all_of),
        sum(each.again for each in all_of),
    )


def _shortened(texts: tuple[str, ...]) -> tuple[str, ...]:
    """The older half put together: what they come to is known, but not how to repeat them."""
    half = (len(texts) + 1) // 2
    older = [json.loads(text) for text in texts[:half]]
    updates = [directive for directive in older if directive["do"] in ("update", SEVERAL)]
    together = {
        "do": SEVERAL,
        "epoch": older[-1]["epoch"],
        "generation": sum(directive["generation"] for directive in older),
        "fields": dict(item for directive in updates for item in directive["fields"].items()),
    }
    return (json.dumps(together), *texts[half:])
