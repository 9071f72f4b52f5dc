"""Each role can send and receive its own messages and no others, over real links with real keys."""

import pytest

from benchmarks import access_matrix as matrix


@pytest.fixture(scope="module")
def keys():
    with matrix.authority() as folder:
        yield folder


@pytest.mark.parametrize("link", ["unix", "tls"])
def test_each_role_through_the_router(keys, link):
    table = matrix.through_the_router(keys, link)
    assert len(table) == len(matrix.ROLES) * len(matrix.ALLOWED)
    assert matrix.differences(table) == []


def test_quic_is_as_strict(keys):
    messages = ["ask jobs/OWN/watch", "ask jobs/OWN/submit", "publish best", "hear best", "live coordinator"]
    table = matrix.through_the_router(keys, "quic", ("client", "watcher", "revoked"), messages)
    assert len(table) == 15
    assert matrix.differences(table) == []


def test_a_direct_link_is_for_the_nodes_of_the_host_that_is_expected_there(keys):
    table = matrix.directly(keys, "tls", ("node", "client"))
    assert len(table) == 2 * len(matrix.DIRECT)
    assert matrix.differences(table) == []


def test_a_difference_is_told():
    table = {("tls", "publish best", "client"): True, ("unix", "publish best", "client"): True}
    assert matrix.differences(table) == [
        "tls: publish best by client: expected that it is refused, found that it passes"
    ]
