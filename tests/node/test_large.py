"""What the simulator does for the sake of large tori changes nothing: blocks of rows, digests, reports."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

from genetics import breeding
from node.engine.history import History
from node.plan import Plan
from node.simulation import simulate
from problems.file import parse

LARGE = "torus 100x90"  # more rows than any block has


def plan_of(size=40, **run):
    file = parse(f'kind = "function"\nname = "onemax"\ndimension = {size}\n', "large", Path())
    return Plan.of(file.with_run(**run))


def digests_by_hand(plan):
    """SHA-256 of (generation, genomes, fitness) of each generation, cell by cell."""
    digests = [hashlib.sha256() for _ in range(plan.topology.cells)]

    def note(generation, genomes, fitness):
        for digest, genome, value in zip(digests, genomes, fitness, strict=True):
            digest.update(np.int64(generation).tobytes() + genome.tobytes() + value.tobytes())

    reports = simulate(plan, snapshot=note)
    return reports, [digest.digest() for digest in digests]


@pytest.mark.parametrize("settings", [{}, {"deme": 3}, {"topology": "torus 5x7"}, {"topology": "torus 1x1", "deme": 2}])
def test_a_digest_is_that_of_the_generations_one_after_the_other(settings):
    plan = plan_of(**{"topology": LARGE, "target": -1.0, "generations": 3} | settings)
    reports, expected = digests_by_hand(plan)
    assert [report.digest for report in reports] == expected


@pytest.mark.parametrize("rows", [1, 3, 64, 65, 1025])
def test_a_history_of_any_number_of_rows_is_that_of_each_alone(rows, random_source):
    together, apart = History(rows, 2, 3), [History(1, 2, 3) for _ in range(rows)]
    for generation in range(5):
        genomes = np.frombuffer(bytearray(random_source.randbytes(rows * 6)), np.uint8).reshape(rows, 2, 3)
        fitness = np.frombuffer(random_source.randbytes(rows * 16), np.uint8).astype(float)[: rows * 2].reshape(rows, 2)
        together.note(generation, genomes, fitness)
        for row, alone in enumerate(apart):
            alone.note(generation, genomes[row : row + 1], fitness[row : row + 1])
    assert together.digests() == [alone.digests()[0] for alone in apart]


@pytest.mark.parametrize(
    "settings",
    [{}, {"deme": 4}, {"deme": 5, "emigrants": 2, "interval": 2}, {"interval": 3}, {"deme": 4, "mutation": "one-bit"}],
)
def test_blocks_of_any_size_breed_the_same(settings, monkeypatch):
    plan = plan_of(**{"topology": "torus 6x7", "target": -1.0, "generations": 8} | settings)
    expected = simulate(plan)
    for together in (1, 9, 40):
        monkeypatch.setattr(breeding, "_TOGETHER", together)
        assert simulate(plan) == expected


def test_where_batches_may_differ_every_row_is_evaluated_by_itself(own_problem):
    path = own_problem()
    plan = Plan.of(parse(path.read_text(), "own", path.parent).with_run(topology="torus 3x4", generations=3, target=-1))
    batches = []
    evaluate = plan.evaluate
    plan.__dict__["evaluate"] = lambda genomes: batches.append(len(genomes)) or evaluate(genomes)
    simulate(plan)
    assert batches == [1] * 12 + [8] * 36


def test_cells_report_what_they_would_report_alone():
    plan = plan_of(topology="torus 3x5", size=30, seed=4)
    last = {}
    reports = simulate(
        plan, snapshot=lambda generation, genomes, _: last.update(genomes=genomes, generation=generation)
    )
    for cell, report in enumerate(reports):
        others = set(plan.topology.neighbours(cell)) - {cell}
        assert report.cell == cell
        assert report.generation == last["generation"]
        assert report.deme == last["genomes"][cell].tobytes()
        assert report.received == report.sent * len(others)
        assert {each.cell for each in report.proposals} <= {cell}
    assert any(report.proposals for report in reports)


@pytest.mark.parametrize(("shape", "others"), [("1x1", 0), ("1x2", 1), ("1x3", 2), ("2x2", 2), ("2x3", 3), ("3x3", 4)])
def test_messages_come_from_each_other_neighbour_once(shape, others):
    reports = simulate(plan_of(topology=f"torus {shape}", target=-1.0, generations=5))
    assert {report.received for report in reports} == {5 * others}
