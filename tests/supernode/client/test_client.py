"""Clients against a coordinator that does what the test tells it; see test_served_jobs.py for the real one."""

import asyncio
import gc
import json
import math
import os
import threading
import time

import pytest

import supernode
from supernode.client.cluster_info import ClusterInfo, write_info


@pytest.fixture
def client(service):
    with supernode.connect(service.endpoint) as client:
        yield client


def later(seconds, *steps):
    def run():
        for step in steps:
            time.sleep(seconds)
            step()

    thread = threading.Thread(target=run)
    thread.start()
    return thread


def test_submit_improvements_and_result(service, client, file):
    job = client.submit(file, id="a", priority=2, seed=4)
    assert (job.id, job.state()) == ("a", "queued")
    assert json.loads(service.jobs["a"]["file"])[2]["seed"] == 4
    assert service.jobs["a"]["priority"] == 2
    later(0.02, lambda: service.tell("a", "running"), *(lambda f=f: service.improve("a", f) for f in (9, 4, 0)),
          lambda: service.end("a"))  # fmt: skip
    assert [better.fitness for better in job.improvements()] == [9.0, 4.0, 0.0]
    assert [better.fitness for better in job.improvements()] == [9.0, 4.0, 0.0], "whoever asks again gets all again"
    result = job.result()
    assert (result.status, result.fitness, result.job) == ("solved", 0.0, "a")
    assert job.answer().fitness == 0.0


def test_improvements_between_submit_and_listening_are_not_lost(service, client, file):
    job = client.submit(file)
    for fitness in (9, 4, 2):
        service.improve(job.id, fitness)
    time.sleep(0.2)
    service.end(job.id)
    assert [better.fitness for better in job.improvements()] == [9.0, 4.0, 2.0]


def test_whoever_listens_to_improvements_gets_those_of_all_jobs_decoded(service, file):
    async def heard():
        all_of_them = asyncio.Queue()
        async with await supernode.connect_async(service.endpoint) as client:
            client.listen_to_improvements(all_of_them.put_nowait)
            for job in ("a", "b"):
                await client.submit(file, id=job)
                service.improve(job, 4)
            return [await asyncio.wait_for(all_of_them.get(), 20) for _ in range(2)]

    assert [(better.job, better.fitness) for better in asyncio.run(heard())] == [(1, 4.0), (2, 4.0)]


def test_a_job_of_somebody_else_begins_with_the_best_so_far(service, client, file):
    client.submit(file, id="a")
    service.quiet = True
    service.improve("a", 5)
    service.quiet = False
    with supernode.connect(service.endpoint) as other:
        job = other.job("a")
        later(0.1, lambda: service.improve("a", 3), lambda: service.end("a"))
        assert [better.fitness for better in job.improvements()] == [5.0, 3.0]


def test_two_clients_see_the_same_in_the_same_order(service, client, file):
    job = client.submit(file, id="a")
    with supernode.connect(service.endpoint) as other:
        same = other.job("a")
        for fitness in range(50, 0, -1):
            service.improve("a", fitness)
        service.end("a")
        assert list(job.improvements()) == list(same.improvements())
        assert len(list(job.improvements())) == 50


def test_what_is_never_published_is_asked_for(service, client, file):
    job = client.submit(file, id="a")
    service.quiet = True
    later(0.3, lambda: service.improve("a", 6), lambda: service.improve("a", 1), lambda: service.end("a"))
    began = time.monotonic()
    assert [better.fitness for better in job.improvements()][-1] == 1.0
    assert job.result().status == "solved"
    assert time.monotonic() - began < 4


def test_the_coordinator_may_be_restarted_meanwhile(service, client, file):
    job = client.submit(file, id="a")
    service.improve("a", 7)
    service.stop()
    later(0.5, lambda: service.improve("a", 3), lambda: service.end("a"), service.start)
    assert [better.fitness for better in job.improvements()] == [7.0, 3.0]
    assert client.submit(file, id="a").result().status == "solved"


def test_the_router_may_be_restarted_meanwhile(service, client, file):
    job = client.submit(file, id="a")
    service.improve("a", 7)
    service.stop()
    service.stop_router()
    later(0.5, service.start_router, service.start, lambda: service.improve("a", 3), lambda: service.end("a"))
    assert [better.fitness for better in job.improvements()] == [7.0, 3.0]
    service.tell("a", "solved")


def test_a_request_waits_for_a_coordinator_that_comes_back(service, client):
    service.stop()
    later(0.5, service.start)
    assert client.status()["cluster"] == "fake"


def test_the_answer_comes_at_the_deadline_or_when_the_job_waits(service, client, file):
    job = client.submit(file, id="a")
    assert job.answer(0.1) is None
    service.improve("a", 5)
    time.sleep(0.1)
    began = time.monotonic()
    assert job.answer(0.2).fitness == 5.0
    assert 0.19 < time.monotonic() - began < 0.25
    later(0.1, lambda: service.improve("a", 2), lambda: service.tell("a", "waiting"))
    assert job.answer().fitness == 2.0
    epoch = job.update({"goal": [1, 2]}, start=[0, 0])
    assert epoch == 1
    assert json.loads(service.jobs["a"]["epochs"][0]) == {"goal": [1, 2], "start": [0, 0]}
    later(0.1, lambda: service.tell("a", "running"), lambda: service.improve("a", 8, epoch=1),
          lambda: service.tell("a", "waiting"))  # fmt: skip
    assert job.answer().fitness == 8.0
    assert job.rewire("ring 16") == 2


def test_an_answer_is_feasible_and_of_a_job_that_searches_it_takes_its_time(service, client, file):
    job = client.submit(file, id="a")
    service.tell("a", "running")
    service.improve("a", 5, feasible=False)
    service.tell("a", "searching")
    began = time.monotonic()
    assert job.answer(0.3) is None
    assert time.monotonic() - began >= 0.29
    service.improve("a", 4, epoch=1)
    service.improve("a", 3, epoch=1, feasible=False)
    assert job.answer(0.2).fitness == 4.0, "the best that the check accepts"
    later(0.2, lambda: service.improve("a", 0, epoch=2), lambda: service.tell("a", "waiting"))
    assert job.answer().fitness == 0.0
    assert job.update(goal=[1, 2]) == 1


def test_what_happens_to_a_job_that_is_kept_alive(service, client, file):
    job = client.submit(file, id="a")
    steps = [
        lambda: service.tell("a", "running"),
        lambda: service.improve("a", 5),
        lambda: service.tell("a", "searching"),
        lambda: service.improve("a", 0, epoch=1),
        lambda: service.tell("a", "waiting"),
        lambda: service.end("a", "cancelled"),
    ]
    later(0.1, *steps)
    told = [event if isinstance(event, str) else event.fitness for event in job.events()]
    assert [event for event in told if event != "queued"] == ["running", 5.0, "searching", 0.0, "waiting"]


def test_an_update_from_a_file_takes_what_that_names_from_beside_it(service, client, file, tmp_path):
    job = client.submit(file, id="a")
    service.jobs["a"]["file_now"] = json.dumps(["x.toml", {"kind": "terrain"}, {}, "/"])
    (tmp_path / "moved.map").write_text("type octile\nheight 2\nwidth 3\nmap\n.@.\n..T\n")
    path = tmp_path / "patch.toml"
    path.write_text('file = "moved.map"\ngoal = [0, 2]\n')
    assert job.update(path, start=[1, 0]) == 1
    assert json.loads(service.jobs["a"]["epochs"][0]) == {"goal": [0, 2], "map": [".@.", "..T"], "start": [1, 0]}
    path.write_text('file = "none.map"\n')
    with pytest.raises(supernode.BadInput, match=r"^\S+patch.toml: file: expected a map, found no such file as "):
        job.update(str(path))
    service.jobs["a"]["file_now"] = json.dumps(["x.toml", {"kind": "my_module:Mine"}, {}, "/"])
    assert job.update(path) == 2
    assert json.loads(service.jobs["a"]["epochs"][1]) == {"file": "none.map"}


def test_angles_of_an_update_from_a_file_are_in_the_unit_of_the_problem_file(service, client, file, tmp_path):
    job = client.submit(file, id="a")
    fields = {"kind": "mobile-robot", "written_in": "deg"}
    service.jobs["a"]["file_now"] = json.dumps(["x.toml", fields, {}, "/"])
    path = tmp_path / "patch.toml"
    path.write_text("goal = [1.0, 2.0, 180.0]\n")
    job.update(path)
    assert json.loads(service.jobs["a"]["epochs"][0]) == {"goal": [1.0, 2.0, math.pi]}
    path.write_text('unit = "rad"\ngoal = [1.0, 2.0, 1.5]\n')
    job.update(path)
    assert json.loads(service.jobs["a"]["epochs"][1]) == {"unit": "rad", "goal": [1.0, 2.0, 1.5]}


def test_cancel_and_timeouts(service, client, file):
    job = client.submit(file, id="a")
    with pytest.raises(TimeoutError, match=r"job a has not ended within 0\.1 s"):
        job.result(0.1)
    assert job.cancel() == "queued"
    assert job.result(5).status == "cancelled"


def test_refusals(service, client, file):
    with pytest.raises(supernode.BadInput, match="there is no job 'none'"):
        client.job("none")
    with pytest.raises(supernode.BadInput, match="expected a job's id"):
        client.job("no such id")
    client.submit(file, id="a")
    with pytest.raises(supernode.BadInput, match="another problem"):
        client.submit(file, id="a", seed=9)
    with pytest.raises(supernode.BadInput, match="deme"):
        client.submit(file, deme=0)
    with pytest.raises(supernode.BadInput, match="plain values"):
        client.job("a").update(goal=float("nan"))
    assert [each["job"] for each in client.jobs()] == ["a"]


def test_where_no_cluster_answers_there_is_an_error_within_two_seconds(service, tmp_path):
    service.stop()
    for place in (service.endpoint, f"unixsock-stream/{tmp_path}/none.sock", "tcp/127.0.0.1:9"):
        began = time.monotonic()
        with pytest.raises(supernode.ClusterFailed, match="no cluster answers at"):
            supernode.connect(place)
        assert time.monotonic() - began < 2.2
    with pytest.raises(supernode.ClusterFailed, match=f"no cluster is up in {tmp_path}; start one"):
        supernode.connect(tmp_path)


def test_a_cluster_that_is_slow_to_answer_is_waited_for(service, monkeypatch):
    monkeypatch.setattr("supernode.client.link.CONNECT_WITHIN", 0.5)
    asked, free = threading.Event(), threading.Event()
    answer = service.value
    monkeypatch.setattr(service, "value", lambda request: (asked.set(), free.wait(), answer(request))[2])
    began = time.monotonic()
    slow = later(0.7, free.set)
    with supernode.connect(service.endpoint):
        assert asked.is_set()
        assert time.monotonic() - began > 0.6
    slow.join()


def test_a_state_folder_leads_to_its_cluster(service, tmp_path, monkeypatch):
    folder = tmp_path / "supernode"
    folder.mkdir()
    write_info(folder, ClusterInfo(service.endpoint, "fake", os.getpid(), "0"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    for place in (None, folder, str(folder)):
        with supernode.connect(place) as client:
            assert client.status()["cluster"] == "fake"


def test_a_cluster_that_is_down_is_not_waited_for(service, tmp_path):
    write_info(tmp_path, ClusterInfo(service.endpoint, "fake", os.getpid(), "0"))
    with supernode.connect(tmp_path) as client:
        client.down()
        (tmp_path / "cluster.json").unlink()
        time.sleep(0.2)
        began = time.monotonic()
        with pytest.raises(supernode.ClusterFailed, match="no cluster is up in"):
            client.status()
        assert time.monotonic() - began < 1


def test_a_closed_client_says_so(service, file):
    client = supernode.connect(service.endpoint)
    job = client.submit(file, id="a")
    failed = []

    def wait():
        try:
            job.result()
        except supernode.ClusterFailed as error:
            failed.append(str(error))

    thread = threading.Thread(target=wait)
    thread.start()
    time.sleep(0.3)
    client.close()
    client.close()
    thread.join(5)
    assert failed == ["the client is closed"]
    with pytest.raises(supernode.ClusterFailed, match="closed"):
        client.jobs()


def test_a_job_that_nobody_holds_is_forgotten(service, client, file):
    for _ in range(3):
        job = client.submit(file)
        service.improve(job.id, 1)
        service.end(job.id)
        assert job.result().status == "solved"
    del job
    gc.collect()
    assert len(client._client._tracker._feeds) == 0


def test_clients_leave_no_threads_behind(service):
    before = threading.active_count()
    for _ in range(5):
        supernode.connect(service.endpoint).close()
    assert threading.active_count() == before


def test_asyncio(service, file):
    async def story():
        async with await supernode.connect_async(service.endpoint) as client:
            job = await client.submit(file, id="a")
            first, second = [], []

            async def follow(seen):
                async for better in job.improvements():
                    seen.append(better.fitness)

            tasks = [asyncio.create_task(follow(seen)) for seen in (first, second)]
            await asyncio.sleep(0.1)
            for fitness in (5, 3):
                service.improve("a", fitness)
            with pytest.raises(TimeoutError):
                await job.result(0.1)
            service.end("a")
            await asyncio.gather(*tasks)
            assert first == second == [5.0, 3.0]
            assert (await job.answer()).fitness == 3.0
            assert (await job.result()).status == "solved"
            assert await (await client.job("a")).state() == "solved"
            with pytest.raises(supernode.BadInput):
                await client.job("none")
            assert len(await client.jobs()) == 1

    asyncio.run(story())
