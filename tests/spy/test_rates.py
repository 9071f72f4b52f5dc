"""Messages a second, as the spy reckons them from what nodes tell now and then."""

import pytest

from spy.process import _Assignment
from wire.news import Counters


def told(node, sent):
    return Counters(node, node, 1, 0, sent, 0, sent, 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0)


@pytest.fixture
def assignment():
    return _Assignment(1, None, "", None, None, None, None)


def test_they_are_those_since_a_node_told_last(assignment):
    assignment.hear(told(0, 100), 10.0)
    assert assignment.rates == {}, "nothing is known yet"
    assignment.hear(told(1, 50), 10.0)
    assignment.hear(told(0, 160), 12.0)
    assignment.hear(told(1, 60), 11.0)
    assert assignment.rates == {0: 30.0, 1: 10.0}


def test_another_process_on_a_node_counts_anew(assignment):
    assignment.hear(told(0, 1000), 10.0)
    assignment.hear(told(0, 40), 11.0)
    assert assignment.rates == {0: 0.0}, "none that were not sent, nor fewer than none"
    assignment.hear(told(0, 90), 12.0)
    assert assignment.rates == {0: 50.0}
