"""Clusters whose nodes live in several places and join: the same results as in one, and hosts that come and go."""

import signal
from pathlib import Path

import pytest
from places import free_port, places, until

import supernode
from node import Plan, simulate
from spy.result import history_of

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "arm-ik.toml"
RUN = {"target": -1.0, "generations": 40, "seed": 5}


def file(topology):
    return supernode.load(EXAMPLE).with_run(topology=topology, **RUN)


def solved(client, problem):
    return client.submit(problem).result(60)


def expected(problem):
    return history_of(simulate(Plan.of(problem)))


@pytest.mark.parametrize("listens", [False, True], ids=["router", "direct"])
def test_a_job_on_two_hosts_is_bit_identical_to_a_simulation(listens):
    problem = file("torus 2x4")
    with places(8) as cluster:
        for name in ("upper", "lower"):
            settings = {"LISTEN": f"tcp/127.0.0.1:{free_port()}"} if listens else {}
            cluster.host(name, 4, **settings)
        with cluster.client() as client:
            result = solved(client, problem)
            assert {node["node"] for node in client.status()["nodes"]} == set(range(8))
    assert result["status"] == "exhausted"
    assert result["history_sha256"] == expected(problem)
    assert result["messages"]["lost"] == 0
