"""Clusters whose nodes live in several places and join: the same results as in one, and hosts that come and go."""

import contextlib
import hashlib
import os
import signal
from pathlib import Path

import epochs
import pytest
from live_service import log_texts
from places import PATIENCE, ROOT, free_port, places, until

import supernode
from node.plan import Plan
from node.replay import replay
from node.simulation import simulate
from supernode.__main__ import main
from wire import sessions
from wire.keys import Keys

KEYS = Keys("main")


def problem(topology, **run):
    settings = {"target": -1.0, "generations": 40, "seed": 5} | run
    return supernode.load(ROOT / "examples" / "arm-ik.toml").with_run(topology=topology, **settings)


def history(file):
    return hashlib.sha256(b"".join(report.digest for report in simulate(Plan.of(file)))).hexdigest()


def check(result, file):
    """It is what a simulation gives."""
    assert (result.status, result.generations) == ("exhausted", 40)
    assert result.history_sha256 == history(file)
    assert result.messages["lost"] == 0


def nodes(client):
    return {node["node"]: node["process"] for node in client.status()["nodes"]}


def went_on(client, job):
    """The cells that went on exactly, by the log, which must not say that another one could not."""
    texts = log_texts(client, job)
    assert not [text for text in texts if "cannot go on" in text or "another epoch" in text]
    lines = [text for text in texts if text.startswith("new processes go on where the dead ones were: cells ")]
    return {int(cell) for line in lines for cell in line.rpartition("cells ")[2].split(", ")}


def routed(cluster):
    """The nodes that hear others through the router, or publish there for the spy."""
    with contextlib.closing(sessions.client(cluster.endpoint)) as session:
        replies = list(session.liveliness().get("supernode/main/node/*/routed"))
        return {int(str(reply.ok.key_expr).split("/")[3]) for reply in replies}


def is_alive(process):
    with contextlib.suppress(OSError):
        os.kill(process, 0)
        return True
    return False


@pytest.mark.parametrize("listens", [False, True], ids=["by the router", "direct"])
def test_a_job_on_two_hosts_is_bit_identical_to_a_simulation(listens):
    file = problem("torus 2x4")
    with places(8) as cluster:
        for number, name in enumerate(("upper", "lower")):
            address = f"tcp/127.0.0.{number + 2}:{free_port()}"
            cluster.host(name, 4, **({"LISTEN": address} if listens else {}))
        with cluster.client() as client:
            for topology in ("torus 2x4", "ring 8", "torus 2x4"):
                file = problem(topology)
                job = client.submit(file)
                check(job.result(60), file)
            root = job.show()["nodes"][0]
            linked_by_router = routed(cluster)
            asynchronous = client.submit(problem("torus 2x4", mode="async")).result(60)
    assert linked_by_router == ({root} if listens else set(range(8)))
    assert asynchronous.status == "exhausted"


def test_nodes_and_hosts_come_and_go():
    with places(4) as cluster:
        cluster.host("one", 2)
        with cluster.client() as client:
            until(lambda: len(nodes(client)) == 2)
            with pytest.raises(supernode.BadInput, match="the cluster has 4 nodes"):
                client.submit(problem("ring 5"))
            waiting = client.submit(problem("ring 4"))
            assert waiting.state() == "queued"
            two = cluster.host("two", 2)
            check(waiting.result(60), problem("ring 4"))

            # A node that dies is forked anew, under its number.
            before = nodes(client)
            os.kill(before[2], signal.SIGKILL)
            until(lambda: nodes(client)[2] not in (None, before[2]))
            check(client.submit(problem("ring 4")).result(60), problem("ring 4"))

            # A coordinator that takes over finds the nodes that there are.
            cluster.kill("coordinator")
            cluster.start("coordinator", NODES=4, STATE=cluster.folder)
            assert client.submit(problem("ring 4"), id="after").result(60).status == "exhausted"
            assert nodes(client).keys() == {0, 1, 2, 3}

            # A host takes its nodes with it, and gets their numbers back when it comes again.
            before = nodes(client)
            theirs = [process for process in before.values() if _parent(process) == two.pid]
            assert len(theirs) == 2
            cluster.kill("two")
            until(lambda: not any(is_alive(process) for process in theirs))
            cluster.host("two", 2)
            until(lambda: set(nodes(client).values()).isdisjoint(theirs))
            assert nodes(client).keys() == {0, 1, 2, 3}
            check(client.submit(problem("ring 4")).result(60), problem("ring 4"))

            # Another one makes the cluster larger than was expected; a job on it is heard by a spy that is new too.
            cluster.host("three", 1)
            until(lambda: len(nodes(client)) == 5)
            cluster.kill("spy")
            cluster.start("spy")
            check(client.submit(problem("ring 5")).result(60), problem("ring 5"))
        for name in ("one", "three", "coordinator"):
            assert cluster.kill(name, signal.SIGTERM) == 0


@pytest.mark.parametrize("listens", [False, True], ids=["by the router", "direct"])
def test_after_a_takeover_a_dead_cell_goes_on_exactly(listens):
    file = problem("torus 2x4", generations=None, seconds=60.0)
    with places(8) as cluster:
        for number, name in enumerate(("upper", "lower")):
            address = f"tcp/127.0.0.{number + 2}:{free_port()}"
            cluster.host(name, 4, **({"LISTEN": address} if listens else {}))
        with cluster.client() as client:
            job = client.submit(file)
            until(lambda: job.state() == "running")
            cluster.kill("coordinator")
            cluster.start("coordinator", NODES=8, STATE=cluster.folder)
            until(lambda: job.state() == "running")
            until(lambda: len(nodes(client)) == 8)
            for node in (1, 6):
                before = nodes(client)[node]
                os.kill(before, signal.SIGKILL)
                until(lambda node=node, before=before: nodes(client).get(node) not in (None, before))
            until(lambda: len(went_on(client, job)) == 2)
            job.cancel()
            result = job.result(60)
    assert [each["do"] for each in result.directives] == ["stop"]
    assert epochs.history(replay(file, result.directives)) == result.history_sha256


@pytest.mark.parametrize("mode", ["lockstep", "async"])
def test_a_host_that_is_told_to_end_gives_its_cells_to_another_one_first(mode):
    file = problem("torus 2x4", generations=None, seconds=60.0, mode=mode)
    with places(8) as cluster:
        for name in ("one", "two"):
            cluster.host(name, 4)
        with cluster.client() as client:
            job = client.submit(file)
            until(lambda: job.state() == "running")
            cluster.host("three", 4)
            until(lambda: len(nodes(client)) == 12)
            assert cluster.kill("two", signal.SIGTERM) == 0
            until(lambda: len(nodes(client)) == 8)
            shown = job.show()
            assert shown["status"] == "running", job.result(1).message
            assert shown["epoch"] == 1
            job.cancel()
            result = job.result(60)
    (directive, *_) = result.directives
    assert (directive["do"], directive["demes_of"]) == ("replace", {})
    assert len(directive["generations"]) == 8
    if mode == "lockstep":
        assert epochs.history(replay(file, result.directives)) == result.history_sha256


@pytest.mark.parametrize("mode", ["lockstep", "async"])
def test_a_job_that_grows_takes_the_nodes_of_a_host_that_comes(mode):
    file = problem("torus 2x4", generations=None, seconds=60.0, mode=mode, grow=True)
    with places(8) as cluster:
        cluster.host("one", 8)
        with cluster.client() as client:
            job = client.submit(file)
            until(lambda: job.state() == "running")
            cluster.host("two", 10)
            until(lambda: client.status()["placements"])
            until(lambda: client.status()["placements"][0]["hosts"] == {"one": 8, "two": 8})
            until(lambda: job.show()["epoch"] > 0)
            job.cancel()
            result = job.result(60)
    assert result.topology == "torus 4x4"
    assert [each["topology"] for each in result.directives if each["do"] == "replace"] == ["torus 4x4"]
    if mode == "lockstep":
        assert epochs.history(replay(file, result.directives)) == result.history_sha256


def test_a_host_that_finds_no_room_waits_for_it():
    with places(None) as cluster:
        cluster.start("router", LISTEN=cluster.endpoint)
        cluster.start("coordinator", NODES=2, MAX_NODES=5, STATE=cluster.folder)
        cluster.start("spy")
        cluster.host("one", 3)
        with cluster.client() as client:
            until(lambda: nodes(client).keys() == {0, 1, 2})
            cluster.host("two", 3)
            until(lambda: nodes(client).keys() == {0, 1, 2, 3, 4})
            cluster.host("three", 1)
            check(client.submit(problem("ring 5")).result(60), problem("ring 5"))
            assert cluster.kill("one", signal.SIGTERM) == 0
            until(lambda: "three" in {node["host"] for node in client.status()["nodes"]})
            assert len(nodes(client)) == 3


def test_a_host_whose_cells_have_nowhere_to_go_ends_all_the_same():
    with places(4) as cluster:
        cluster.host("one", 2)
        cluster.host("two", 2)
        with cluster.client() as client:
            until(lambda: len(nodes(client)) == 4)
            job = client.submit(problem("ring 4", generations=None, seconds=60.0))
            until(lambda: job.state() == "running")
            cluster.processes["two"].send_signal(signal.SIGTERM)
            cluster.processes["two"].send_signal(signal.SIGINT)  # at once
            assert cluster.processes["two"].wait(PATIENCE) == 0
            job.cancel()


def test_down_ends_the_coordinator_and_says_that_the_others_live_on(capsys):
    with places(1) as cluster:
        cluster.host("only", 1)
        with cluster.client() as client:
            until(lambda: nodes(client))
        assert main(["down", "--connect", cluster.endpoint]) == 0
        assert cluster.processes["coordinator"].wait(PATIENCE) == 0
        assert all(cluster.processes[name].poll() is None for name in ("router", "spy", "only"))
    assert capsys.readouterr().out.endswith("; router, spy and nodes end where they were started, or with `up --on`\n")


def test_a_second_host_of_the_same_name_is_not_let_in(capfd):
    with places(2) as cluster:
        cluster.host("one", 2)
        with cluster.client() as client:
            until(lambda: len(nodes(client)) == 2)
        twin = cluster.start("twin", ["node"], NODES=2, HOST="one")
        assert twin.wait(60) == 1
    assert "a host named one has joined already" in capfd.readouterr().err


def _parent(process):
    return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
