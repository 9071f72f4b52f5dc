"""News of the best individual reaches the root in time, in no extra message."""

import numpy as np
import pytest
from one_max import plan_of

from node.engine.rows import Rows
from node.simulation import simulate
from wire.exchange import Messages


@pytest.mark.parametrize("interval", [1, 3])
def test_the_root_knows_the_best_of_a_16_x_16_torus_within_the_diameter(interval):
    plan = plan_of(size=200, topology="torus 16x16", target=-1.0, generations=60, interval=interval, deme=2)
    in_time = (plan.topology.diameter + 1) * interval
    assert in_time == 17 * interval
    best_at, root_at = [], []
    simulate(
        plan,
        watch=lambda generation, champion: root_at.append((generation, champion)),
        snapshot=lambda generation, _, fitness: best_at.append(fitness.min()),
    )
    best_ever = np.minimum.accumulate(best_at)
    for generation in range(in_time, 61):
        known = min(champion.fitness for when, champion in root_at if when <= generation)
        assert known <= best_ever[generation - in_time]
    assert any(champion.cell != 0 for _, champion in root_at), "the news came from elsewhere"


def test_champions_cost_no_message():
    sent = {}
    for spy in ("champion", "root"):
        reports = simulate(plan_of(topology="torus 16x16", spy=spy, target=-1.0, generations=40))
        sent[spy] = {(report.sent, report.received) for report in reports}
    assert sent["champion"] == sent["root"] == {(40, 160)}


@pytest.mark.parametrize(("shape", "others"), [("1x1", 0), ("1x2", 1), ("2x2", 2), ("1x3", 2), ("2x3", 3), ("3x3", 4)])
def test_one_publication_and_one_receipt_for_each_distinct_neighbour(shape, others):
    reports = simulate(plan_of(topology=f"torus {shape}", target=-1.0, generations=10))
    assert {(report.sent, report.received, report.evaluations) for report in reports} == {(10, 10 * others, 81)}


def test_under_the_papers_spy_the_root_knows_only_what_came_past_it():
    settings = {"size": 200, "topology": "torus 8x8", "target": -1.0, "generations": 30, "mutation": 0.02}
    champion = simulate(plan_of(spy="champion", **settings))
    root = simulate(plan_of(spy="root", **settings))
    assert [report.digest for report in champion] == [report.digest for report in root], "the spy disturbs nothing"
    best = min(report.champion.fitness for report in root)
    assert champion[0].champion.fitness <= root[0].champion.fitness
    assert root[0].champion.fitness > best, "somewhere lives a better one that the root has not heard of"


def test_champions_are_ordered_by_fitness_then_generation_then_cell():
    plan = plan_of(size=8, topology="torus 3x3", mutation=0.0, target=-1.0, generations=50)
    rows = Rows(plan, np.arange(9), Messages.room(9, plan.coding.genome_bytes, 1))
    rows.begin()
    slots = np.array([plan.topology.neighbours(cell) for cell in range(9)])
    births = [(rows.fitness[cell, 0], 0, cell) for cell in range(9)]
    for generation in range(1, 30):
        rows.advance(rows.messages.copy(), slots)
        births += [(rows.fitness[cell, 0], generation, cell) for cell in range(9)]
    first = min(births)
    assert first[1] <= 29 - plan.stop_distance, "the best is old enough to be known everywhere"
    assert sum(birth[0] == first[0] for birth in births) > 9, "and has equals"
    assert {rows.messages.champion(row)[:3] for row in range(9)} == {first}


def test_an_infeasible_individual_is_no_champion():
    plan = plan_of(size=8, topology="torus 2x2", target=-1.0, generations=3)

    class Nothing(type(plan.problem)):
        def evaluate(self, genomes):
            return np.full(len(genomes), np.inf)

    nothing = type(plan)(Nothing(kind="nothing"), plan.run)
    assert [report.champion for report in simulate(nothing)] == [None] * 4
