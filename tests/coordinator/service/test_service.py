"""The coordinator as a process, with its router and its clients: on the wire, and when it is killed in the middle."""

import contextlib
import dataclasses
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import msgpack
import postgres
import pytest
import zenoh

import supernode
from coordinator.store.database import sqlite_url
from wire import jobs, sessions
from wire.callbacks import direct
from wire.jobs import Cancel, Done, Down, JobState, ListJobs, Refused, Show, Status, Submit
from wire.keys import ANYONE, Keys

ROOT = Path(__file__).resolve().parents[3]
FILE = supernode.load(ROOT / "examples" / "arm-ik.toml")
KEYS = Keys("c1")
ROUTER = "import sys; from coordinator.launch.router import route; route([sys.argv[1]], int(sys.argv[2]))"
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests" / "helpers")])}
PATIENCE = 60.0  # seconds


def file(topology="ring 4", seconds=0.02):
    """A job of the stub's, which takes its target for the seconds that it is to take."""
    return FILE.with_run(topology=topology, target=seconds).to_json()


class Cluster:
    """A router, a coordinator and a client, each of which can be killed and started anew."""

    def __init__(self, folder, store):
        self.endpoint = sessions.unix_socket(folder, "r")
        self.store = store
        self.processes = {}
        self.heard = []
        self.start_router()
        self.start_coordinator()
        self.session = sessions.client(self.endpoint)
        self.subscriber = self.session.declare_subscriber(KEYS.state, direct(self.hear))

    def hear(self, sample):
        self.heard.append(JobState.decode(sample.payload.to_bytes()))

    def start_router(self):
        ready, tell = os.pipe()
        command = [sys.executable, "-c", ROUTER, self.endpoint, str(tell)]
        self.processes["router"] = subprocess.Popen(command, pass_fds=[tell], env=ENVIRONMENT)
        os.close(tell)
        assert os.read(ready, 1) == b"!"
        os.close(ready)

    def start_coordinator(self, nodes=8):
        command = [sys.executable, ROOT / "tests/helpers/stub_service.py", self.endpoint, "c1", self.store, str(nodes)]
        self.processes["coordinator"] = subprocess.Popen(command, env=ENVIRONMENT)

    def kill(self, name):
        self.processes[name].kill()
        self.processes[name].wait()

    def raw(self, payload, right=jobs.WATCH):
        """The answer to a request as it travels; asked again until there is one."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            for reply in self.session.get(KEYS.requests(ANYONE, right), payload=payload, timeout=5.0):
                if reply.ok is not None:
                    return jobs.decode_answer(reply.ok.payload.to_bytes())
            time.sleep(0.02)
        raise TimeoutError("no coordinator answers")

    def ask(self, request):
        answer = self.raw(jobs.encode(request), request.right)
        assert isinstance(answer, Done), answer
        return answer.value

    def until_ended(self, names):
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            ended = {job["job"]: job["status"] for job in self.ask(ListJobs()) if job["ended"] is not None}
            if set(names) <= ended.keys():
                return ended
            time.sleep(0.05)
        raise TimeoutError(f"{len(set(names) - ended.keys())} have not ended")

    def close(self):
        with contextlib.suppress(zenoh.ZError):
            self.session.close()
        for name in self.processes:
            self.kill(name)


@pytest.fixture(params=["sqlite"])
def cluster(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("c")
    with contextlib.ExitStack() as stack:
        if request.param == "sqlite":
            store = sqlite_url(folder / "jobs.sqlite")
        else:
            store = stack.enter_context(postgres.server()).url()
        cluster = Cluster(folder, store)
        stack.callback(cluster.close)
        yield cluster


def test_the_wire(cluster):
    assert cluster.ask(Status())["cluster"] == "c1"
    assert cluster.ask(Submit(file(), "a")) == {"job": "a", "status": "queued"}
    assert cluster.until_ended(["a"]) == {"a": "solved"}
    assert cluster.ask(Show("a"))["result"]["job"] == "a"
    assert [state.status for state in cluster.heard] == ["submitted", "queued", "preparing", "running", "solved"]
    assert cluster.raw(jobs.encode(Cancel("b")), jobs.CHANGE) == Refused("there is no job 'b'")
    assert cluster.raw(msgpack.packb([2, "status", {}])) == Refused(
        "expected a request of protocol version 1, which this cluster speaks, found 2"
    )
    assert cluster.raw(b"\xc1" * 50) == Refused(
        "expected a request [version, name, arguments] in msgpack, but it is not msgpack"
    )
    assert isinstance(cluster.raw(b""), Refused)


@pytest.mark.parametrize("request_", [Submit("{}"), Cancel("a"), Down(), jobs.Rewire("a", "ring 4")])
def test_a_request_under_another_right_is_refused(cluster, request_):
    said = f"{request_.name} is asked for at .../{request_.right}, not .../watch"
    assert cluster.raw(jobs.encode(request_), jobs.WATCH) == Refused(said)


def test_a_client_that_writes_its_messages_by_hand(cluster):
    payload = msgpack.packb([1, "submit", {"file": file(), "id": "by-hand"}])
    assert cluster.raw(payload, jobs.SUBMIT) == Done({"job": "by-hand", "status": "queued"})


def test_a_large_problem_holds_nobody_else(cluster):
    obstacles = [{"shape": "circle", "center": [9.0 + number, 9.0], "radius": 0.25} for number in range(20_000)]
    large = dataclasses.replace(FILE.with_run(topology="ring 4"), fields=FILE.fields | {"obstacles": obstacles})
    cluster.ask(Status())
    answered = queue.SimpleQueue()
    for name, request in [("submit", Submit(large.to_json(), "a")), ("status", Status())]:  # they come in this order
        note = direct(lambda _, name=name: answered.put(name))
        cluster.session.get(KEYS.requests(ANYONE, request.right), note, payload=jobs.encode(request), timeout=PATIENCE)
    assert [answered.get(timeout=PATIENCE) for _ in range(2)] == ["status", "submit"]
    assert cluster.until_ended(["a"]) == {"a": "solved"}


@pytest.mark.parametrize("cluster", ["sqlite", "postgres"], indirect=True)
def test_kill_9_of_the_coordinator_loses_and_doubles_nothing(cluster):
    names = [f"j{number}" for number in range(22)]  # two run, the others wait
    acknowledged = []

    def submit():
        for name in names:
            cluster.ask(Submit(file(seconds=0.1), name))  # again if there was no answer: the id makes that harmless
            acknowledged.append(name)

    client = threading.Thread(target=submit)
    client.start()
    for wanted in (8, 22):
        while len(acknowledged) < wanted:
            time.sleep(0.005)
        cluster.kill("coordinator")
        cluster.start_coordinator()
    client.join()
    assert cluster.until_ended(names) == dict.fromkeys(names, "solved")
    for name in names:
        states = [state for state, _ in cluster.ask(Show(name))["states"]]
        assert states.count("solved") == 1
    told = [state.job for state in cluster.heard if state.status == "solved"]
    assert len(told) == len(set(told))


def test_a_router_that_comes_back_is_used_again(cluster):
    cluster.ask(Submit(file(seconds=0.5), "a"))
    cluster.kill("router")
    Path(cluster.endpoint.removeprefix("unixsock-stream/")).unlink(missing_ok=True)
    cluster.start_router()
    assert cluster.until_ended(["a"]) == {"a": "solved"}
    cluster.ask(Submit(file(), "b"))
    cluster.until_ended(["b"])


def test_down_ends_the_coordinator_and_keeps_what_has_not_ended(cluster):
    cluster.ask(Submit(file(seconds=60.0), "a"))
    assert cluster.ask(Down()) == {"ends": "cluster"}
    assert cluster.processes["coordinator"].wait(PATIENCE) == 0
    cluster.start_coordinator()
    assert [job["status"] for job in cluster.ask(ListJobs())] == ["running"]


def test_a_terminated_coordinator_ends_in_order(cluster):
    cluster.ask(Status())
    cluster.processes["coordinator"].send_signal(signal.SIGTERM)
    assert cluster.processes["coordinator"].wait(PATIENCE) == 0


def test_many_jobs_leave_nothing_open(cluster):
    def open_things():
        process = Path(f"/proc/{cluster.processes['coordinator'].pid}")
        return len(list((process / "fd").iterdir())), len(list((process / "task").iterdir()))

    counts = []
    for batch in range(3):
        names = [f"j{batch}-{number}" for number in range(50)]
        for name in names:
            cluster.ask(Submit(file(seconds=0.0), name))
        cluster.until_ended(names)
        time.sleep(0.2)
        counts.append(open_things())
    assert counts[2][0] <= counts[0][0] + 2
    assert counts[2][1] <= counts[0][1] + 2


def test_a_flood_of_changes_of_one_job_shuts_out_no_submits():
    """The queues of requests, as they are."""
    from coordinator.service import process
    from coordinator.service.waiting_room import WaitingRoom
    from wire.jobs import Update

    room = WaitingRoom()
    flood = [room.enter(process._queues(Update("a", "{}"), "anna"), 1000) for _ in range(2000)]
    assert flood.count(None) == 100
    assert flood[-1].name == "changes of job 'a'"
    assert room.enter(process._queues(Update("b", "{}"), "anna"), 1000) is None
    assert room.enter(process._queues(Submit("[]"), "anna"), 1 << 20) is None


def test_a_flood_of_submits_of_one_client_shuts_out_no_other():
    from coordinator.service import process
    from coordinator.service.waiting_room import WaitingRoom

    room = WaitingRoom()
    flood = [room.enter(process._queues(Submit("[]"), "anna"), 1000) for _ in range(2000)]
    assert flood.count(None) == 250
    assert flood[-1].name == "submits of anna"
    assert room.enter(process._queues(Submit("[]"), "bob"), 1 << 20) is None
