"""What cells note of improvements: all that matters, in bounded room, the same in every way of running."""

import numpy as np
import pytest
from numba import njit
from one_max import Bus, plan_of

from node.engine import rows
from node.engine.kernels import NOTED_ALL, is_noted
from node.simulation import simulate
from problems import ProblemFile
from spy.improvement_records import records_of
from spy.past import Lived, Past
from wire.exchange_layout import BIRTHPLACE, BORN, HEADER
from wire.report import MOST_BIRTHS


def lived(plan, reports, tmp_path):
    return Lived(ProblemFile("x", {"kind": "onemax"}, plan.run, tmp_path), reports)


@njit
def _noted_of(fitness, header, noted, better_at, target_reporter):
    """Which of a cell's champions, born one a generation, it notes."""
    told = np.zeros(fitness.size, np.bool_)
    for now in range(fitness.size):
        header[BORN] = now
        told[now] = is_noted(header, fitness[now], better_at, 0, 0, now, target_reporter, noted)
    return told


def noted_of(fitness, target_reporter=-1, born_at=0, better_at=-1):
    header = np.zeros(HEADER, np.int64)
    header[BIRTHPLACE] = born_at
    fitness = np.array(fitness, float)
    return _noted_of(fitness, header, np.array([[np.inf, 0.0]]), np.array([better_at]), target_reporter)


def test_a_cell_notes_what_is_born_on_it_and_better_than_before():
    assert noted_of([5.0, 5.0, 4.0, 4.5, 3.0]).tolist() == [True, False, True, False, True]
    assert not noted_of([5.0, 4.0], born_at=3).any(), "another cell notes that"


def test_under_the_papers_spy_the_root_alone_notes_whatever_it_learned():
    assert noted_of([5.0], target_reporter=0, born_at=3, better_at=0).all()
    assert not noted_of([5.0], target_reporter=1, better_at=0).any()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_however_long_a_cell_improves_it_notes_no_more_than_there_is_room_for(sign):
    generations = np.arange(200_000)
    fitness = 1e9 * 0.9999**generations if sign > 0 else -(1.0001**generations)
    told = noted_of(fitness)
    assert told[:NOTED_ALL].all()
    assert NOTED_ALL < told.sum() <= MOST_BIRTHS
    assert noted_of(np.linspace(1e6, 1.0, 10**6)).sum() <= MOST_BIRTHS


@pytest.mark.parametrize("spy", ["champion", "root"])
@pytest.mark.parametrize("deme", [1, 5])
def test_of_more_cells_than_there_can_be_processes_the_best_of_each_generation_is_enough(
    monkeypatch, tmp_path, spy, deme
):
    plan = plan_of(size=60, topology="torus 4x5", spy=spy, deme=deme, target=-1.0, generations=30)
    whole = simulate(plan)
    monkeypatch.setattr(rows, "MOST_TOLD", 1)
    few = simulate(plan)
    assert sum(len(report.births) for report in few) < sum(len(report.births) for report in whole) or spy == "root"
    found, again = (records_of(Past(), lived(plan, reports, tmp_path)) for reports in (whole, few))
    assert found == again
    assert len(found) > 5


def test_every_best_of_the_simulation_has_a_record(tmp_path):
    """Against what a bystander sees of all demes."""
    plan = plan_of(size=60, topology="torus 3x4", deme=4, target=-1.0, generations=40)
    best, expected = np.inf, []

    def look(generation, genomes, fitness):
        nonlocal best
        if fitness.min() < best:
            best = fitness.min()
            expected.append((generation, int(fitness.min(axis=1).argmin()), best))

    reports = simulate(plan, snapshot=look)
    found = records_of(Past(), lived(plan, reports, tmp_path))
    assert [(each.generation, each.cell, each.fitness) for each in found] == expected
    each = plan.evaluations_per_generation
    assert [each_.evaluations for each_ in found] == [12 * (4 + each * generation) for generation, *_ in expected]


@pytest.mark.parametrize("mode", ["lockstep", "async"])
def test_the_last_record_is_the_best_that_any_cell_knows(tmp_path, mode):
    import random

    plan = plan_of(size=60, topology="torus 3x3", mode=mode, target=-1.0, generations=25)
    reports = Bus(plan, random.Random(1)).run()
    best = min(report.champion for report in reports)
    last = records_of(Past(), lived(plan, reports, tmp_path))[-1]
    assert (last.fitness, last.generation, last.cell) == best[:3]
