"""The past of a job: its ended epochs added up, so that nothing else of them need be kept.

A job that is kept alive while its world moves has an epoch for each update. What is kept of it must not grow with the
reports of all cells in all these epochs.
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
from wire.champion import Champion
from wire.report import Report, Staleness
from wire.strict import Rejected, count, fields, of

MOST_BYTES = 4 << 20
"""The most bytes of one job's directives, as JSON; beyond that the older ones are merged into one."""


SEVERAL = "several"
"""The ``do`` of a directive that stands for merged ones."""

_FEWEST = 2  # directives that are never merged


@dataclass(frozen=True)
class Lived:
    """An epoch of a job that has ended.

    Attributes:
        file: the problem file of the epoch.
        reports: the reports of its cells; a cell whose node died has none.
        number: the epoch's number in the job, from 0.
    """

    file: ProblemFile
    reports: Sequence[Report] = ()
    number: int = 0


@dataclass(frozen=True)
class Messages:
    """Messages to neighbours, summed over cells; see `wire.report.Report`."""

    sent: int = 0
    received: int = 0
    lost: int = 0
    rejected: int = 0


@dataclass(frozen=True)
class Past:
    """The ended epochs of a job, added up. Immutable: `and_then` and `led_on` return a longer past.

    Attributes:
        epochs: the number of epochs.
        generations: the generations of all epochs, as far as reports tell.
        evaluations: the fitness calls of all cells.
        messages: messages to neighbours.
        staleness: of immigrants in async mode, see `wire.report.Staleness`.
        history: SHA-256 over the digests of all cells, epoch by epoch, in hexadecimal; None if a digest is missing.
            Epochs in which a node died are left out, since nothing is known of that node's generations.
        champion: the best that cells knew when they stopped, in epochs of the same problem as the next one. An epoch in
            which a node died does not count: what the other cells knew then differs from repetition to repetition.
        texts: the directives as JSON texts, which need a tenth of the memory.
        text_bytes: their length in total.
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
        """The directives: what led to each epoch but the first, and after which generation."""
        return [json.loads(text) for text in self.texts]

    def and_then(self, epoch: Lived, why: Mapping[str, Any] | None = None) -> "Past":
        """Return this past with one more ended epoch.

        ``why`` is the directive that led from it to the next epoch; None if it is the job's last one.
        """
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
        # The last epoch has no next one. An update changes the problem. A restart may change the coding, and the spy
        # has judged the attempt before it.
        if do in (None, "update", "retry"):
            return None
        return self.champion if do == "replace" else self.or_better(epoch)

    def _history_with(self, epoch: Lived) -> str | None:
        whole = len(epoch.reports) == topologies.parse(epoch.file.run.topology).cells
        if epoch.file.run.mode == "lockstep":  # cells halted in different generations would not do so again
            whole = whole and len({report.generation for report in epoch.reports}) == 1
        if self.history is None or not whole or epoch.number > self.epochs:
            return None
        digests = b"".join(report.digest for report in sorted(epoch.reports, key=lambda report: report.cell))
        return hashlib.sha256(bytes.fromhex(self.history) + digests).hexdigest()

    def or_better(self, epoch: Lived) -> Champion | None:
        """Return the best champion known at the end of ``epoch``, or of earlier epochs of the same problem."""
        now, before = best_known(epoch.reports, epoch.file.run.spy), self.champion
        if before is None or (now is not None and now.fitness <= before.fitness):
            return now
        return before._replace(generation=0)  # in this epoch it has been known from the beginning

    def led_on(self, *directives: Mapping[str, Any]) -> "Past":
        """Return this past with more directives, after those that it has."""
        texts = (*self.texts, *map(json.dumps, directives))
        size = self.text_bytes + sum(map(len, texts[len(self.texts) :]))
        while size > MOST_BYTES and len(texts) > _FEWEST:
            texts = _shortened(texts)
            size = sum(map(len, texts))
        return replace(self, texts=texts, text_bytes=size)

    def to_json(self) -> str:
        """Return everything but the directives as JSON; those are stored in rows of their own."""
        messages = [self.messages.sent, self.messages.received, self.messages.lost, self.messages.rejected]
        champion = None if self.champion is None else [*self.champion[:-1], self.champion.genome.hex()]
        counts = [self.epochs, self.generations, self.evaluations, messages, self.staleness]
        return json.dumps([*counts, self.history, champion])

    @staticmethod
    def from_json(text: str) -> "Past":
        """Return the past that `to_json` has written, without directives.

        Raises:
            Rejected: if ``text`` is not the output of `to_json`.
        """
        try:
            epochs, generations, evaluations, messages, staleness, history, champion = fields(json.loads(text), 7)
            known = None if champion is None else Champion.of([*champion[:-1], bytes.fromhex(champion[-1])])
            if history is not None:
                bytes.fromhex(of(str, history))
        except Rejected:
            raise
        except (ValueError, TypeError, IndexError, RecursionError) as error:
            raise Rejected("no past") from error
        return Past(
            count(epochs),
            count(generations),
            count(evaluations),
            Messages(*map(count, fields(messages, 4))),
            Staleness(*map(count, fields(staleness, 4))),
            history,
            known,
        )


def best_known(reports: Sequence[Report], spy: str) -> Champion | None:
    """Return the best champion that the cells know at the end; under the paper's ``spy`` only the root's counts."""
    known = [report.champion for report in reports if spy == "champion" or report.cell == ROOT]
    return min((champion for champion in known if champion is not None), default=None)


def stopped_after(reports: Sequence[Report]) -> int:
    """Return the generation after which the cells stopped; in async mode, where they differ, the lower median.

    Without reports, as when a node failed while it prepared, it is 0.
    """
    return statistics.median_low(report.generation for report in reports) if reports else 0


def lived_for(reports: Sequence[Report], halted: bool) -> int:
    """Return the number of generations of an epoch; if its cells were ``halted`` because a node died, the largest."""
    return max((report.generation for report in reports), default=0) if halted else stopped_after(reports)


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
    """Return the directives with the older half merged into one: their sums stay known, but they cannot be replayed."""
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
