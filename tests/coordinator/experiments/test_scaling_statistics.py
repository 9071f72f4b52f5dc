"""Intervals of scaling experiments: known cases, and what must hold of any sample."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coordinator.experiments import statistics

NUMBERS = st.lists(st.floats(1e-3, 1e6), min_size=2, max_size=12)


@settings(max_examples=25)
@given(NUMBERS)
def test_an_interval_holds_its_number_and_stays_within_the_sample(values):
    for estimate in (statistics.median(values), statistics.mean(values)):
        slack = 1e-9 * max(values)
        assert min(values) - slack <= estimate.low <= estimate.value + slack
        assert estimate.value - slack <= estimate.high <= max(values) + slack
        assert estimate.count == len(values)


@settings(max_examples=25)
@given(NUMBERS, NUMBERS)
def test_a_ratio_of_medians_lies_between_the_extreme_quotients(above, below):
    ratio = statistics.ratio_of_medians(above, below)
    assert min(above) / max(below) * 0.999 <= ratio.low <= ratio.high <= max(above) / min(below) * 1.001
    assert ratio.low <= ratio.value * 1.000001


@settings(max_examples=50)
@given(st.integers(1, 200), st.data())
def test_a_rate_of_success_is_never_certain(count, data):
    successes = data.draw(st.integers(0, count))
    rate = statistics.proportion(successes, count)
    assert 0.0 <= rate.low <= rate.value <= rate.high <= 1.0
    assert rate.high - rate.low > 0


@pytest.mark.parametrize(
    ("successes", "count", "low", "high"), [(5, 5, 0.5655, 1.0), (0, 10, 0.0, 0.2775), (81, 263, 0.2553, 0.3662)]
)
def test_wilson_intervals_as_published(successes, count, low, high):
    rate = statistics.proportion(successes, count)
    assert (rate.low, rate.high) == pytest.approx((low, high), abs=1e-4)


def test_a_constant_is_certain_and_repeats_give_the_same_interval():
    assert statistics.median([3.0] * 5) == statistics.Estimate(3.0, 3.0, 3.0, 5)
    assert statistics.ratio_of_medians([6.0, 6.0], [2.0, 2.0]) == statistics.Estimate(3.0, 3.0, 3.0, 2)
    values = [1.0, 2.0, 4.0, 8.0, 16.0]
    assert statistics.median(values) == statistics.median(values)


def test_the_interval_of_a_median_of_five_reaches_its_extremes():
    estimate = statistics.median([1.0, 2.0, 4.0, 8.0, 16.0])
    assert (estimate.value, estimate.low, estimate.high) == (4.0, 1.0, 16.0)


def test_one_value_has_no_interval_and_none_has_no_estimate():
    assert statistics.mean([2.0]) == statistics.Estimate(2.0, None, None, 1)
    assert not statistics.mean([2.0]).is_above(1.0)
    assert statistics.mean([]) is statistics.median([]) is statistics.proportion(0, 0) is None
    assert statistics.ratio_of_medians([], [1.0]) is None


def test_what_never_reached_the_target_is_dearer_than_anything():
    estimate = statistics.median([1.0, 2.0, math.inf])
    assert (estimate.value, estimate.low, estimate.high) == (2.0, 1.0, math.inf)
    assert statistics.median([1.0, math.inf, math.inf]).value == math.inf
    assert statistics.ratio_of_medians([1.0, 1.0], [1.0, math.inf, math.inf]) is None


def test_a_ratio_claims_nothing_where_neither_side_got_there():
    most_fail = [8.0, 8.0, 8.0, math.inf, math.inf]
    ratio = statistics.ratio_of_medians(most_fail, [1.0, 1.0, 1.0, math.inf, math.inf])
    assert ratio.value == 8.0
    assert ratio.low == 0.0


def test_division_keeps_the_interval():
    estimate = statistics.Estimate(8.0, 4.0, 16.0, 5).divided_by(4)
    assert estimate == statistics.Estimate(2.0, 1.0, 4.0, 5)
    assert not estimate.is_above(1.0)
    assert estimate.is_above(0.99)
