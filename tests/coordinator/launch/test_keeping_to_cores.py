"""Nodes keep to their cores while they breed, and are free to go afterwards."""

import os
import signal
from pathlib import Path

import pytest
from live_service import live
from places import until

import supernode
from lowlevel import capabilities


@pytest.fixture(scope="module")
def two_cores():
    """Of sixteen nodes eight are on each, or all on one where there is but one."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(before)[:2])
    yield
    os.sched_setaffinity(0, before)


@pytest.fixture(scope="module")
def cluster(two_cores):
    with supernode.LocalCluster(torus=(4, 4)) as cluster:
        yield cluster


def cores_of(cluster):
    """For each node, in the order of the cells: the cores that its two threads may use; None while they differ."""
    return [_cores_of(cluster.processes[f"node {node}"]) for node in range(16)]


def _cores_of(node):
    threads = [node, *(int(each.name) for each in Path(f"/proc/{node}/task").iterdir() if _is_networks(each))]
    assert len(threads) == 2
    one, other = (frozenset(os.sched_getaffinity(thread)) for thread in threads)
    return one if one == other else None


def _is_networks(thread):
    """Zenoh has others for a while after the start."""
    try:
        return (thread / "comm").read_text() == "net-0\n"
    except OSError:  # it has just ended
        return False


def onemax(tmp_path, cost_us):
    path = tmp_path / "onemax.toml"
    path.write_text(f'kind = "function"\nname = "onemax"\ndimension = 64\ncost_us = {cost_us}\n')
    return supernode.load(path)


def generation_of(client, job):
    """That of its root, as was told last."""
    page = client.records("statistics", job.id)
    return page["rows"][-1][page["columns"].index("generation")] if page["rows"] else 0


takes_turns = pytest.mark.skipif(not capabilities().numba_calls, reason="only compiled generations take turns")
two_or_more = pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="there is one core to keep to")


@two_or_more
@pytest.mark.parametrize(("mode", "cost_us"), [("lockstep", 0), pytest.param("async", 1000, marks=takes_turns)])
def test_blocks_keep_to_a_core_for_as_long_as_a_job_runs(cluster, tmp_path, mode, cost_us):
    everywhere = cores_of(cluster)[0]
    assert cores_of(cluster) == [everywhere] * 16
    kept = [frozenset({core}) for core in sorted(everywhere) for _ in range(16 // len(everywhere))]
    job = cluster.submit(onemax(tmp_path, cost_us), mode=mode, target=-1.0, seconds=600)
    until(lambda: cores_of(cluster) == kept)
    job.cancel()
    job.result(timeout=30)
    until(lambda: cores_of(cluster) == [everywhere] * 16)


@takes_turns
def test_who_has_a_turn_of_many_generations_tells_the_last_of_them(cluster, tmp_path):
    # Sixteen generations in a turn: also beside other work, where a turn's time passes sooner, there are some.
    result = cluster.submit(onemax(tmp_path, 150), mode="async", target=-1.0, seconds=2).result()
    assert 0 < result.messages["sent"] < 16 * result.generations / 2
    assert result.messages["lost"] == 0


def test_the_last_individual_is_told_though_its_turn_is_not_over(cluster, tmp_path):
    result = cluster.submit(onemax(tmp_path, 500), mode="async", target=-1.0, generations=3).result()
    assert result.messages["sent"] == 16 * 3  # before the first generation, after it and after the second


@two_or_more
def test_those_of_a_core_are_killed_and_with_them_who_has_its_turn(two_cores, tmp_path):
    with live(tmp_path / "state") as service, service.connect() as client:
        job = client.submit(onemax(tmp_path, 500), mode="async", target=-1.0, seconds=600)
        until(lambda: generation_of(client, job))
        before, first = service.processes(), [f"node {node}" for node in range(8)]
        for name in first:
            os.kill(before[name], signal.SIGKILL)
        until(lambda: all(service.processes().get(name, before[name]) != before[name] for name in first))
        reached = generation_of(client, job)
        until(lambda: generation_of(client, job) > reached + 50)
        job.cancel()
        assert job.result(60).status == "cancelled"


def test_nodes_that_wait_for_each_other_after_long_generations_go_where_there_is_room(cluster, tmp_path):
    everywhere = cores_of(cluster)[0]
    job = cluster.submit(onemax(tmp_path, 1000), target=-1.0, generations=20)
    seen = {cores for _ in job.improvements() for cores in cores_of(cluster)}
    assert seen == {everywhere}
