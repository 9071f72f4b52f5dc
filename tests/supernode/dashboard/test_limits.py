"""The address by which visitors are limited."""

import pytest

from supernode.dashboard.limits import subscriber


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
