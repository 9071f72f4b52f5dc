"""All cells stop after the same generation, whoever proposed it and in whatever order messages come."""

import random

import pytest
from one_max import Bus, plan_of

from node.simulation import simulate

SHAPES = ["torus 1x1", "torus 1x2", "torus 2x2", "torus 1x5", "torus 3x5", "torus 4x4"]
ENDS = {
    "target": {},
    "stall": {"target": -1.0, "stall": 7},
    "generations": {"target": -1.0, "generations": 9},
    "deadline": {"target": -1.0, "seconds": 1e6},
    "cancel": {"target": -1.0, "seconds": 1e6},
}


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("shape", SHAPES)
def test_every_cell_stops_after_the_same_generation(shape, end):
    for seed in range(12):
        settings = {"topology": shape, "deme": 1 + seed % 3, "interval": 1 + seed % 4, "seed": seed} | ENDS[end]
        plan = plan_of(size=12, mutation=0.1, **settings)
        request = (seed, end) if end in ("deadline", "cancel") else None
        reports = Bus(plan, random.Random(seed), request).run()
        stop = {report.generation for report in reports}
        assert len(stop) == 1, f"{shape}, {end}, seed {seed}: cells stopped after {sorted(stop)}"
        reasons = {each.reason for report in reports for each in report.proposals if each.stop_at in stop}
        assert reasons == ({end} if end != "generations" else set())


@pytest.mark.parametrize("shape", SHAPES)
def test_a_run_ended_by_the_clock_equals_simulate_of_its_generations(shape):
    for seed in range(6):
        settings = {"topology": shape, "deme": 1 + seed % 4, "interval": 1 + seed % 3, "seed": seed}
        ended = Bus(plan_of(target=-1.0, seconds=1e6, **settings), random.Random(seed), (3 * seed, "deadline")).run()
        replay = simulate(plan_of(target=-1.0, generations=ended[0].generation, **settings))
        assert [report.digest for report in ended] == [report.digest for report in replay]


def test_the_stop_is_as_early_as_the_news_can_be_everywhere():
    plan = plan_of(target=-1.0, seconds=1e6, topology="torus 5x4", interval=3)
    (stop,) = {report.generation for report in Bus(plan, random.Random(1), (10, "cancel")).run()}
    assert stop == 10 + (plan.topology.diameter + 1) * 3


@pytest.mark.parametrize("spy", ["champion", "root"])
@pytest.mark.parametrize("deme", [1, 5])
@pytest.mark.parametrize("shape", SHAPES)
def test_cells_on_a_bus_and_rows_in_the_simulator_report_the_same(shape, deme, spy):
    for seed in range(3):
        plan = plan_of(topology=shape, deme=deme, spy=spy, interval=1 + seed, seed=seed, stall=12, mutation=0.02)
        assert Bus(plan, random.Random(seed)).run() == simulate(plan)
