"""Records of a run's improvements by generation, computed from what its cells noted: no clock enters them.

While a run goes on, the spy receives only some of the improvements, and other ones in each repetition, since that
depends on when messages arrive. What cells report when they stop is the same for equal lockstep runs, simulated or on
processes, and so are these records.
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
    """An individual that was fitter than all that were born before it in its epoch.

    Attributes:
        epoch: the epoch in which it was born.
        generation: the generation of its birth, counted from the beginning of the epoch.
        cell: the cell on which it was born.
        evaluations: the fitness calls of all cells since the job began, up to the end of that generation.
        fitness: its fitness, lower is better, as its cell reports it and without a check.
    """

    epoch: int
    generation: int
    cell: int
    evaluations: int
    fitness: float


def records_of(past: Past, epoch: Lived) -> list[ImprovementRecord]:
    """Return every improvement of an epoch that has ended, in the order of births.

    Under the paper's spy only what the root learned of counts. In async mode cells are in different generations: the
    evaluations are those of all cells if each of them were in the generation of the birth.

    Args:
        past: the job's earlier epochs.
        epoch: the epoch with the reports of its cells. Of a cell without a report only those champions count that other
            cells learned of.
    """
    run = epoch.file.run
    tellers = [report for report in epoch.reports if run.spy == "champion" or report.cell == ROOT]
    first = topologies.parse(run.topology).cells * run.deme  # fitness calls of the first demes
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
    """Return the records that deserve a line in a log.

    These are the first and the last of each epoch, and those that are better than the last one returned before them by
    more than ``least``, a share of its fitness.
    """
    told: list[ImprovementRecord] = []
    for _, of_epoch in groupby(records, key=lambda record: record.epoch):
        one, *others = of_epoch
        told.append(one)
        for place, record in enumerate(others, 1):
            if place == len(others) or is_worth_telling(told[-1].fitness, record.fitness, least):
                told.append(record)
    return told


def _births(tellers: Sequence[Report]) -> Iterator[Birth]:
    """Yield all births that the reports know of: the noted ones, and each cell's last champion.

    A cell has room for a limited number of notes, so its champion may not be among them.
    """
    for report in tellers:
        yield from report.births
        if report.champion is not None:
            yield Birth(report.champion.generation, report.champion.cell, report.champion.fitness)


def _improvements(births: Iterable[Birth]) -> Iterator[Birth]:
    """Yield the births fitter than all before; of one generation the fittest only, of equals the lowest cell's."""
    best = math.inf
    for birth in sorted(births, key=lambda birth: (birth.generation, birth.fitness, birth.cell)):
        if birth.fitness < best:
            best = birth.fitness
            yield birth


def _evaluations_a_generation(reports: Sequence[Report], deme: int) -> int:
    """Return the fitness calls of one cell in a generation, the same for all cells; 0 if no report tells."""
    for report in reports:
        if report.error is None and report.generation > 0:
            return (report.evaluations - deme) // report.generation
    return 0
