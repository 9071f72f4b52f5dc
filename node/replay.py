"""The same job in this process, through all the worlds that a run of processes has lived in.

What came from outside, and after which generation, is what a result's directives say: another world, the replacement of
a dead node, a stop. With them a lockstep run is repeated bit for bit.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from genetics import Fitness, Genomes
from node.plan import Plan
from node.simulation import Outside, Watch, ignore, never, simulate
from problems import BadInput, ProblemFile
from wire.report import Report


class Replayed(NamedTuple):
    """One of the worlds.

    Attributes:
        reports: of all cells.
        why: the directive that led to it; empty for the first.
    """

    file: ProblemFile
    plan: Plan
    reports: list[Report]
    why: Mapping[str, Any]


class _Demes:
    """Of each cell the deme that it had when it left a world."""

    def __init__(self, left_at: Mapping[int, int]) -> None:
        self.left_at = left_at
        self.kept: dict[int, Genomes] = {}

    def see(self, generation: int, genomes: Genomes, _: Fitness) -> None:
        """A generation of all cells."""
        for cell, left in self.left_at.items():
            if left == generation:
                self.kept[cell] = genomes[cell].copy()


def replay(
    file: ProblemFile,
    directives: Sequence[Mapping[str, Any]] = (),
    watch: Watch = ignore,
    outside: Outside = never,
) -> list[Replayed]:
    """Live through all worlds.

    ``watch`` hears of champions of the last world only.

    Raises:
        BadInput: if a directive is none.
        EvaluationFailed: if the problem breaks.
    """
    turns = [each for each in directives if _kind(each) != "stop"]
    stops = [int(each["generation"]) for each in directives if _kind(each) == "stop"]
    lived: list[Replayed] = []
    since, demes, why = 0, None, dict[str, Any]()
    for world, turn in enumerate([*turns, None]):
        end = min(stops, default=None) if turn is None else _last_generation(turn)
        ending = file if end is None else file.with_run(generations=since + end)
        plan = Plan.of(ending, world, since)
        left = _Demes({} if turn is None else _left_at(turn, plan.topology.cells))
        last = turn is None
        reports = simulate(plan, watch if last else ignore, left.see, outside if last else never, demes)
        lived.append(Replayed(file, plan, reports, why))
        if turn is not None:
            demes = _handed_on(turn, left.kept)
            file = file.changed(turn.get("fields", {}), {name: turn[name] for name in ("topology",) if name in turn})
            since, why = since + _last_generation(turn), dict(turn)
    return lived


def _kind(directive: Mapping[str, Any]) -> str:
    kind = directive.get("do")
    if kind not in ("stop", "update", "rewire", "replace"):
        raise BadInput(f"directives: expected one to stop, update, rewire or replace, found {kind!r}")
    return str(kind)


def _last_generation(turn: Mapping[str, Any]) -> int:
    return max(_left_at(turn, 1).values())


def _left_at(turn: Mapping[str, Any], cells: int) -> dict[int, int]:
    """After which generation each cell left the world; when a node has died they are a few apart."""
    if "generations" in turn:
        return {int(cell): int(generation) for cell, generation in turn["generations"].items()}
    return dict.fromkeys(range(cells), int(turn["generation"]))


def _handed_on(turn: Mapping[str, Any], kept: dict[int, Genomes]) -> Genomes:
    """The demes of all cells, (cells, deme, genome_bytes); a new node has that of a neighbour."""
    if turn["do"] == "replace":
        kept |= {int(cell): kept[heir] for cell, heir in turn["demes_of"].items()}
    return np.stack([kept[cell] for cell in sorted(kept)])
