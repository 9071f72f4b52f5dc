"""Verdicts on speed-up: how often they hold, with distributions that are known."""

import math

import numpy as np
import pytest

from coordinator.experiments import comparison
from coordinator.experiments.comparison import FEWEST_SEEDS, compare, first_of, with_restarts

TRIALS = 300


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(comparison, "_REPLICATES", 399)


def samples(draws, median, runs=100):
    return (draws.exponential(median / math.log(2), runs)).tolist()


def coverage(truths, demes=(100.0,)):
    """How often all intervals hold, and how often anything is said to be super-linear."""
    held = claimed = 0
    for trial in range(TRIALS):
        draws = np.random.default_rng(trial)
        sequential = [samples(draws, deme) for deme in demes]
        found = compare(sequential, [samples(draws, min(demes) / truth) for truth in truths])
        held += all(
            each.efficiency.low <= truth <= each.efficiency.high for each, truth in zip(found, truths, strict=True)
        )
        claimed += any(each.verdict == "shown" for each in found)
    return held / TRIALS, claimed / TRIALS


def test_an_interval_of_a_hundred_runs_holds_as_often_as_it_says():
    held, claimed = coverage([1.0])
    assert 0.92 <= held <= 0.98
    assert claimed <= 0.05


def test_ten_intervals_hold_at_once_and_no_effect_is_hardly_ever_claimed():
    held, claimed = coverage([1.0] * 10)
    assert held >= 0.92
    assert claimed <= 0.06


def test_that_the_baseline_was_chosen_claims_nothing():
    _, claimed = coverage([1.0] * 3, demes=(100.0, 100.0, 100.0))
    assert claimed <= 0.05


def test_a_large_effect_is_shown_and_its_opposite_is_not():
    draws = np.random.default_rng(1)
    found = compare([samples(draws, 100.0)], [samples(draws, 20.0), samples(draws, 500.0), samples(draws, 95.0)])
    assert [each.verdict for each in found] == ["shown", "not shown", "undecided"]
    assert found[0].seeds is found[1].seeds is None
    assert found[2].seeds > 100, "more would decide"


def test_few_runs_decide_nothing_and_have_no_interval():
    (found,) = compare([[100.0] * 3], [[1.0] * 3])
    assert (found.verdict, found.seeds, found.efficiency.low) == ("undecided", FEWEST_SEEDS, None)
    assert found.efficiency.value == pytest.approx(100.0)


def test_where_half_of_the_runs_fail_nothing_is_known():
    failing = [1.0] * 10 + [math.inf] * 20
    for sequential, parallel in (([failing], [1.0] * 30), ([[1.0] * 30], failing)):
        (found,) = compare(sequential, [parallel])
        assert (found.efficiency, found.verdict) == (None, "undecided")
    assert compare([], [[1.0]])[0].efficiency is None


def test_the_first_of_many_independent_runs():
    costs = [float(cost) for cost in range(1, 1001)]
    assert first_of(costs, 1) == 500.0
    assert first_of(costs, 10) == pytest.approx(1000 * (1 - 0.5**0.1), abs=1.0)
    assert first_of([1.0, math.inf], 1) == 1.0


def test_restarts_help_where_a_few_runs_are_long_and_not_where_none_is():
    mean, cutoff = with_restarts([10.0] * 50 + [10_000.0] * 50)
    assert (mean, cutoff) == (20.0, 10.0)
    assert with_restarts([7.0] * 5) == (7.0, 7.0)
    assert with_restarts([10.0, math.inf]) == (20.0, 10.0)
    assert with_restarts([math.inf]) == (math.inf, math.inf)
