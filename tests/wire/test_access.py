"""Each role can send and receive its own messages and no others, over real links with real keys."""

import subprocess
import sys

import pytest
from places import ROOT

from benchmarks import access_matrix as matrix


@pytest.fixture(scope="module")
def keys():
    with matrix.authority() as folder:
        yield folder


def test_each_role_through_the_router_by_a_unix_socket(keys):
    table = matrix.through_the_router(keys, "unix")
    assert len(table) == len(matrix.ROLES) * len(matrix.ALLOWED)
    assert matrix.differences(table) == []


def test_each_role_through_the_router_by_tls_and_refusals_are_logged():
    command = [sys.executable, "-m", "benchmarks.access_matrix", "--link", "tls"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert done.stdout.endswith(f"\n{len(matrix.ROLES) * len(matrix.ALLOWED)} tries, all as they should be\n")


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
