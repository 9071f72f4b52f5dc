"""The epochs of a job: the reports of the latest ones, and a summary of all earlier ones.

At most two epochs have cells at work: the latest, and the one before it while its last cells finish. So a conductor
keeps these in full and adds up the others (`spy.past.Past`): a job that is kept alive may have thousands of epochs.
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import topologies
from coordinator.jobs.states import State
from problems import ProblemFile
from spy.past import Lived, Past, lived_for
from topologies import Topology
from wire.control import Wiring
from wire.report import Report


@dataclass
class Epoch:
    """The state of one epoch, as its conductor knows it.

    Attributes:
        number: the epoch's number, counted from 0 in each job.
        file: the problem and the run settings that hold in it.
        wiring: the nodes of the cells, and their links.
        since: the job's generations before this epoch, as far as they are known.
        reports: by cell, the reports of the cells that have stopped.
        why: the directive that says why this epoch followed the previous one; empty for a first epoch.
        rescued: whether a stop has been sent to all cells, not only to the root.
        dead: cells whose nodes died in this epoch.
        asked: the number of the latest question for reports of this epoch (see `Calls.ask_for_reports`).
        passed_on: whether its improvements have been passed on.
        wiring_is_known: whether ``wiring`` is the epoch's own; not if a coordinator before this one had left it.
        demes: by cell, the genomes that it begins with, as far as they are known.
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
    passed_on: bool = False
    wiring_is_known: bool = True
    demes: dict[int, bytes] = field(default_factory=dict)

    @cached_property
    def topology(self) -> Topology:
        """The neighbourhood of the cells."""
        return topologies.parse(self.file.run.topology)

    @property
    def cells(self) -> int:
        """The number of cells."""
        return len(self.wiring.nodes)

    @property
    def wiring_number(self) -> int | None:
        """The number of the epoch's wiring; None if it is not known."""
        return self.wiring.number if self.wiring_is_known else None

    @property
    def is_fresh(self) -> bool:
        """Whether this epoch is another attempt, which begins with new individuals."""
        return self.why.get("do") == "retry"

    @property
    def is_restart(self) -> bool:
        """Whether the job begins again with this epoch, since all its demes are lost."""
        return self.why.get("do") == "restart"

    @property
    def has_random_demes(self) -> bool:
        """Whether this epoch begins with new individuals."""
        return self.number == 0 or self.is_fresh or self.is_restart

    @property
    def state(self) -> State:
        """The job's state while it is in this epoch: "searching" if it is kept alive and has stalled before."""
        # An update begins with attempt 0 again, so it makes the job "running".
        return "searching" if self.file.run.keep_alive and self.file.attempt else "running"

    @property
    def stopped(self) -> bool:
        """Whether all cells have reported their end in this epoch."""
        return len(self.reports) == self.cells

    @property
    def has_halted_cells(self) -> bool:
        """Whether some living cell has halted where it was: the job can only go on in another epoch then."""
        return any(report.halted for cell, report in self.reports.items() if cell not in self.dead)

    @property
    def settled(self) -> bool:
        """Whether all cells have stopped in this epoch, or are halted because a node died."""
        return self.stopped or bool(self.dead)

    @property
    def last_demes(self) -> dict[int, bytes]:
        """By cell, the genomes with which it stopped in this epoch, as far as it has reported."""
        return {cell: report.deme for cell, report in self.reports.items()}

    @property
    def lived(self) -> Lived:
        """The part of this epoch that is kept after its end."""
        return Lived(self.file, list(self.reports.values()), self.number)


class Epochs:
    """The epochs of one job: the latest, perhaps the one before it, and the sum of all earlier ones.

    False as long as no epoch has begun. Only the conductor's thread changes it.

    Attributes:
        past: the sum of the earlier epochs.
        known: the other epochs, the latest last.
    """

    def __init__(self, past: Past) -> None:
        self.past = past
        self.known: list[Epoch] = []

    def __bool__(self) -> bool:
        return bool(self.known)

    @property
    def latest(self) -> Epoch:
        """The epoch that the job is in, or that its cells are moving to."""
        return self.known[-1]

    @property
    def unsettled(self) -> list[Epoch]:
        """The epochs that still have cells at work, the older one first."""
        return [epoch for epoch in self.known if not epoch.settled]

    @property
    def settled(self) -> bool:
        """Whether all cells have left the epochs before the latest one; a further epoch may begin only then."""
        return all(epoch.settled for epoch in self.known[:-1])

    def first_demes(self) -> Mapping[int, bytes]:
        """Return, by cell, the genomes with which the latest epoch began, as far as they are known."""
        if self.latest.has_random_demes or self.latest.demes or len(self.known) == 1:
            return self.latest.demes
        return self.known[-2].last_demes

    @property
    def since(self) -> int:
        """The job's generations before the latest epoch."""
        known = [list(epoch.reports.values()) for epoch in self.known[:-1] if epoch.reports]
        return self.past.generations + sum(lived_for(reports, halted=False) for reports in known)

    def of(self, number: int) -> Epoch | None:
        """Return the epoch of that number if it is still known in full; else None."""
        return next((epoch for epoch in self.known if epoch.number == number), None)

    def add(self, epoch: Epoch) -> None:
        """Make ``epoch`` the latest, and add the settled ones before it to `past`."""
        # Only the epoch that was the latest so far can have cells at work: see `settled`.
        stays = [before for before in self.known[-1:] if not before.settled]
        gone = self.known[: len(self.known) - len(stays)]
        # An epoch is summed up together with the directive of the one that followed it.
        for before, after in zip(gone, [*self.known[1:], epoch], strict=False):
            self.past = self.past.and_then(before.lived, after.why)
        self.known = [*stays, epoch]

    def take_over(self, epoch: Epoch) -> None:
        """Start from the latest ``epoch`` that the previous coordinator stored.

        If `past` lacks the epoch before it, cells may still be at work there or hold their reports of it. That epoch is
        then known too, with the settings of the latest: the old ones are not stored, and only its reports are awaited.
        """
        self.known = [epoch]
        if self.past.epochs < epoch.number:
            self.known.insert(0, Epoch(epoch.number - 1, epoch.file, epoch.wiring, wiring_is_known=False))

    def not_passed_on(self) -> Iterator[tuple[Past, Epoch]]:
        """Yield the epochs that have ended since the last call, each with the sum of those before it."""
        past = self.past
        for epoch, after in itertools.zip_longest(self.known, self.known[1:]):
            # A halted epoch is passed on too, with the reports of the cells that still had a node.
            if epoch.settled and not epoch.passed_on:
                epoch.passed_on = True
                yield past, epoch
            if after is not None:
                past = past.and_then(epoch.lived, after.why)

    def whole(self) -> tuple[Past, Lived]:
        """Return the sum of all epochs before the latest one, and the latest one."""
        past = self.past
        for before, after in zip(self.known, self.known[1:], strict=False):
            past = past.and_then(before.lived, after.why)
        return past, self.latest.lived
