"""The improvements of a run by generation, from what its cells noted: a function of the run, without a clock in it.

The spy hears of a part of the improvements only, another part each time, since messages come as they come. What cells
report when they stop is the same for equal lockstep runs, simulated or on processes, and so are these records.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

import topologies
from spy.least_improvement import is_worth_telling
from spy.past import Lived, Past
from topologies import ROOT
from wire.report import Birth, Report


class ImprovementRecord(NamedTuple):
    """An individual that was better than all of its epoch that were born before.

    Attributes:
        epoch: in which it was born.
        generation: of its birth, counted from the beginning of the epoch.
        cell: of its birth.
        evaluations: of all cells since the job began, up to the end of that generation.
        fitness: of it, lower is better; as its cell says, without a check.
    """

    epoch: int
    generation: int
    cell: int
    evaluations: int
    fitness: float


def records_of(past: Past, epoch: Lived) -> list[ImprovementRecord]:
    """Every improvement of an epoch that has ended, in the order of their births.

    Under the paper's spy only what the root learned of counts. In async mode cells are not in the same generation: the
    evaluations are those that all cells have made when each of them is there.

    Args:
        past: what the job had lived through before.
        epoch: with the reports of its cells. Of a cell without one, nothing is known but what others had heard of it.
    """
    run = epoch.file.run
    tellers = [report for report in epoch.reports if run.spy == "champion" or report.cell == ROOT]
    first = topologies.parse(run.topology).cells * run.deme
    each = _evaluations_a_generation(epoch.reports, run.deme) * topologies.parse(run.topology).cells
    return [
        ImprovementRecord(
            epoch.number,
            birth.generation,
            birth.cell,
            past.evaluations + first + birth.generation * each,
            birth.fitness,
        )
        for birth in _improvements(_births(tellers))
    ]


def worth_telling(records: Iterable[ImprovementRecord], least: float) -> list[ImprovementRecord]:
    """Of each epoch the first and the last record, and those that are better by ``least`` than the one told before."""
    told: list[ImprovementRecord] = []
    for _, of_epoch in groupby(records, key=lambda record: record.epoch):
        one, *others = of_epoch
        told.append(one)
        for place, record in enumerate(others, 1):
            if place == len(others) or is_worth_telling(told[-1].fitness, record.fitness, least):
                told.append(record)
    return told


def _births(tellers: Sequence[Report]) -> Iterator[Birth]:
    """All that is known of; the champions are what cells know in the end, whatever they had room to note."""
    for report in tellers:
        yield from report.births
        if report.champion is not None:
            yield Birth(report.champion.generation, report.champion.cell, report.champion.fitness)


def _improvements(births: Iterable[Birth]) -> Iterator[Birth]:
    """Those that were better than all before them; of one generation only the best, of equals the lowest cell's."""
    best = math.inf
    for birth in sorted(births, key=lambda birth: (birth.generation, birth.fitness, birth.cell)):
        if birth.fitness < best:
            best = birth.fitness
            yield birth


def _evaluations_a_generation(reports: Sequence[Report], deme: int) -> int:
    """Of one cell; the same for all. 0 if no cell has come to a first generation, or says so."""
    for report in reports:
        if report.error is None and report.generation > 0:
            return (report.evaluations - deme) // report.generation
    return 0
