"""The arithmetic of the model of many hosts; nothing here is timed."""

import pytest

from benchmarks.model_of_hosts import Start, at, first_limit


def test_what_starting_costs_is_a_straight_line():
    starts = [Start(nodes, 1.0 + 0.01 * nodes, 0.1 + 0.001 * nodes, 1e7 + 1e5 * nodes) for nodes in (16, 64, 256)]
    assert at(starts, 10_000) == pytest.approx((10_000, 101.0, 10.1, 1.01e9))


def test_what_is_met_first():
    assert first_limit(9_997) == "counters of a node come every 39 s"
    assert first_limit(9_998) == "one router has room for 9,997 nodes"
