"""Processes of a cluster that stays up are killed for real: it mends itself, and every job ends once."""

import contextlib
import os
import signal
import sqlite3
from dataclasses import replace
from pathlib import Path

import epochs
import postgres
import pytest
from live_service import children_of, command_of, live, until
from places import free_port

from coordinator.jobs.states import ENDS
from node.replay import replay
from problems import ProblemFile
from problems.file import parse
from supernode.__main__ import main

ENDS_WITHIN = 5.0  # seconds
pytestmark = pytest.mark.timeout(300)


def job(generations, cost=0, topology="torus 2x4", **run):
    """Never solved, so that it ends after so many generations."""
    fields = f'kind = "function"\nname = "onemax"\ndimension = 64\ncost_us = {cost}\n'
    file = parse(fields, "faults", Path())
    return file.with_run(topology=topology, generations=generations, target=-1.0, **run)


def runs(*jobs):
    """Wait until all do, on nodes; none may have ended before."""

    def do():
        seen = {each.id: each.state() for each in jobs}
        assert not ENDS & set(seen.values()), seen
        return set(seen.values()) == {"running"}

    until(do)


def breeds(job):
    """Wait until something was found."""
    next(job.improvements())


def states(job):
    return [state for state, _ in job.show()["states"]]


def history(file, result):
    """What `spy.result` makes of all epochs in which nobody died, replayed in this process."""
    return epochs.history(replay(replace(file, fields=file.fields | {"cost_us": 0.0}), result.directives))


@pytest.fixture(params=["sqlite"])
def service(request, tmp_path):
    with contextlib.ExitStack() as stack:
        url = stack.enter_context(postgres.server()).url() if request.param == "postgres" else None
        options = [] if url is None else ["--database", url]
        yield stack.enter_context(live(tmp_path / "state", "torus 4x4", *options))


@pytest.mark.parametrize("service", ["sqlite", "postgres"], indirect=True)
def test_whatever_is_killed_every_job_ends_once(service):
    victims = ["coordinator", "spy", "router", "node 5"]
    with service.connect() as client:
        short = [client.submit(job(100, seed=seed), id=f"short{seed}") for seed in range(10)]
        long = [
            client.submit(job(None, 100, seed=seed, stall=10**6), id=f"long{seed}", priority=1) for seed in range(2)
        ]
        short += [client.submit(job(100, seed=seed), id=f"short{seed}") for seed in range(10, 20)]
        for victim in victims:
            runs(*long)
            service.kill(victim)
            client.status()  # it answers again
        runs(*long)
        for each in long:
            each.cancel()  # by their own limits they might end before the last is killed
        for each, end in [(each, "cancelled") for each in long] + [(each, "exhausted") for each in short]:
            result = each.result(120)
            assert (result.status, result.message) == (end, None)
            assert [state for state in states(each) if state in ENDS] == [end]
        assert all(each.result().generations == 100 for each in short)
        assert client.status()["jobs"] == {"cancelled": 2, "exhausted": 20}


@pytest.mark.parametrize("mode", ["lockstep", "async"])
@pytest.mark.parametrize("deme", [1, 8])
def test_a_dead_node_is_replaced_on_its_cell(tmp_path, mode, deme):
    file = job(300, 500 if deme == 1 else 300, "torus 2x3", mode=mode, deme=deme)
    with live(tmp_path / "state", "torus 2x3") as service, service.connect() as client:
        running = client.submit(file, id="a")
        breeds(running)
        # One of the latest 32 messages carries the state, which a neighbour that does not run yet may not have read.
        until(lambda: all(each["sent"] > 64 for each in client.status()["nodes"]))
        service.kill("node 4")
        result = running.result(120)
        assert states(running)[-1] == "exhausted"
        if mode == "lockstep":
            assert (result.directives, result.generations) == ([], file.run.generations)
            assert result.history_sha256 == history(ProblemFile.from_json(running.show()["file"]), result)
            return
        (directive,) = result.directives
        cell = str(running.show()["nodes"].index(4))
        assert (directive["do"], directive["epoch"]) == ("replace", 1)
        assert directive["demes_of"] == {cell: int(cell)}, "a neighbour keeps its deme"
        assert directive["generations"].keys() == {str(other) for other in range(6)} - {cell}


def test_two_nodes_of_a_job_that_moves_die(tmp_path):
    file = job(300, 400, "torus 2x3")
    with live(tmp_path / "state", "torus 2x3") as service, service.connect() as client:
        running = client.submit(file, id="a")
        breeds(running)
        for victim in ("node 1", "node 2"):
            os.kill(service.processes()[victim], signal.SIGKILL)
        assert running.rewire("ring 6") >= 1
        service.kill("spy")
        result = running.result(120)
        assert (result.status, result.generations) == ("exhausted", 300)
        assert {"rewire"} <= {directive["do"] for directive in result.directives} <= {"replace", "rewire"}
        assert result.history_sha256 == history(file, result)


def test_a_node_dies_while_there_is_no_coordinator(service):
    with service.connect() as client:
        file = job(None, 200, "torus 4x4", stall=10**6)
        running = client.submit(file, id="a")
        breeds(running)
        os.kill(service.processes()["coordinator"], signal.SIGKILL)
        service.kill("node 7")
        breeds(running)
        running.cancel()
        result = running.result(60)
        assert [directive["do"] for directive in result.directives] == ["stop"]
        assert result.history_sha256 == history(file, result)


def test_the_router_and_the_spy_die_at_once(tmp_path):
    """What was asked by the router is asked again, also if the news of the spy come in between."""
    with live(tmp_path / "state", "torus 1x2") as service, service.connect() as client:
        for turn in range(6):
            running = client.submit(job(None, 100, "torus 1x2", stall=10**6), id=f"turn{turn}")
            breeds(running)
            os.kill(service.processes()["spy"], signal.SIGKILL)
            service.kill("router")
            assert running.state() == "running"
            running.cancel()
            assert running.result(30).status == "cancelled"


def test_who_takes_over_knows_what_a_job_has_lived_through(tmp_path):
    file = job(None, 200, "torus 2x3", stall=10**6)
    with live(tmp_path / "state", "torus 2x3") as service, service.connect() as client:
        running = client.submit(file, id="a")
        breeds(running)
        for cost, topology in ((201, "ring 6"), (202, "complete 6"), (203, "torus 2x3")):
            service.kill("coordinator")
            running.update(cost_us=cost)
            running.rewire(topology)
        told = running.show()["epochs"]
        assert [each["epoch"] for each in told] == [1, 2, 3, 4, 5, 6]
        assert all(each["generation"] is not None for each in told[:-1])
        service.kill("coordinator")
        running.cancel()
        result = running.result(120)
        assert [each["do"] for each in result.directives] == ["update", "rewire"] * 3 + ["stop"]
        assert result.generations == sum(each["generation"] for each in result.directives)
        assert result.run == file.run.model_dump() | {"topology": "torus 2x3"}
        assert result.history_sha256 == history(file, result)


def test_a_database_that_is_away_is_waited_for(tmp_path):
    with contextlib.ExitStack() as stack:
        database = stack.enter_context(postgres.server())
        service = stack.enter_context(live(tmp_path / "state", "torus 2x2", "--database", database.url()))
        client = stack.enter_context(service.connect())
        client.submit(job(10, topology="torus 2x2"), id="a").result(60)
        database.stop()
        service.kill("coordinator")
        waiting = service.processes()["coordinator"]
        database.start()
        assert client.status()["jobs"] == {"exhausted": 1}
        assert service.processes()["coordinator"] == waiting


def test_all_nodes_of_a_job_die(tmp_path):
    with live(tmp_path / "state", "torus 1x2") as service, service.connect() as client:
        running = client.submit(job(300, 1000, "torus 1x1"), id="a")
        breeds(running)
        until(lambda: running.show()["best"])
        (node,) = running.show()["nodes"]
        best = running.show()["best"]["fitness"]
        service.kill(f"node {node}")
        until(lambda: (running.show()["best"] or {}).get("epoch") == 1)  # told right after the epoch itself is
        assert running.show()["best"]["fitness"] <= best
        result = running.result(120)
        assert (result.status, result.generations) == ("exhausted", 300)
        assert result.fitness <= best
        assert states(running).count("queued") == 2


@pytest.mark.parametrize("victim", ["zygote", "up"])
def test_when_the_supervisor_is_killed_all_end_and_the_next_goes_on(tmp_path, victim):
    with live(tmp_path / "state", "torus 2x2") as service:
        with service.connect() as client:
            running = client.submit(job(60, 2000, "torus 2x2", seed=3), id="a")
            queued = client.submit(job(50, topology="torus 2x2"), id="b")
            breeds(running)
        process = service.zygote if victim == "zygote" else service.process.pid
        assert service.all_gone_within(ENDS_WITHIN, lambda: os.kill(process, signal.SIGKILL))
        assert not service.folder.exists()
    with live(tmp_path / "state", "torus 2x2") as service, service.connect() as client:
        for name, before in (("a", running), ("b", queued)):
            again = client.job(name)
            assert again.id == before.id
            assert again.result(120).status == "exhausted"
        assert states(client.job("a")).count("exhausted") == 1


def kept_checkpoints(state, number=1):
    """How many checkpoints of a job have been stored so far."""
    (path,) = state.glob("*.sqlite")
    with contextlib.closing(sqlite3.connect(path)) as database:
        query = "SELECT MAX(id) FROM checkpoints WHERE number = ?"
        return database.execute(query, (number,)).fetchone()[0] or 0


def test_when_all_is_killed_a_job_goes_on_from_its_latest_checkpoint(tmp_path):
    file, options = job(600, 500, "torus 2x2", seed=3), ("--checkpoint", "300ms")
    with live(tmp_path / "state", "torus 2x2", *options) as service:
        with service.connect() as client:
            client.submit(file, id="a")
            until(lambda: kept_checkpoints(tmp_path / "state") >= 3)
            best = client.job("a").show()["best"]["fitness"]
        assert service.all_gone_within(ENDS_WITHIN, lambda: os.kill(service.zygote, signal.SIGKILL))
    with live(tmp_path / "state", "torus 2x2", *options) as service, service.connect() as client:
        result = client.job("a").result(120)
        assert (result.status, result.generations, result.directives) == ("exhausted", 600, [])
        assert result.history_sha256 == history(file, result)
        assert result.fitness <= best
        assert kept_checkpoints(tmp_path / "state") == 0, "of a job that has ended none is kept"


def test_when_all_nodes_of_a_job_die_it_goes_on_from_its_latest_checkpoint(tmp_path):
    file = job(600, 1000, "torus 1x2")
    with live(tmp_path / "state", "torus 1x2", "--checkpoint", "300ms") as service, service.connect() as client:
        running = client.submit(file, id="a")
        until(lambda: kept_checkpoints(tmp_path / "state") >= 3)
        before = service.processes()
        for node in ("node 0", "node 1"):
            os.kill(before[node], signal.SIGKILL)
        result = running.result(120)
        assert (result.status, result.generations) == ("exhausted", 600)
        assert result.history_sha256 == history(file, result)
        assert states(running).count("queued") == 2


def test_down_from_afar_returns_when_no_process_is_left(tmp_path, capsys):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with live(tmp_path / "state", "torus 4x4", "--listen", endpoint) as service:
        processes = service.processes().values()
        assert len(processes) == 19
        assert main(["down", "--connect", endpoint]) == 0
        assert capsys.readouterr().out == f"down: {endpoint}\n"
        assert not any(map(command_of, processes))
        assert service.process.wait(ENDS_WITHIN) == 0


def test_nobody_is_left_behind(service):
    children = children_of(service.process.pid)
    service.close()
    assert not [each for each in children if Path(f"/proc/{each}").exists()]
    assert not service.folder.exists()
