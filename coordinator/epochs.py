"""The epochs that a job lives in: what the latest ones' cells have reported, and what all those before came to."""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import topologies
from coordinator.states import State
from problems import ProblemFile
from spy.past import Lived, Past, lived_for
from topologies import Topology
from wire.control import Wiring
from wire.report import Report


@dataclass
class Epoch:
    """What a conductor knows of one epoch.

    Attributes:
        since: generations of the job before it, as far as is known.
        reports: of the cells that have stopped.
        why: how it followed the one before, as a directive.
        rescued: whether, in async mode, all cells have been told to stop.
        dead: cells whose nodes have died in it.
        asked: the latest question for its reports.
        told: whether its improvements have been told.
    """

    number: int
    file: ProblemFile
    wiring: Wiring
    since: int = 0
    reports: dict[int, Report] = field(default_factory=dict)
    why: Mapping[str, Any] = field(default_factory=dict)
    rescued: bool = False
    dead: set[int] = field(default_factory=set)
    asked: int = -1
    told: bool = False

    @cached_property
    def topology(self) -> Topology:
        """Who neighbours whom."""
        return topologies.parse(self.file.run.topology)

    @property
    def cells(self) -> int:
        """How many it has."""
        return len(self.wiring.nodes)

    @property
    def is_fresh(self) -> bool:
        """Whether it begins with new individuals: another attempt."""
        return self.why.get("do") == "retry"

    @property
    def state(self) -> State:
        """Of the job while it is in it: one that is kept alive still searches, if it has stalled before."""
        return "searching" if self.file.run.keep_alive and self.file.attempt else "running"

    @property
    def stopped(self) -> bool:
        """Whether all cells have told of their end in it."""
        return len(self.reports) == self.cells

    @property
    def halted(self) -> bool:
        """Whether it did not stop by itself: a node died in it."""
        return bool(self.dead)

    @property
    def settled(self) -> bool:
        """Whether no cell is at it any more."""
        return self.stopped or self.halted

    @property
    def lived(self) -> Lived:
        """What is kept of it."""
        return Lived(self.file, list(self.reports.values()), self.number)


class Epochs:
    """The latest epoch of a job, and the one before it; what came before these is added up.

    Attributes:
        past: the epochs before.
        known: the others, the latest last.
    """

    def __init__(self, past: Past) -> None:
        self.past = past
        self.known: list[Epoch] = []

    def __bool__(self) -> bool:
        return bool(self.known)

    @property
    def latest(self) -> Epoch:
        """The one that the job is in, or goes to."""
        return self.known[-1]

    @property
    def unsettled(self) -> list[Epoch]:
        """Those that cells are at, the older one first."""
        return [epoch for epoch in self.known if not epoch.settled]

    @property
    def settled(self) -> bool:
        """Whether all cells have come to the latest epoch; before that there cannot be another one."""
        return all(epoch.settled for epoch in self.known[:-1])

    @property
    def since(self) -> int:
        """Generations of the job before the latest epoch."""
        known = [list(epoch.reports.values()) for epoch in self.known[:-1] if epoch.reports]
        return self.past.generations + sum(lived_for(reports, halted=False) for reports in known)

    def of(self, number: int) -> Epoch | None:
        """The one of that number, if it is one of the latest."""
        return next((epoch for epoch in self.known if epoch.number == number), None)

    def add(self, epoch: Epoch) -> None:
        """Another one follows; what those before came to is all that is kept of them, once nobody is at them."""
        stays = [before for before in self.known[-1:] if not before.settled]
        gone = self.known[: len(self.known) - len(stays)]
        for before, after in zip(gone, [*self.known[1:], epoch], strict=False):
            self.past = self.past.and_then(before.lived, after.why)
        self.known = [*stays, epoch]

    def take_over(self, epoch: Epoch) -> None:
        """It is known of a coordinator that died; how the one before it ended is still to be asked, perhaps."""
        before = [Epoch(epoch.number - 1, epoch.file, epoch.wiring)] if self.past.epochs < epoch.number else []
        self.known = [*before, epoch]

    def untold(self) -> Iterator[tuple[Past, Epoch]]:
        """Those that have ended since this was asked last, each with what there was before it."""
        past = self.past
        for epoch, after in itertools.zip_longest(self.known, self.known[1:]):
            if epoch.settled and not epoch.told:
                epoch.told = True
                yield past, epoch
            if after is not None:
                past = past.and_then(epoch.lived, after.why)

    def whole(self) -> tuple[Past, Lived]:
        """All before the latest, and the latest."""
        past = self.past
        for before, after in zip(self.known, self.known[1:], strict=False):
            past = past.and_then(before.lived, after.why)
        return past, self.latest.lived
