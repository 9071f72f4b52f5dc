"""Jobs on real processes over real Zenoh."""

import json
import math
import os
import threading
from pathlib import Path

import pytest

import supernode
from node.plan import Plan
from node.simulation import simulate
from spy.improvement_records import records_of
from spy.past import Lived, Past
from spy.result import Result


@pytest.fixture(scope="module")
def cluster():
    with supernode.LocalCluster(torus=(3, 4)) as cluster:
        yield cluster


def replay(file, **run):
    return [report.digest for report in simulate(Plan.of(file.with_run(**run)))]


def history(result):
    import hashlib

    return hashlib.sha256(b"".join(result)).hexdigest()


def test_a_job_is_solved_and_tells_how(cluster, own_problem):
    file = supernode.load(own_problem("size = 48"))
    job = cluster.submit(file, seed=3)
    improvements = list(job.improvements())
    result = job.result()
    assert (result.status, result.solved, result.feasible, result.fitness) == ("solved", True, True, 0.0)
    fitness = [better.fitness for better in improvements]
    assert fitness == sorted(fitness, reverse=True)
    assert len(set(fitness)) == len(fitness)
    assert improvements[-1].solution == result.solution == {"integers": [1] * 48}
    diameter = 3
    assert result.generations == result.found_at["generation"] + diameter + 1


def test_one_publication_and_four_receipts_a_node_and_generation(cluster, own_problem):
    result = cluster.submit(supernode.load(own_problem()), target=-1.0, generations=25).result()
    assert result.status == "exhausted"
    assert result.messages == {"sent": 12 * 25, "received": 12 * 25 * 4, "lost": 0, "rejected": 0}
    assert result.evaluations == 12 * (1 + 25 * 8)


@pytest.mark.parametrize("spy", ["champion", "root"])
@pytest.mark.parametrize(("deme", "interval", "emigrants"), [(1, 1, 1), (8, 1, 1), (5, 3, 2)])
def test_processes_and_simulator_are_bit_identical(cluster, own_problem, deme, interval, emigrants, spy):
    file = supernode.load(own_problem())
    for seed in (1, 2**63):
        run = {"deme": deme, "interval": interval, "emigrants": emigrants, "seed": seed, "spy": spy, "mutation": 0.02}
        result = cluster.submit(file, **run).result()
        again = cluster.submit(file, **run).result()
        assert result.history_sha256 == again.history_sha256
        assert result.history_sha256 == history(replay(file, topology="torus 3x4", **run))


def test_a_run_ended_by_the_clock_can_be_replayed(cluster, own_problem):
    file = supernode.load(own_problem("size = 4000"))
    result = cluster.submit(file, seconds=0.3).result()
    assert (result.status, result.solved) == ("deadline", False)
    assert result.directives == [{"do": "stop", "generation": result.generations, "reason": "deadline"}]
    again = replay(file, topology="torus 3x4", generations=result.generations)
    assert result.history_sha256 == history(again)


def test_a_cancelled_job_has_the_best_so_far(cluster, own_problem):
    job = cluster.submit(supernode.load(own_problem("size = 4000")), stall=10**6)
    first = next(job.improvements())
    job.cancel()
    result = job.result(timeout=30)
    assert result.status == "cancelled"
    assert result.fitness <= first.fitness
    assert [directive["reason"] for directive in result.directives] == ["cancel"]


def test_a_stalled_job_ends_as_such(cluster, own_problem):
    result = cluster.submit(supernode.load(own_problem("size = 8")), target=-1.0, stall=5).result()
    assert (result.status, result.fitness) == ("stalled", 0.0)


def test_async_runs_have_the_same_result_type(cluster, own_problem):
    result = cluster.submit(supernode.load(own_problem()), mode="async").result()
    assert isinstance(result, Result)
    assert (result.status, result.mode) == ("solved", "async")
    assert result.staleness["max"] >= result.staleness["mean"] >= 0
    assert 0 <= result.staleness["again"] <= 1
    limited = cluster.submit(supernode.load(own_problem()), mode="async", target=-1.0, generations=30).result()
    assert (limited.status, limited.generations) == ("exhausted", 30)


@pytest.mark.parametrize("torus", ["2x3", (2, 3)])
def test_a_job_may_ask_for_a_torus(cluster, own_problem, torus):
    file = supernode.load(own_problem("[run]", 'topology = "ring 5"'))
    assert cluster.submit(file, torus=torus, generations=1).result().topology == "torus 2x3"
    with pytest.raises(supernode.BadInput, match=r"^options: torus: expected rows and columns"):
        cluster.submit(file, torus=6)


def test_a_wrong_torus_of_a_cluster_is_named():
    with pytest.raises(ValueError, match=r"^torus: expected rows and columns such as \"4x4\", found 'abc'"):
        supernode.LocalCluster(torus="abc")


def test_the_result_is_the_documented_json(cluster, own_problem):
    result = cluster.submit(supernode.load(own_problem()), generations=0, target=-1.0).result()
    plain = json.loads(json.dumps(result.to_json()))
    assert list(plain)[:8] == [
        "job", "kind", "status", "solved", "feasible", "fitness", "solution", "found_at"
    ]  # fmt: skip
    assert plain["generations"] == 0
    assert plain["nodes"] == 12
    assert plain["versions"]["numpy"]
    assert plain["seconds_to_ready"] > 0
    assert plain["cpu_seconds"] > 0
    assert len(plain["history_sha256"]) == 64


def test_jobs_run_one_after_another(cluster, own_problem):
    file = supernode.load(own_problem())
    jobs = [cluster.submit(file, seed=seed) for seed in range(4)]
    assert [job.result().seed for job in jobs] == [0, 1, 2, 3]
    assert [job.result().job for job in jobs] == sorted((job.result().job for job in jobs), key=int)


@pytest.mark.parametrize(
    ("trouble", "said"),
    [
        ("raises", "evaluate raised RuntimeError: out of paper"),
        ("nan", "evaluate must not return NaN"),
        ("count", "evaluate must return an array of shape"),
    ],
)
def test_a_problem_that_breaks_while_it_runs_fails_the_job_and_not_the_cluster(cluster, own_problem, trouble, said):
    result = cluster.submit(supernode.load(own_problem(f'trouble = "{trouble}"'))).result(timeout=30)
    assert (result.status, result.solved) == ("failed", False)
    assert said in result.message
    assert math.isfinite(result.fitness), "the best so far is kept"
    assert cluster.submit(supernode.load(own_problem(name="sound.toml"))).result().solved


FENCED = [
    ("decode(self, genome)", "raise KeyError('x')", "decode raised KeyError: 'x'"),
    ("decode(self, genome)", "return [1, 2]", "decode must return a table of named values, got [1, 2]"),
    ("decode(self, genome)", "return {'x': np.ones(2)}", "decode must return plain JSON values"),
    ("check(self, solution)", "return None", "check must return a supernode.Verdict"),
    ("check(self, solution)", "raise OSError('y')", "check raised OSError: y"),
    ("evaluate(self, genomes)", "raise SystemExit(5)", "evaluate raised SystemExit: 5"),
]


@pytest.mark.parametrize(("method", "body", "said"), FENCED)
def test_whatever_a_users_code_does_instead_is_one_message(cluster, own_problem, tmp_path, method, body, said):
    path = own_problem()
    module = tmp_path / "own_module.py"
    module.write_text(module.read_text() + f"\n    def {method}:\n        {body}\n")
    result = cluster.submit(supernode.load(path)).result(timeout=30)
    assert result.status == "failed"
    assert said in result.message
    assert len(result.message.splitlines()) == 1
    assert cluster.submit(supernode.load(own_problem(name="sound.toml"))).result().solved


def test_a_target_that_is_no_number_is_bad_input(cluster, own_problem, tmp_path):
    path = own_problem()
    module = tmp_path / "own_module.py"
    module.write_text(module.read_text().replace("return 0.0", "return 'abc'"))
    with pytest.raises(supernode.BadInput, match="solved_at must be a number or None, got 'abc'"):
        cluster.submit(supernode.load(path)).result()


def test_a_module_that_cannot_be_imported_is_bad_input(cluster, own_problem, tmp_path):
    path = own_problem()
    path.write_text('kind = "no_such_module:Thing"\n')
    with pytest.raises(supernode.BadInput, match=r"own.toml: kind: cannot import 'no_such_module:Thing'"):
        cluster.submit(supernode.load(path)).result()


def test_an_edited_module_is_not_mistaken_for_the_old_one(cluster, own_problem, tmp_path):
    path = own_problem("size = 16")
    assert cluster.submit(supernode.load(path)).result().fitness == 0.0
    module = tmp_path / "own_module.py"
    module.write_text(module.read_text().replace("return missing\n", "return missing + 7\n"))
    assert cluster.submit(supernode.load(path), stall=10).result().fitness == 7.0


def test_another_topology_than_the_clusters_is_taken_if_there_are_as_many_nodes(cluster, own_problem):
    file = supernode.load(own_problem())
    for topology in ("ring 12", "torus 3x3"):
        result = cluster.submit(file, topology=topology).result(timeout=30)
        assert (result.solved, result.topology) == (True, topology)
        assert result.history_sha256 == history(replay(file, topology=topology))
    with pytest.raises(supernode.BadInput, match=r"the job asks for 81 cells \(torus 9x9\), the cluster has 12 nodes"):
        cluster.submit(file, topology="torus 9x9")


def test_the_run_log_tells_what_was_heard_and_when(cluster, own_problem, tmp_path):
    log = tmp_path / "run.jsonl"
    job = cluster.submit(supernode.load(own_problem()), log=str(log))
    improvements = list(job.improvements())
    events = [json.loads(line) for line in log.read_text().splitlines()]
    heard = [event for event in events if event["event"] == "news"]
    assert [event["fitness"] for event in heard] == [better.fitness for better in improvements]
    assert all({"time", "seconds", "epoch", "generation", "cell"} <= event.keys() for event in heard)
    assert events[0]["event"] == "start"
    assert (events[-1]["event"], events[-1]["status"]) == ("end", "solved")


def test_equal_lockstep_runs_log_the_same_improvements_byte_for_byte(cluster, own_problem, tmp_path):
    file, logged = supernode.load(own_problem()), []
    for number in range(3):
        log = tmp_path / f"{number}.jsonl"
        result = cluster.submit(file, log=str(log), least_improvement=0.0).result()
        logged.append([line for line in log.read_text().splitlines() if '"event": "improvement"' in line])
    assert logged[0] == logged[1] == logged[2]
    last = json.loads(logged[0][-1])
    assert last.keys() == {"event", "epoch", "generation", "cell", "evaluations", "fitness"}, "no time is among them"
    assert (last["fitness"], last["cell"], last["generation"]) == (
        result.fitness,
        result.found_at["cell"],
        result.found_at["generation"],
    )
    assert 0 < last["evaluations"] <= result.evaluations


def test_the_improvements_of_a_run_are_those_of_its_simulation(cluster, own_problem):
    file = supernode.load(own_problem()).with_run(topology="torus 3x4", seed=9)
    job = cluster.submit(file)
    job.result()
    assert len(job.history()) > 3
    assert job.history() == records_of(Past(), Lived(file, simulate(Plan.of(file))))


def test_a_log_that_cannot_be_written_is_refused_at_once(cluster, own_problem, tmp_path):
    with pytest.raises(supernode.BadInput, match="--log: expected a file that can be written"):
        cluster.submit(supernode.load(own_problem()), log=str(tmp_path))
    assert cluster.submit(supernode.load(own_problem())).result(timeout=30).solved


@pytest.mark.parametrize("shape", ["1x1", "1x2", "2x2", "1x3"])
def test_small_shapes_where_neighbours_coincide(own_problem, shape):
    file = supernode.load(own_problem())
    topology = f"torus {shape}"
    with supernode.LocalCluster(topology=topology) as cluster:
        result = cluster.submit(file, generations=20, target=-1.0, deme=4).result()
    assert result.history_sha256 == history(replay(file, topology=topology, generations=20, target=-1.0, deme=4))


@pytest.mark.parametrize(
    "topology",
    [
        "moore 3x4",
        "grid 3x3",
        "ring 7",
        "complete 6",
        "hypercube 3",
        "random-regular 10 3",
        "small-world 12 4 0.3",
    ],
)
def test_any_topology_is_replayed_bit_for_bit(own_problem, topology):
    file = supernode.load(own_problem())
    runs = [{"generations": 12, "target": -1.0, "deme": deme} for deme in (1, 4)]
    with supernode.LocalCluster(topology=topology) as cluster:
        results = [cluster.submit(file, **run).result() for run in runs]
    links = {(cell, other) for cell, slots in enumerate(cluster.topology.table().tolist()) for other in slots}
    each = sum(cell != other for cell, other in links)
    for run, result in zip(runs, results, strict=True):
        assert result.history_sha256 == history(replay(file, topology=topology, **run))
        assert result.messages == {"sent": 12 * cluster.topology.cells, "received": 12 * each, "lost": 0, "rejected": 0}


def test_a_closed_cluster_says_so(own_problem):
    cluster = supernode.LocalCluster(torus=(1, 1))
    cluster.close()
    cluster.close()
    with pytest.raises(supernode.ClusterFailed, match="closed"):
        cluster.submit(supernode.load(own_problem()))


def test_closing_fails_the_job_that_runs(own_problem):
    cluster = supernode.LocalCluster(torus=(1, 2))
    job = cluster.submit(supernode.load(own_problem("size = 4000")), stall=10**6)
    next(job.improvements())
    cluster.close()
    assert job.result(timeout=10).message == "the cluster was closed"


def test_a_cluster_is_of_the_callers_session_but_ctrl_c_is_not_for_it():
    with supernode.LocalCluster(torus=(1, 2)) as cluster:
        processes = cluster.processes
        assert {os.getsid(process) for process in processes.values()} == {os.getsid(0)}
        assert os.getpgid(0) not in {os.getpgid(process) for process in processes.values()}


def test_a_crowd_takes_cores_neither_from_the_caller_nor_from_router_and_spy():
    with supernode.LocalCluster(topology="ring 100") as cluster:
        sessions = {name: os.getsid(process) for name, process in cluster.processes.items()}
    of_nodes = {sessions.pop(name) for name in list(sessions) if name.startswith("node ")}
    assert len(of_nodes) == 1
    others = {sessions["router"], sessions["spy"], os.getsid(0)}
    assert len(others | of_nodes) == 4


@pytest.mark.parametrize("begins", [True, False], ids=["a thread that begins late", "no thread was made"])
def test_a_cluster_closes_if_ctrl_c_came_while_a_job_was_handed_in(own_problem, monkeypatch, begins):
    start = threading.Thread.start

    def interrupted(thread):
        if not thread.name.startswith("conductor"):
            start(thread)
            return
        if begins:
            threading.Timer(0.3, start, [thread]).start()
        raise KeyboardInterrupt

    if not begins:
        monkeypatch.setattr("coordinator.jobs.dispatcher._BEGUN_WITHIN", 0.1)
    file, cluster = supernode.load(own_problem()), supernode.LocalCluster(torus=(2, 2))
    processes = cluster.processes.values()
    with cluster:
        monkeypatch.setattr(threading.Thread, "start", interrupted)
        with pytest.raises(KeyboardInterrupt):
            cluster.submit(file)
    assert not any(Path(f"/proc/{process}").exists() for process in processes)
