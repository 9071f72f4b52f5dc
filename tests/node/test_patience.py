"""When a lockstep cell asks for messages that have not come."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from node.patience import Patience


def asked(patience, began, until):
    """The times at which a cell asks that waits all the time."""
    found, now = [], began
    while (now := max(now, patience.due)) < until:
        if patience.is_over(now, began):
            found.append(now)
    return found


def test_a_cell_that_took_over_asks_soon_and_then_less_and_less_often():
    patience = Patience()
    patience.begin(0.0, took_over=True)
    assert patience.is_hasty
    assert asked(patience, 0.0, 8.0) == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4])
    assert not patience.is_hasty


def test_others_wait_for_a_second():
    patience = Patience()
    patience.begin(10.0, took_over=False)
    assert not patience.is_hasty
    assert asked(patience, 10.0, 16.0) == pytest.approx([11.0, 12.0, 14.0])


def test_where_each_exchange_takes_long_a_cell_waits_longer():
    patience = Patience()
    patience.begin(0.0, took_over=False)
    for _ in range(12):
        patience.note(0.0, 2.0)
    assert asked(patience, 0.0, 10.0) == pytest.approx([8.0])


@given(quick=st.floats(1e-5, 0.1), stall=st.floats(0.5, 100.0))
def test_one_that_took_long_changes_little(quick, stall):
    patience = Patience()
    patience.begin(0.0, took_over=False)
    for gap in (quick, quick, stall):
        patience.note(0.0, gap)
    assert asked(patience, 0.0, 1.5) == pytest.approx([1.0])


def test_a_cell_that_has_waited_long_and_goes_on_asks_in_time_for_the_next_message():
    patience = Patience()
    patience.begin(0.0, took_over=False)
    assert asked(patience, 0.0, 20.0)[-1] == pytest.approx(18.0)
    patience.note(19.0, 19.0)
    assert asked(patience, 19.0, 20.5) == pytest.approx([20.0])


def test_a_cell_that_waits_for_one_that_is_cut_off_still_asks_every_five_seconds():
    patience = Patience()
    patience.begin(0.0, took_over=False)
    assert asked(patience, 0.0, 24.0) == pytest.approx([1.0, 2.0, 4.0, 8.0, 13.0, 18.0, 23.0])
