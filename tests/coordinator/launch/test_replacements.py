"""Processes of a cluster of one program are killed for real; others take their places, and the job goes on."""

import os
import signal

import epochs
import pytest
from places import until

import supernode
from node.replay import replay


@pytest.fixture(scope="module")
def cluster():
    with supernode.LocalCluster(torus=(2, 3)) as cluster:
        yield cluster


@pytest.fixture
def job(cluster, own_problem):
    file = supernode.load(own_problem("size = 4000")).with_run(topology="torus 2x3", stall=10**6)
    job = cluster.submit(file)
    next(job.improvements())
    yield job
    job.cancel()


@pytest.mark.parametrize("name", ["node 4", "node 0", "spy", "router"])
def test_whoever_is_killed_another_takes_the_place_and_the_job_goes_on(cluster, job, name):
    before = cluster.processes[name]
    os.kill(before, signal.SIGKILL)
    until(lambda: cluster.processes[name] != before)
    assert next(job.improvements()).fitness < 4000
    job.cancel()
    result = job.result(60)
    assert result.status == "cancelled"
    assert [each["do"] for each in result.directives] == ["stop"], "no epoch began: the cell went on where it was"
    assert epochs.history(replay(job.spec.file, result.directives)) == result.history_sha256


def test_the_next_job_has_all_nodes(cluster, own_problem):
    file = supernode.load(own_problem("size = 40")).with_run(topology="torus 2x3", generations=30, target=-1.0)
    assert cluster.submit(file).result(60).history_sha256 == supernode.simulate(file).history_sha256


def test_what_else_may_happen_at_a_death_is_refused():
    with pytest.raises(ValueError, match="on_node_death: expected replace or fail, found 'ignore'"):
        supernode.LocalCluster(on_node_death="ignore")


def test_a_node_that_is_stopped_for_too_long_counts_as_dead_and_one_that_goes_on_does_not(own_problem):
    with supernode.LocalCluster(torus=(1, 3), node_timeout=1.0) as cluster:
        file = supernode.load(own_problem("size = 4000")).with_run(topology="torus 1x3", stall=10**6)
        job = cluster.submit(file)
        next(job.improvements())
        before = cluster.processes
        os.kill(before["node 1"], signal.SIGSTOP)
        os.kill(before["node 1"], signal.SIGCONT)
        os.kill(before["node 2"], signal.SIGSTOP)
        until(lambda: cluster.processes["node 2"] != before["node 2"])
        assert cluster.processes["node 1"] == before["node 1"]
        assert next(job.improvements()).fitness < 4000
        job.cancel()
        assert job.result(60).status == "cancelled"
