"""How often an address may do something."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from supernode.dashboard import limits
from supernode.dashboard.limits import Limit, subscriber


@given(st.floats(0.1, 50), st.integers(1, 20), st.lists(st.floats(0, 3), max_size=80))
def test_no_stretch_of_time_has_more_than_burst_and_rate_allow(rate, burst, pauses):
    now, done = 0.0, []
    limit = Limit(rate, burst, lambda: now)
    for pause in pauses:
        now += pause
        if limit.wait("one") == 0:
            limit.count("one")
            done.append(now)
    for first, begin in enumerate(done):
        for last in range(first, len(done)):
            assert last - first + 1 <= burst + rate * (done[last] - begin) + 1e-6


@given(st.floats(0.1, 50), st.integers(1, 20))
def test_whoever_waits_as_long_as_told_may_do_it_again(rate, burst):
    now = 5.0
    limit = Limit(rate, burst, lambda: now)
    for _ in range(burst):
        assert limit.wait("one") == 0
        limit.count("one")
    wait = limit.wait("one")
    assert wait == pytest.approx(1 / rate)
    assert limit.wait("other") == 0
    now += wait + 1e-9
    assert limit.wait("one") < 1e-6


def test_the_addresses_are_kept_in_bounded_memory_and_the_busy_ones_longest(monkeypatch):
    monkeypatch.setattr(limits, "_KEPT", 3)
    limit = Limit(1, 1, lambda: 0.0)
    for address in ("a", "b", "c", "a", "d", "e"):
        limit.count(address)
    assert list(limit._left) == ["a", "d", "e"]


@pytest.mark.parametrize(
    ("host", "counts"),
    [
        ("192.0.2.7", "192.0.2.7"),
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("::1", "::/64"),
    ],
)
def test_whoever_can_choose_an_address_counts_by_the_network(host, counts):
    assert subscriber(host) == counts
