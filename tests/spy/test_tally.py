"""What the counters of all nodes come to."""

import math

import pytest

from spy.tally import statistics_of
from wire.news import Counters


def counters(cell, *, median=2.0, digest=0, age=0):
    of_deme = (median - 1.0, median, median + 1.0)
    return Counters(cell + 10, cell, 1, 2, 5, 100, 20, 80, 1, 2, *of_deme, 1.0, age, digest, 0.25 * cell)


def test_sums_and_spread():
    news = statistics_of([counters(0, age=7), counters(1, median=4.0, digest=9), counters(2, median=3.0)], 1, 2, 6)
    assert (news.job, news.epoch, news.generation, news.nodes_alive) == (1, 2, 6, 3)
    assert (news.evaluations, news.messages, news.received, news.lost, news.rejected) == (300, 60, 240, 3, 6)
    assert (news.best, news.median, news.worst, news.age) == (1.0, 3.0, 5.0, 7)
    assert news.diversity == pytest.approx(2 / 3)
    assert news.exchange_seconds == 0.25


def test_before_any_node_has_told():
    news = statistics_of([], 1, 0, 0)
    assert (news.evaluations, news.best, news.worst, news.diversity) == (0, math.inf, math.inf, 0.0)
