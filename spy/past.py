"""What a job has lived through, added up world by world: of a world that has ended nothing else need be kept.

A job that is kept alive while its world moves has as many worlds as it was told of updates; what is known of it must
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
from wire.report import Report, Staleness

MOST_BYTES = 4 << 20
"""Of the directives of one job, as JSON; when there are more, the older ones are put together."""


_FEWEST = 2  # directives that are never put together


@dataclass(frozen=True)
class Lived:
    """What became of a job in one of its worlds.

    Attributes:
        reports: of the cells that told of their end in it.
        number: of the world.
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
    """The worlds of a job so far.

    Attributes:
        worlds: how many.
        generations: of all of them, as far as anybody has told.
        evaluations: by all cells.
        history: over the digests of all cells, world by world; None if not everything is known. Worlds that a node
            died in are left out: what that node lived through nobody knows.
        texts: the directives, as JSON, which takes a tenth of the room.
        text_bytes: what they come to.
    """

    worlds: int = 0
    generations: int = 0
    evaluations: int = 0
    messages: Messages = field(default_factory=Messages)
    staleness: Staleness = field(default_factory=lambda: Staleness(0, 0, 0, 0))
    history: str | None = ""
    texts: tuple[str, ...] = ()
    text_bytes: int = 0

    @property
    def directives(self) -> list[dict[str, Any]]:
        """How each world but the first followed the one before, and after which generation."""
        return [json.loads(text) for text in self.texts]

    @staticmethod
    def unknown(worlds: int) -> "Past":
        """Of so many worlds nothing is known; of none at all there is nothing to know."""
        return Past(worlds, history=None if worlds else "")

    def and_then(self, world: Lived, why: Mapping[str, Any] | None = None) -> "Past":
        """With another world that has ended, and ``why`` there is one after it, if there is, as a directive."""
        reports = world.reports
        died = why is not None and why.get("do") == "replace"
        generations = lived_for(reports, died) if reports else 0
        past = replace(
            self,
            worlds=world.number + 1,
            generations=self.generations + generations,
            evaluations=self.evaluations + sum(report.evaluations for report in reports),
            messages=_counted(self.messages, reports),
            staleness=_added(self.staleness, reports),
            history=self.history if died else self._history_with(world),
        )
        return past if why is None else past.led_on({"world": world.number + 1, "generation": generations, **why})

    def _history_with(self, world: Lived) -> str | None:
        whole = len(world.reports) == topologies.parse(world.file.run.topology).cells
        if self.history is None or not whole or world.number > self.worlds:
            return None
        digests = b"".join(report.digest for report in sorted(world.reports, key=lambda report: report.cell))
        return hashlib.sha256(bytes.fromhex(self.history) + digests).hexdigest()

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
        return json.dumps([self.worlds, self.generations, self.evaluations, messages, self.staleness, self.history])

    @staticmethod
    def from_json(text: str) -> "Past":
        """The inverse of `to_json`."""
        worlds, generations, evaluations, messages, staleness, history = json.loads(text)
        return Past(worlds, generations, evaluations, Messages(*messages), Staleness(*staleness), history)


def stopped_after(reports: Sequence[Report]) -> int:
    """The generation after which the cells stopped; in async mode the (lower) median."""
    return statistics.median_low(report.generation for report in reports)


def lived_for(reports: Sequence[Report], halted: bool) -> int:
    """Generations of a world. Where cells halted since one had died, the next world counts from the furthest."""
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
    together = {
        "do": "several",
        "world": older[-1]["world"],
        "generation": sum(directive["generation"] for directive in older),
        "fields": dict(item for directive in older for item in directive.get("fields", {}).items()),
    }
    return (json.dumps(together), *texts[half:])
