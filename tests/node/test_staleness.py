"""How old the news is that cells breed with when they do not wait for each other."""

import pytest
from one_max import plan_of

from node.simulation import simulate
from wire.report import Staleness

NONE = Staleness(0, 0, 0, 0)


@pytest.mark.parametrize("interval", [1, 3])
@pytest.mark.parametrize("deme", [1, 4])
@pytest.mark.parametrize(("shape", "slots"), [("1x1", 0), ("1x2", 2), ("2x2", 4), ("2x3", 4), ("4x4", 4)])
def test_the_counts_fit_together(shape, slots, deme, interval):
    """``slots`` are those that name another cell."""
    settings = {"topology": f"torus {shape}", "deme": deme, "interval": interval, "target": -1.0, "generations": 60}
    for seed in range(3):
        reports = simulate(plan_of(mode="async", seed=seed, **settings))
        for report in reports:
            immigrants, behind, furthest, again = report.staleness
            assert immigrants <= slots * -(-60 // interval)
            assert 0 <= again <= immigrants
            assert furthest <= behind <= immigrants * furthest
            assert again <= immigrants - slots, "the first that comes to a slot is new"
        if slots:
            assert min(report.staleness.immigrants for report in reports) > slots * 60 // interval // 2
            assert sum(report.staleness.behind for report in reports) > 0
            assert sum(report.staleness.again for report in reports) > 0
        else:
            assert {report.staleness for report in reports} == {NONE}


@pytest.mark.parametrize("shape", ["1x1", "2x3", "4x4"])
def test_in_lockstep_nothing_is_ever_stale(shape):
    for spy in ("champion", "root"):
        reports = simulate(plan_of(topology=f"torus {shape}", spy=spy, target=-1.0, generations=30))
        assert {report.staleness for report in reports} == {NONE}
