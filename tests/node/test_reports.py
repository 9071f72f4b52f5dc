"""How often nodes tell their counters."""

import pytest

from wire.news import MOST_REPORTS_PER_SECOND, period_of_reports


@pytest.mark.parametrize("nodes", [1, 16, 255, 256, 257, 1024, 4096])
def test_at_most_once_a_second_and_so_many_a_second_in_all(nodes):
    period = period_of_reports(nodes)
    assert period >= 1.0
    assert nodes / period <= MOST_REPORTS_PER_SECOND
    assert period == 1.0 or nodes > MOST_REPORTS_PER_SECOND
