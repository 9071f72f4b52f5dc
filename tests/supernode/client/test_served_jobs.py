"""Clients of a real cluster: what they see of one job together, what they are refused, and when answers come."""

import contextlib
import itertools
import json
import os
import signal
import sqlite3
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path

import msgpack
import pytest
from command_line import in_process
from live_service import ROOT, end_all_jobs, live, until

import supernode
from benchmarks import service as benchmark
from problems.file import parse
from supernode.__main__ import main
from wire import jobs, sessions
from wire.callbacks import direct
from wire.jobs import JobState, Refused
from wire.keys import ANYONE, Keys
from wire.news import Improvement, Statistics

LATE = 0.05  # seconds, at most
SPY_AGAIN = 3.0  # seconds, at most
ARM = supernode.load(ROOT / "examples" / "arm-ik.toml")
WATCHER = """
import sys, supernode
with supernode.connect(sys.argv[1]) as client:
    job = client.job(sys.argv[2])
    print("watches", flush=True)
    for better in job.improvements():
        print(better.epoch, better.generation, better.cell, better.fitness, flush=True)
"""

pytestmark = pytest.mark.timeout(180)


def job(generations=None, cost=0, topology="torus 2x2", dimension=64, **run):
    """Never solved."""
    fields = f'kind = "function"\nname = "onemax"\ndimension = {dimension}\ncost_us = {cost}\n'
    return parse(fields, "job", Path()).with_run(topology=topology, generations=generations, target=-1.0, **run)


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    with live(tmp_path_factory.mktemp("service") / "state", "torus 2x2", "--max-queue", "1") as service:
        yield service


@pytest.fixture
def client(service):
    with service.connect() as client:
        yield client
        end_all_jobs(client)


@pytest.fixture
def command(service, capsys):
    """Runs a command on the service: exit code and the one line of its error."""

    def run(name, *arguments):
        code, out, err = in_process(capsys, name, *arguments, "--state", service.state)
        (line,) = err.splitlines()
        assert out == ""
        return code, line

    return run


def watcher(service, job):
    command = [sys.executable, "-c", WATCHER, str(service.state), job]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)})


def told(client, kind, job):
    """Records by the names of their columns."""
    page = client.records(kind, job)
    return [dict(zip(page["columns"], row, strict=True)) for row in page["rows"]]


class Ear:
    """Hears what is published, and when."""

    def __init__(self, service):
        info = service.info()
        self.states, self.answers, self.statistics = {}, [], []
        self.session = sessions.client(info.endpoint)
        self.session.declare_subscriber(Keys(info.cluster).state, direct(self.hear_state))
        self.session.declare_subscriber(Keys(info.cluster).spy_stats, direct(self.hear_statistics))
        self.session.declare_subscriber(Keys(info.cluster).best, direct(self.hear_best))

    def hear_state(self, sample):
        state = JobState.decode(sample.payload.to_bytes())
        self.states.setdefault((state.job, state.status), time.time())

    def hear_best(self, sample):
        self.answers.append(Improvement.decode(sample.payload.to_bytes()))

    def hear_statistics(self, sample):
        self.statistics.append(Statistics.decode(sample.payload.to_bytes()))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.session.close()


def test_two_clients_see_the_same_improvements_in_the_same_order(service, client):
    before = client.submit(job(cost=1000))  # has all nodes, until both watch
    running = client.submit(job(300, 100, dimension=500), id="watched")
    watchers = [watcher(service, "watched") for _ in range(2)]
    assert [process.stdout.readline() for process in watchers] == ["watches\n"] * 2
    before.cancel()
    one, other = [process.communicate(timeout=60)[0].splitlines() for process in watchers]
    assert running.result().status == "exhausted"
    assert len(one) > 5
    assert one == other
    fitness = [float(line.split()[-1]) for line in one]
    assert fitness == sorted(fitness, reverse=True)


def test_a_client_that_stops_reading_slows_nobody(service, client):
    info, blocked = service.info(), threading.Event()
    stuck = sessions.client(info.endpoint)
    stuck.declare_subscriber(f"supernode/{info.cluster}/**", direct(lambda _: blocked.wait(60)))
    running = client.submit(job(500, 100, dimension=500), id="slow-reader")
    stopped = watcher(service, "slow-reader")
    assert stopped.stdout.readline() == "watches\n"
    stopped.send_signal(signal.SIGSTOP)
    try:
        with Ear(service) as ear:
            began = time.monotonic()
            assert client.status()["jobs"]["running"] == 1
            assert time.monotonic() - began < 5
            assert running.result(60).status == "exhausted"
            for seed in range(20):
                assert client.submit(job(20, dimension=500), seed=seed).result(10).status == "exhausted"
            assert len(ear.answers) > 20
    finally:
        stopped.kill()
        stopped.communicate()
        blocked.set()
        stuck.close()


@pytest.mark.parametrize("cost", [0, 20_000])
def test_the_answer_at_the_deadline_is_in_time(service, client, cost):
    late = []
    with Ear(service) as ear:
        for turn in range(3):
            name = f"deadline-{cost}-{turn}"
            running = client.submit(job(cost=cost, seconds=0.7), id=name)
            answer = running.answer(10)
            heard = until(lambda name=name: ear.states.get((name, "deadline")))
            late.append(heard - running.show()["submitted"] - 0.7)
            assert answer is not None
            result = running.result(30)
            assert (result.status, result.solved) == ("deadline", False)
            assert result.fitness <= answer.fitness
            assert [state for state, _ in running.show()["states"]][-1] == "deadline"
    assert min(late) >= 0
    assert statistics.median(late) <= LATE


def test_the_deadline_of_a_job_that_never_leaves_the_queue(service, client):
    late = []
    with Ear(service) as ear:
        client.submit(job(cost=1000), id="has-all-nodes")
        for turn in range(3):
            waiting = client.submit(job(seconds=0.5), id=f"waits-{turn}")
            result = waiting.result(10)
            assert result.status == "deadline"
            assert result.solution is None
            assert [state for state, _ in waiting.show()["states"]] == ["submitted", "queued", "deadline"]
            late.append(ear.states[waiting.id, "deadline"] - waiting.show()["submitted"] - 0.5)
    assert min(late) >= 0
    assert statistics.median(late) <= LATE


def test_refusals(service, client, command, tmp_path):
    toml = tmp_path / "job.toml"
    toml.write_text('kind = "function"\nname = "onemax"\ndimension = 64\n')
    bad = tmp_path / "bad.toml"
    bad.write_text('kind = "function"\nname = "onemin"\n')
    assert command("watch", "nobody") == (2, "error: there is no job 'nobody'")
    assert command("cancel", "nobody") == (2, "error: there is no job 'nobody'")
    code, said = command("submit", toml, "--torus", "3x3")
    assert (code, said) == (2, "error: the job asks for 9 cells (torus 3x3), the cluster has 4 nodes")
    code, said = command("submit", bad)
    assert code == 2
    assert said.startswith(f"error: {bad}: name: expected")
    with pytest.raises(supernode.BadInput, match="name: expected"):  # nor does the cluster believe a client
        client.submit(parse(bad.read_text(), "bad.toml", Path()), topology="torus 2x2")
    client.submit(job(cost=5000), id="first")
    client.submit(job(cost=5000), id="second")
    code, said = command("submit", toml, "--torus", "2x2", "--id", "third")
    assert (code, said) == (1, "error: the queue is full: 1 jobs wait, at most 1 may")
    assert command("watch", "third") == (2, "error: there is no job 'third'")


def test_an_update_that_is_refused_leaves_the_old_world(client, command, tmp_path):
    file = supernode.load(ROOT / "examples" / "mobile-robot.toml").with_run(topology="torus 2x2", target=-1.0)
    running = client.submit(file, id="moved", stall=100_000, seconds=60)
    next(running.improvements())
    start = file.fields["start"]
    patch = tmp_path / "patch.toml"
    center = json.dumps(start[:2])
    patch.write_text(f'[[obstacles]]\nshape = "circle"\ncenter = {center}\nradius = 0.5\n')
    code, said = command("update", "moved", patch)
    assert code == 2
    assert said.startswith(f"error: {patch}: update of {file.name}: start: expected")
    patch.write_text("strat = [1.0, 1.0, 0.0]\n")
    code, said = command("update", "moved", patch)
    assert (code, said.split("field")[0]) == (2, f"error: {patch}: update of {file.name}: strat: unknown ")
    assert said.endswith("; did you mean 'start'?")
    with pytest.raises(supernode.BadInput, match=f"^update of {file.name}: strat: unknown field"):
        running.update(strat=[1.0, 1.0, 0.0])
    assert running.state() == "running"
    assert running.show()["epochs"] == []
    assert running.update(obstacles=[]) == 1
    until(lambda: 1 in {row["epoch"] for row in told(client, "statistics", "moved")})
    running.cancel()
    assert [each["do"] for each in running.result(30).directives][:1] == ["update"]


def test_a_map_in_a_file_moves_the_world_of_a_job(client, tmp_path):
    file = supernode.load(ROOT / "examples" / "terrain-map.toml").with_run(topology="torus 2x2", target=-1.0)
    running = client.submit(file, id="map", stall=100_000, seconds=60)
    next(running.improvements())
    flooded = [row.replace("T", "@") for row in file.fields["map"]]
    head = f"type octile\nheight {len(flooded)}\nwidth {len(flooded[0])}\nmap\n"
    (tmp_path / "flooded.map").write_text(head + "\n".join(flooded))
    patch = tmp_path / "patch.toml"
    patch.write_text('file = "flooded.map"\n')
    assert running.update(patch) == 1
    (epoch,) = running.show()["epochs"]
    assert epoch["fields"] == {"map": flooded}
    running.cancel()


def test_a_client_of_another_version(service):
    info = service.info()
    session = sessions.client(info.endpoint)
    payload = msgpack.packb([jobs.VERSION + 1, "status", {}])
    key = Keys(info.cluster).requests(ANYONE, jobs.WATCH)
    (reply,) = [reply.ok.payload.to_bytes() for reply in session.get(key, payload=payload)]
    session.close()
    said = f"expected a request of protocol version {jobs.VERSION}, which this cluster speaks, found {jobs.VERSION + 1}"
    assert jobs.decode_answer(reply) == Refused(said)


def test_many_jobs_lose_and_leave_nothing():
    measured = benchmark.measure(40, 20, 2, "torus 2x2")
    assert set(measured.ends.values()) == {1}
    assert (len(measured.running), len(measured.late)) == (40, 2)
    assert min(measured.late) >= 0
    for name, held in measured.held.items():
        before = measured.settled[name]
        assert held.descriptors <= before.descriptors + 1
        assert held.sockets <= before.sockets


def test_what_happened_is_kept(service, client):
    with Ear(service) as ear:
        running = client.submit(job(cost=100, seconds=3), id="recorded")
        result = running.result(30)
    first = ear.statistics[0]
    assert (first.messages_per_second, first.evaluations > 0) == (0.0, True), "told as soon as nodes have told once"
    improvements, each_second = (told(client, kind, "recorded") for kind in ("improvements", "statistics"))
    heard = [better.fitness for better in running.improvements()]
    assert [each["fitness"] for each in improvements] == heard
    assert heard[-1] == result.fitness
    assert 2 <= len(each_second) <= 5, "one a second"
    assert all(one["generation"] < other["generation"] for one, other in itertools.pairwise(each_second))
    assert all(each["best"] <= each["median"] <= each["worst"] for each in each_second)
    assert 0 < each_second[-1]["diversity"] <= 1
    last = each_second[-1]
    paces = [
        (other["at"] - one["at"]) / (other["generation"] - one["generation"])
        for one, other in itertools.pairwise(each_second)
    ]
    exchanges = [each["exchange_seconds"] for each in each_second[1:]]
    # On a busy machine not in each second; the last one is of the short time before the end.
    assert any(pace / 3 < exchange < 3 * pace for pace, exchange in zip(paces, exchanges, strict=True))
    behind = 4  # each of the four nodes may be one exchange behind its neighbours when it tells
    assert 0 < last["received"] <= 2 * (last["messages"] + behind), "a cell of a torus of 2x2 has two neighbours"


def test_a_job_that_waits_sends_no_messages(client):
    solvable = job(dimension=400, cost=500, keep_alive=True).with_run(target=0.0)  # after 210 generations
    waiting = client.submit(solvable, id="waits-silently")
    until(lambda: any(each["messages_per_second"] > 0 for each in told(client, "statistics", "waits-silently")))
    until(lambda: waiting.state() == "waiting")
    begun = dict(waiting.show()["states"])["waiting"]
    until(lambda: told(client, "statistics", "waits-silently")[-1]["at"] > begun + 1)
    assert told(client, "statistics", "waits-silently")[-1]["messages_per_second"] == 0


def test_what_processes_had_to_say_is_gathered(service, client, capsys):
    before = max((row[0] for row in client.logs()["rows"]), default=0)
    service.kill("node 1")
    until(lambda: client.logs(node=1, after=before)["rows"])
    failing = client.submit(job(generations=3), id="in-the-log", topology="torus 1x2")
    failing.result(30)
    assert main(["logs", "--node", "1", "--json", "--state", str(service.state)]) == 0
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert told[-1]["text"] == "a process has died: another one lives on node 1"
    assert (told[-1]["level"], told[-1]["process"], told[-1]["node"]) == ("warning", "coordinator", 1)
    assert main(["logs", "--job", "in-the-log", "--state", str(service.state)]) == 0
    assert capsys.readouterr().out == ""
    assert main(["logs", "--job", "nobody", "--state", str(service.state)]) == 2
    assert capsys.readouterr().err == "error: there is no job 'nobody'\n"


def test_a_spy_that_is_killed_has_a_successor_that_knows_all(tmp_path):
    with live(tmp_path, "torus 2x2") as service, service.connect() as client:
        running = client.submit(job(cost=100, seconds=60), id="watched")
        until(lambda: running.show()["best"] and running.show()["best"]["fitness"] == 0)
        until(lambda: len(told(client, "statistics", "watched")) > 1)
        nodes = {name: process for name, process in service.processes().items() if name.startswith("node")}
        before = {kind: told(client, kind, "watched") for kind in ("improvements", "statistics")}
        with Ear(service) as ear:
            killed = time.time()
            service.kill("spy")
            until(lambda: any(better.fitness == 0 for better in ear.answers), SPY_AGAIN)
            until(lambda: any(each.evaluations > before["statistics"][-1]["evaluations"] for each in ear.statistics))
            until(lambda: told(client, "statistics", "watched")[-1]["at"] > killed)
            assert time.time() - killed < SPY_AGAIN
        after = {kind: told(client, kind, "watched") for kind in ("improvements", "statistics")}
        assert after["improvements"] == before["improvements"], "nothing better came, and nothing comes twice"
        assert after["statistics"][: len(before["statistics"])] == before["statistics"]
        assert after["statistics"][-1]["generation"] > before["statistics"][-1]["generation"]
        assert nodes.items() <= service.processes().items()
        running.cancel()
        assert running.result(30).fitness == 0
    with contextlib.closing(sqlite3.connect(tmp_path / "jobs.sqlite")) as store:
        assert store.execute("pragma integrity_check").fetchall() == [("ok",)]


def test_where_nobody_reads_every_line_of_every_process_is_json(tmp_path):
    path = tmp_path / "log"
    with path.open("w") as log, live(tmp_path / "state", "torus 1x2", stderr=log) as service:
        with service.connect() as client:
            for name in ("router", "spy", "node 1", "coordinator"):
                service.kill(name)
            client.submit(job(generations=3, topology="torus 1x2")).result(30)
        cluster = service.info().cluster
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    for line in lines:
        assert line["cluster"] == cluster
        assert {"process", "level", "timestamp", "event"} <= line.keys()
    told = {(line["process"], line["event"], line.get("node")) for line in lines}
    for name, node in (("router", None), ("spy", None), ("node 1", 1), ("coordinator", None)):
        assert ("zygote", f"{name} killed by SIGKILL: another one takes its place", node) in told
    assert ("coordinator", "the coordinator has died: another one goes on in its place", None) in told


def test_served_jobs_solve_and_simulate_write_the_same_improvements_byte_for_byte(service, client, tmp_path, capsys):
    settings = ["--torus", "2x2", "--seed", "5", "--generations", "40", "--target", "-1", "--quiet"]
    example = str(ROOT / "examples" / "arm-ik.toml")
    logs = [str(tmp_path / f"{name}.jsonl") for name in ("one", "two", "three", "own", "simulated")]
    for log in logs[:3]:
        assert main(["solve", example, *settings, "--log", log, "--state", str(service.state)]) == 3
    assert main(["solve", example, *settings, "--log", logs[3]]) == 3
    assert main(["simulate", example, *settings, "--log", logs[4]]) == 3
    capsys.readouterr()
    assert main(["logs", "--improvements", *logs]) == 0
    printed = capsys.readouterr().out
    assert printed.count("\n") > 5
    assert printed.encode() in (tmp_path / "own.jsonl").read_bytes(), "they follow one another there"
    lines = [json.loads(line) for line in printed.splitlines()]
    stored = told(client, "history", client.jobs()[-1]["job"])
    assert [each["fitness"] for each in stored if each["fitness"] in {line["fitness"] for line in lines}] == [
        line["fitness"] for line in lines
    ]
    assert "at" not in stored[0]
