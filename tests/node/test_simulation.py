"""The simulator itself."""

import numpy as np
from one_max import plan_of

from node.engine.rows import Rows
from node.simulation import simulate
from wire.exchange import Messages


def digests(**run):
    return [report.digest for report in simulate(plan_of(**run))]


def test_the_same_seed_gives_the_same_run_and_another_another():
    for mode in ("lockstep", "async"):
        assert digests(seed=5, mode=mode) == digests(seed=5, mode=mode)
        assert digests(seed=5, mode=mode) != digests(seed=6, mode=mode)


def test_async_cells_end_at_different_generations_when_the_target_is_met():
    reports = simulate(plan_of(mode="async", size=30))
    assert min(report.champion.fitness for report in reports) == 0.0
    assert len({report.generation for report in reports}) > 1


def test_async_with_a_limit_ends_there_everywhere():
    reports = simulate(plan_of(mode="async", target=-1.0, generations=25))
    assert {report.generation for report in reports} == {25}


def test_the_first_demes_may_be_given_and_are_evaluated_anew():
    for mode in ("lockstep", "async"):
        plan = plan_of(mode=mode, deme=3, target=-1.0, generations=4)
        lived = simulate(plan)
        demes = np.stack([np.frombuffer(report.deme, np.uint8).reshape(3, -1) for report in lived])
        begun = simulate(plan_of(mode=mode, deme=3, target=-1.0, generations=0), demes=demes)
        assert [report.deme for report in begun] == [report.deme for report in lived]
        assert {report.evaluations for report in begun} == {3}
        assert [report.champion.fitness for report in begun] == plan.evaluate(demes.reshape(48, -1)).reshape(16, 3).min(
            axis=1
        ).tolist()
        simulate(plan, demes=demes)
        assert demes.tobytes() == b"".join(report.deme for report in lived), "what is given stays as it is"


def test_somebody_outside_can_stop_it():
    asked = iter([None] * 10 + ["cancel"] + [None] * 1000)
    for mode in ("lockstep", "async"):
        reports = simulate(plan_of(mode=mode, target=-1.0, seconds=1e6), outside=lambda: next(asked, "cancel"))
        assert {each.reason for report in reports for each in report.proposals} == {"cancel"}


def test_an_evaluation_limit_is_never_exceeded():
    for limit in (0, 15, 16, 143, 144, 145, 1000):
        reports = simulate(plan_of(target=-1.0, evaluations=limit))
        spent = sum(report.evaluations for report in reports)
        assert spent == max(16, 16 + (limit - 16) // 128 * 128)


def test_an_island_alone_is_not_flooded_with_its_own_best():
    plan = plan_of(size=200, topology="torus 1x1", deme=30, target=-1.0, generations=1, mutation=0.0)
    (report,) = simulate(plan)
    rows = Rows(plan, np.array([0]), Messages.room(1, plan.coding.genome_bytes, 1))
    rows.begin()
    rows.advance(None)
    assert report.deme == rows.genomes.tobytes(), "an exchange with itself changes nothing"
