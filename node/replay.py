"""Replay of a job in this process, through all epochs of the original run.

A result's directives record each change from outside, and after which generation it took effect: another epoch, the
replacement of a node that died, a stop. Restarts are recorded too. With them a lockstep run is repeated bit for bit.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

import topologies
from genetics import Fitness, Genomes
from node.plan import Plan, retry
from node.simulation import Outside, Snapshot, Watch, ignore, never, simulate
from node.suspects import Avoiding, Suspect
from problems import BadInput, ProblemFile
from problems.errors import shorten
from wire.report import Report

_INFEASIBLE = "infeasible"
_TURNS = ("update", "rewire", "replace", "resume", "retry")
_LOST = {
    "several": "it had so many epochs that the directives of the first ones were merged",
    "restart": "all its nodes died, and it began again",
}
"""Directives that lack what a replay needs, and why."""


@dataclass(frozen=True)
class Epoch:
    """One epoch of a job to replay, and how it ends.

    Attributes:
        number: the epoch's number in the job, from 0.
        file: the problem file of the epoch.
        since: generations of the job before the epoch.
        why: the directive that led to the epoch; empty for the first.
        left_at: the generation after which each cell leaves the epoch; None for the last epoch.
        last: the generation after which the epoch is stopped from outside; None if it ends by itself.
        donors: for each cell of the next epoch the cell of this one whose deme it gets; empty for the last epoch.
        infeasible: genomes that counted as infeasible, since evaluating them killed processes, each with the digest of
            its problem.
    """

    number: int
    file: ProblemFile
    since: int
    why: Mapping[str, Any]
    left_at: Mapping[int, int] | None = None
    last: int | None = None
    donors: Mapping[int, int] = field(default_factory=dict)
    infeasible: frozenset[Suspect] = frozenset()

    @property
    def is_fresh(self) -> bool:
        """Whether the epoch begins with new individuals."""
        return self.why.get("do") == "retry"

    @cached_property
    def plan(self) -> Plan:
        """The epoch's plan; if the problem is a user's own, this imports its module."""
        protection = Avoiding(self.infeasible, self.file.sha256) if self.infeasible else None
        return Plan.of(self.file, self.number, self.since, protection=protection)

    @cached_property
    def ending(self) -> Plan:
        """The epoch's plan with the stop from outside as its limit."""
        if self.last is None:
            return self.plan
        # A stop makes all cells end after the same generation, and so does a limit on generations.
        return replace(self.plan, run=self.file.with_run(generations=self.since + self.last).run)

    def retried(self, generation: int, fields: dict[str, Any]) -> "Epoch":
        """Return the epoch of another attempt, with changed ``fields``; this epoch ended after ``generation``.

        Raises:
            BadInput: if the problem does not accept these fields.
        """
        file = self.file.next_attempt(fields)
        why = retry(file, self.number + 1, fields)
        return Epoch(self.number + 1, file, self.since + generation, why, infeasible=self.infeasible)

    def live(
        self, demes: Genomes | None, watch: Watch = ignore, outside: Outside = never, snapshot: Snapshot = ignore
    ) -> list[Report]:
        """Run the epoch as the job's last one, from ``demes`` unless it is fresh; return the reports of all cells."""
        return simulate(self.ending, watch, snapshot, outside, None if self.is_fresh else demes)

    def leave(self, demes: Genomes | None) -> tuple[list[Report], Genomes]:
        """Run the epoch until all cells have left it; return their reports and the demes for the next epoch.

        Raises:
            BadInput: if the epoch ends before a cell is to leave it.
        """
        assert self.left_at is not None, "else nobody leaves it"
        leaving = _Leaving(self.left_at)
        reports = simulate(self.ending, snapshot=leaving.see, demes=None if self.is_fresh else demes)
        return reports, leaving.handed_on(self, reports[0].generation)


class Replayed(NamedTuple):
    """One epoch that has been replayed.

    Attributes:
        file: the problem file of the epoch.
        plan: the epoch's plan.
        reports: the reports of all cells.
        why: the directive that led to the epoch; empty for the first.
    """

    file: ProblemFile
    plan: Plan
    reports: list[Report]
    why: Mapping[str, Any]


def replay(
    file: ProblemFile,
    directives: Sequence[Mapping[str, Any]] = (),
    watch: Watch = ignore,
    outside: Outside = never,
) -> list[Replayed]:
    """Replay a job: run all its epochs, see `epochs_of` and `live`."""
    return live(epochs_of(file, directives), watch, outside)


def epochs_of(file: ProblemFile, directives: Sequence[Mapping[str, Any]] = ()) -> list[Epoch]:
    """Return the epochs of a job that begins with ``file`` and was changed by ``directives``.

    Raises:
        BadInput: if a directive is malformed, or the run cannot be repeated.
    """
    changes, stop, infeasible = _sorted(directives)
    if changes and file.run.mode != "lockstep":
        raise BadInput(f"directives: mode: expected lockstep, which alone can be repeated, found {file.run.mode}")
    epochs: list[Epoch] = []
    since, why = 0, dict[str, Any]()
    for number, change in enumerate(changes):
        cells = topologies.parse(file.run.topology).cells
        after = _after(change, file, cells)
        then = topologies.parse(after.run.topology).cells
        left_at, donors = _left_at(change, cells, then), _donors(change, cells, then)
        last = max(left_at.values())  # the others' demes are kept on the way, see `_Leaving`
        epochs.append(Epoch(number, file, since, why, left_at, last, donors, infeasible))
        file = after
        since, why = since + last, dict(change)
    return [*epochs, Epoch(len(epochs), file, since, why, last=stop, infeasible=infeasible)]


def live(epochs: Sequence[Epoch], watch: Watch = ignore, outside: Outside = never) -> list[Replayed]:
    """Run ``epochs`` one after another. ``watch`` and ``outside`` are called in the last one only.

    Raises:
        BadInput: if an epoch ends before it is to be left.
        EvaluationFailed: if the problem's code fails.
    """
    lived: list[Replayed] = []
    demes: Genomes | None = None
    for epoch in epochs:
        if epoch.left_at is None:
            reports = epoch.live(demes, watch, outside)
        else:
            reports, demes = epoch.leave(demes)
        lived.append(Replayed(epoch.file, epoch.plan, reports, epoch.why))
    return lived


class _Leaving:
    """Keeps the deme that each cell has when it leaves an epoch.

    When a node died, the cells left a few generations apart, so the simulation runs on to the last of them.
    """

    def __init__(self, left_at: Mapping[int, int]) -> None:
        self._cells_by_generation: dict[int, list[int]] = {}
        for cell, left in left_at.items():
            self._cells_by_generation.setdefault(left, []).append(cell)
        self._kept: dict[int, Genomes] = {}

    def see(self, generation: int, genomes: Genomes, _: Fitness) -> None:
        """Look at a generation of all cells; a `Snapshot`."""
        for cell in self._cells_by_generation.get(generation, ()):
            self._kept[cell] = genomes[cell].copy()

    def handed_on(self, epoch: Epoch, generation: int) -> Genomes:
        """Return the demes of all cells, (cells, deme, genome_bytes), of an epoch that ended after ``generation``.

        Raises:
            BadInput: if the epoch ended before a cell was to leave it.
        """
        if epoch.last is not None and generation < epoch.last:
            found = f"epoch {epoch.number} ends after generation {generation} already"
            raise BadInput(f"directives: expected cells to leave after generation {epoch.last}, but {found}")
        # A new node begins with its donor's deme, as the donor had it when it left.
        return np.stack([self._kept[donor] for _, donor in sorted(epoch.donors.items())])


# What directives say --------------------------------------------------------------------------------------------------
def _sorted(directives: Sequence[Mapping[str, Any]]) -> tuple[list[Mapping[str, Any]], int | None, frozenset[Suspect]]:
    """Sort directives by what they say.

    Returns:
        Those that lead to another epoch, the generation of the last epoch's stop, if any, and the genomes that counted
        as infeasible.
    """
    changes, stops, infeasible = [], [], set[Suspect]()
    for directive in directives:
        if not isinstance(directive, Mapping):
            raise BadInput(f"directives: expected tables, found {shorten(directive)}")
        kind = directive.get("do")
        if kind == "stop":
            stops.append(_count(directive, "generation"))
        elif kind == _INFEASIBLE:
            infeasible |= _genomes(directive)
        elif kind in _TURNS:
            changes.append(directive)
        elif isinstance(kind, str) and kind in _LOST:
            raise BadInput(f"directives: such a run cannot be repeated: {_LOST[kind]}")
        else:
            known = ", ".join(("stop", _INFEASIBLE, *_TURNS[:-1]))
            raise BadInput(f"directives: do: expected {known} or {_TURNS[-1]}, found {shorten(kind)}")
    return changes, min(stops, default=None), frozenset(infeasible)


def _genomes(directive: Mapping[str, Any]) -> set[Suspect]:
    problem, found = directive.get("problem_sha256"), directive.get("genomes")
    if not isinstance(problem, str):
        raise BadInput(f"directives: problem_sha256: expected a text, found {shorten(problem)}")
    try:
        return {(problem, bytes.fromhex(each)) for each in found}  # type: ignore[union-attr]
    except (TypeError, ValueError):
        raise BadInput(f"directives: genomes: expected hexadecimal texts, found {shorten(found)}") from None


def _after(change: Mapping[str, Any], file: ProblemFile, cells: int) -> ProblemFile:
    """Return the problem file of the epoch that the directive ``change`` leads to."""
    if change["do"] == "update":
        return file.changed(dict(_table(change, "fields")), {})
    if change["do"] == "retry":
        return file.next_attempt(dict(_table(change, "fields")))
    do = change["do"]
    topology = change.get("topology", file.run.topology if do == "replace" else None)
    if not isinstance(topology, str):
        raise BadInput(f"directives: topology: expected a text, found {shorten(topology)}")
    after = file.changed({}, {"topology": topology})
    found = topologies.parse(after.run.topology).cells
    if do != "resume" and (found < cells or (found > cells and do != "replace")):
        raise BadInput(f"directives: topology: expected one of {cells} cells, found {shorten(topology)}")
    return after


def _left_at(change: Mapping[str, Any], cells: int, then: int) -> dict[int, int]:
    """Return the generation after which each cell left the epoch, without cells whose node died.

    All cells leave after the same generation unless a node died or the torus grew, to ``then`` cells: then they were
    halted a few generations apart.
    """
    if change["do"] not in ("replace", "resume"):
        return dict.fromkeys(range(cells), _count(change, "generation"))
    left_at = dict(_by_cell(change, "generations", cells))
    missing = set(range(cells)) - left_at.keys() - dict(_by_cell(change, "demes_of", then)).keys()
    if missing or not left_at:
        raise BadInput(f"directives: generations: expected one for each cell, found none for {sorted(missing)}")
    return left_at


def _donors(change: Mapping[str, Any], cells: int, then: int) -> dict[int, int]:
    """Return for each cell of the next epoch the cell whose deme it got.

    It is another one for a cell that died and for one of a further row, and for any cell of a run that was resumed.
    """
    if change["do"] not in ("replace", "resume"):
        return {cell: cell for cell in range(cells)}
    donors = dict(_by_cell(change, "demes_of", then))
    living = dict(_by_cell(change, "generations", cells)).keys()
    if not living >= set(donors.values()) or (change["do"] == "replace" and living & donors.keys()):
        raise BadInput(f"directives: demes_of: expected dead cells, each with a living one, found {shorten(donors)}")
    donors = ({cell: cell for cell in living} if change["do"] == "replace" else {}) | donors
    if missing := set(range(then)) - donors.keys():
        raise BadInput(f"directives: demes_of: expected one for each further cell, found none for {sorted(missing)}")
    return donors


def _by_cell(change: Mapping[str, Any], name: str, cells: int) -> Iterator[tuple[int, int]]:
    """Return the entries of a table with cells as keys (texts in JSON) and counts as values."""
    table = _table(change, name)
    for cell in table:
        if not (str(cell).isdecimal() and int(cell) < cells):
            raise BadInput(f"directives: {name}: expected a cell below {cells}, found {shorten(cell)}")
        yield int(cell), _count(table, cell)


def _table(directive: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = directive.get(name)
    if not isinstance(found, Mapping):
        raise BadInput(f"directives: {name}: expected a table, found {shorten(found)}")
    return found


def _count(directive: Mapping[str, Any], name: str) -> int:
    found = directive.get(name)
    if type(found) is not int or found < 0:
        raise BadInput(f"directives: {name}: expected a whole number from 0 on, found {shorten(found)}")
    return found
