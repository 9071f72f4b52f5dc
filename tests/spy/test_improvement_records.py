"""The improvements of a run, from what its cells reported."""

import math

import pytest

from problems import ProblemFile, Run
from spy.improvement_records import ImprovementRecord, records_of, worth_telling
from spy.least_improvement import is_worth_telling
from spy.past import Lived, Past
from wire.champion import Champion
from wire.report import Birth, Report, Staleness


def report(cell, births=(), champion=None, generation=10, evaluations=84, error=None):
    births = tuple(Birth(born, cell, fitness) for born, fitness in births)
    counts = (evaluations, 8, 32, 0, 0, Staleness(0, 0, 0, 0))
    return Report(cell, generation, bytes(32), *counts, champion, (), births, b"", b"", error)


def lived(reports, number=0, folder=None, **run):
    settings = Run(topology="torus 1x2", deme=4, **run)
    return Lived(ProblemFile("x", {"kind": "x:Y"}, settings, folder), reports, number)


def test_only_what_was_better_than_all_before_is_a_record():
    reports = [report(0, [(0, 9.0), (2, 5.0), (7, 1.0)]), report(1, [(0, 8.0), (1, 6.0), (3, 5.5), (7, 1.0)])]
    assert records_of(Past(), lived(reports)) == [
        ImprovementRecord(0, 0, 1, 8, 8.0),
        ImprovementRecord(0, 1, 1, 24, 6.0),
        ImprovementRecord(0, 2, 0, 40, 5.0),
        ImprovementRecord(0, 7, 0, 120, 1.0),
    ]


def test_under_the_papers_spy_the_root_alone_is_asked():
    reports = [report(0, [(0, 9.0)]), report(1, [(0, 1.0)])]
    assert [each.fitness for each in records_of(Past(), lived(reports, spy="root"))] == [9.0]


def test_evaluations_go_on_from_epoch_to_epoch():
    past = Past(epochs=1, evaluations=1000)
    (record,) = records_of(past, lived([report(0, [(10, 2.0)]), report(1)], number=1))
    assert (record.epoch, record.evaluations) == (1, 1000 + 168)


def test_what_others_had_heard_of_a_cell_that_died_is_known():
    heard = Champion(3.0, 4, 1, b"x")
    found = records_of(Past(), lived([report(0, [(0, 9.0)], heard)]))
    assert [(each.generation, each.cell, each.fitness) for each in found] == [(0, 0, 9.0), (4, 1, 3.0)]


def test_a_cell_that_failed_says_nothing_of_evaluations():
    failed = report(0, [(0, 9.0)], evaluations=0, error="broken")
    assert records_of(Past(), lived([failed, report(1, [(5, 2.0)])]))[-1].evaluations == 88
    assert records_of(Past(), lived([failed]))[-1].evaluations == 8
    assert records_of(Past(), lived([])) == []


@pytest.mark.parametrize(
    ("before", "now", "least", "worth"),
    [
        (math.inf, 1e9, 0.5, True),
        (100.0, 99.95, 1e-3, False),
        (100.0, 99.85, 1e-3, True),
        (100.0, 99.999, 0.0, True),
        (100.0, 100.0, 0.0, False),
        (0.0, -1e-9, 1e-3, True),
        (-100.0, -100.05, 1e-3, False),
        (-100.0, -100.15, 1e-3, True),
        (1.0, 2.0, 0.0, False),
    ],
)
def test_what_is_worth_telling(before, now, least, worth):
    assert is_worth_telling(before, now, least) is worth


def test_first_and_last_of_each_epoch_are_told_whatever_they_improve():
    def record(epoch, fitness):
        return ImprovementRecord(epoch, 0, 0, 1, fitness)

    records = [record(0, 10 - 0.001 * step) for step in range(50)] + [record(1, 5.0), record(1, 4.9999)]
    told = [(each.epoch, each.fitness) for each in worth_telling(records, 1e-3)]
    assert told[0] == (0, 10.0)
    assert told[-3:] == [(0, 10 - 0.049), (1, 5.0), (1, 4.9999)]
    assert len(told) == 1 + 4 + 1 + 2
    assert worth_telling(records, 0.0) == records
