"""The oracle beside a run: what it decides, what it costs, and that its process leaves nothing behind."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from jointed_robots import chain

import supernode
from coordinator.jobs import consulting as consulting_module
from coordinator.jobs.consulting import Consulting
from problems import Answer, load
from problems.oracle_bounds import OracleBounds, meaning
from supernode.__main__ import main

ROOT = Path(__file__).resolve().parents[3]
CLOSED = """
kind = "mobile-robot"
start = [1.0, 1.0, 0.0]
goal = [7.0, 5.0, 0.0]
bounds = [0.0, 0.0, 8.0, 6.0]
robot.radius = 0.3
[[obstacles]]
shape = "box"
center = [4.0, 3.0]
size = [0.3, 6.0]
[run]
torus = "2x2"
stall = 100000
"""
OWN = """
import os
import time

import numpy as np
import supernode


class Own(supernode.Problem):
    does: str

    @property
    def coding(self):
        return supernode.BitString(16, 1)

    def evaluate(self, genomes):
        return 5.0 + genomes.sum(axis=1)

    def oracle(self):
        while self.does == "takes too long":
            pass
        if self.does == "dies":
            os.abort()
        if self.does == "takes too much memory":
            return bytearray(1 << 31)
        if self.does == "sleeps":
            time.sleep(600)
        if self.does == "raises":
            raise RuntimeError("out of paper")
        return supernode.Answer("optimum", np.inf if self.does == "forbids" else 5.0, "thought")


class Silent(Own):
    oracle_decides = False
"""
PATIENCE = 60.0  # seconds


@pytest.fixture
def closed(tmp_path):
    path = tmp_path / "closed.toml"
    path.write_text(CLOSED)
    return path


@pytest.fixture
def terrain(tmp_path):
    """Without the target of its file, which is the optimum."""
    path = tmp_path / "terrain.toml"
    path.write_text((ROOT / "examples" / "terrain.toml").read_text().partition("target = ")[0])
    return path


@pytest.fixture
def own(tmp_path):
    """A problem file whose oracle does so."""

    def write(does, name="Own"):
        (tmp_path / "oracles.py").write_text(OWN)
        path = tmp_path / "own.toml"
        path.write_text(f'kind = "oracles:{name}"\ndoes = "{does}"\n[run]\ntorus = "2x2"\nstall = 3\n')
        return path

    return write


def wait_for(consulting):
    """Look until there is no need to look any more."""
    until = time.monotonic() + PATIENCE
    while (look_at := consulting.look_at) is not None:
        assert time.monotonic() < until
        time.sleep(max(0.0, look_at - time.monotonic()))
        consulting.look()
    return consulting.bounds


def is_gone(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    state = Path(f"/proc/{process}/stat")
    return not state.exists() or state.read_text().rpartition(")")[2].split()[0] == "Z"  # nobody may reap orphans


def wait_until(happened):
    until = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < until
        time.sleep(0.01)


def asked_by(parent):
    """The processes of oracles that a process has started."""
    threads = Path(f"/proc/{parent}/task").iterdir()
    found = [int(each) for thread in threads for each in (thread / "children").read_text().split()]
    return [each for each in found if "problems.oracle_process" in Path(f"/proc/{each}/cmdline").read_text()]


# What it decides ------------------------------------------------------------------------------------------------------
def test_a_run_ends_when_the_oracle_says_that_there_is_no_way_and_is_repeated_so(closed, tmp_path, capfd):
    assert main(["solve", str(closed), "--json", "--quiet"]) == 3
    result = json.loads(capfd.readouterr().out)
    assert (result["status"], result["solved"], result["solution"]) == ("infeasible", False, None)
    assert result["oracle"].startswith("there is no way: visibility graph: the goal is out of reach; no fitness is ")
    assert result["advice"] == []
    (stop,) = [each for each in result["directives"] if each["do"] == "stop"]
    assert stop["reason"] == "infeasible"
    kept = tmp_path / "result.json"
    kept.write_text(json.dumps(result))
    assert main(["simulate", str(closed), "--replay", str(kept), "--json", "--quiet"]) == 3
    told = capfd.readouterr()
    repeated = json.loads(told.out)
    assert told.err == ""
    same = ("status", "oracle", "directives", "history_sha256", "generations", "fitness", "advice")
    assert {name: repeated[name] for name in same} == {name: result[name] for name in same}


def test_the_words_say_that_there_is_no_way_also_of_a_simulation(closed, capfd):
    assert main(["simulate", str(closed), "--quiet"]) == 3
    first, second, *_ = capfd.readouterr().out.splitlines()
    assert first.startswith("infeasible: no solution; the best attempt has fitness ")
    assert second.startswith("  there is no way: visibility graph: the goal is out of reach")


@pytest.mark.parametrize("command", ["solve", "simulate"])
def test_the_optimum_is_named(terrain, command, capfd):
    assert main([command, str(terrain), "--quiet", "--stall", "60"]) == 0
    first, second, *others = capfd.readouterr().out.splitlines()
    assert first.startswith("optimal: fitness 25.4853, found by cell ")
    assert second == "  this is the optimum, by Dijkstra's algorithm over all cells"
    assert not [line for line in others if "to search further" in line]


def test_a_search_that_stalls_before_the_optimum_says_which_it_is_and_what_to_turn(terrain, capfd):
    options = ("--stall", "1", "--torus", "1x1", "--recipe", "paper", "--quiet")
    assert main(["simulate", str(terrain), *options]) == 3
    first, second, *others = capfd.readouterr().out.splitlines()
    assert first.startswith("stalled: no solution; the best attempt has fitness ")
    assert second == "  the optimum is 25.4853, by Dijkstra's algorithm over all cells"
    advice = (
        "  to search further, try --torus 2x2, --deme 4, --stall 5 or another --seed (this run: torus 1x1, deme 1, "
    )
    assert [line for line in others if line.startswith(advice)]


def test_a_target_of_the_users_is_searched_for_to_the_limit_though_nothing_reaches_it(closed):
    file = load(closed).with_run(target=-1.0, generations=300, restarts=0)
    result = supernode.simulate(file)
    assert (result.status, result.generations, result.oracle) == ("exhausted", 300, None)


@pytest.mark.parametrize("command", ["solve", "simulate"])
def test_nobody_is_asked_unasked(closed, command, capfd):
    options = ("--no-oracle", "--stall", "200", "--restarts", "0", "--quiet", "--json")
    assert main([command, str(closed), *options]) == 3
    result = json.loads(capfd.readouterr().out)
    assert (result["status"], result["oracle"], result["run"]["oracle"]) == ("stalled", None, False)
    assert any("--stall 1000" in line for line in result["advice"])


def test_the_oracle_of_a_users_own_kind_is_asked_when_the_run_has_stalled(own):
    with supernode.LocalCluster(torus="2x2") as cluster:
        found = {does: cluster.submit(load(own(does))).result() for does in ("forbids", "tells", "raises")}
        silent = cluster.submit(load(own("forbids", "Silent"))).result()
    assert {does: (each.status, each.oracle) for does, each in found.items()} == {
        "forbids": ("infeasible", "there is no way: thought"),
        "tells": ("optimal", "this is the optimum, by thought")
        if found["tells"].fitness == 5.0
        else ("stalled", "the optimum is 5, by thought"),
        "raises": ("stalled", None),
    }
    assert (silent.status, silent.oracle) == ("stalled", None)


@pytest.mark.parametrize(
    ("answer", "target", "bounds"),
    [
        (Answer("optimum", 2.0, "m"), None, OracleBounds(False, 2.0, True, "m")),
        (Answer("optimum", 2.0, "m"), 1.0, OracleBounds(True, 2.0, True, "m")),
        (Answer("optimum", 1.0000005, "m"), 1.0, OracleBounds(False, 1.0000005, True, "m")),
        (Answer("lower bound", 2.0, "m"), 2.0, OracleBounds(False, 2.0, False, "m")),
        (Answer("lower bound", 2.0, "m"), 0.0, OracleBounds(True, 2.0, False, "m")),
        (Answer("lower bound", float("inf"), "m"), None, OracleBounds(True, None, False, "m")),
        (Answer("upper bound", 2.0, "m"), 0.0, OracleBounds(False, None, False, "m")),
        (Answer("upper bound", float("inf"), "m"), 0.0, OracleBounds(False, None, False, "m")),
    ],
)
def test_what_an_answer_means(answer, target, bounds):
    assert meaning(answer, target) == bounds
    assert OracleBounds.from_json(bounds.to_json()) == bounds


@pytest.mark.parametrize("kind", ["function", "min-time", "sphere-path"])
def test_yardsticks_decide_nothing(kind):
    example = "rastrigin" if kind == "function" else kind
    consulting = Consulting()
    consulting.turn_to(load(ROOT / "examples" / f"{example}.toml"))
    assert consulting.look_at is None


# When it is asked -----------------------------------------------------------------------------------------------------
def test_it_is_asked_only_after_half_a_second_of_search(closed):
    consulting, before = Consulting(), time.monotonic()
    consulting.turn_to(load(closed))
    assert consulting.look_at >= before + 0.5
    assert consulting.look() is None
    assert consulting.process is None


def test_an_oracle_that_rules_nothing_out_waits_for_a_stall(tmp_path, monkeypatch):
    monkeypatch.setattr(consulting_module, "_ENDS_AFTER", PATIENCE)  # a busy machine may import for longer
    (tmp_path / "chain.urdf").write_text(chain())
    path = tmp_path / "chain.toml"
    path.write_text(
        'kind = "robot-path"\nstart = [0.0, 0.0, 0.3]\ngoal = [0.5, 0.2, 0.0]\n[robot]\nurdf = "chain.urdf"\n'
    )
    consulting = Consulting()
    consulting.turn_to(load(path))
    assert consulting.look_at is None
    consulting.ask()
    assert wait_for(consulting).is_optimum


def test_another_problem_is_asked_about_anew_and_another_attempt_is_not(closed):
    consulting, file = Consulting(), load(closed)
    consulting.turn_to(file)
    consulting.ask()
    assert wait_for(consulting).hopeless
    consulting.turn_to(file.next_attempt({"commands": 20}))
    assert consulting.bounds is not None
    assert consulting.look_at is None
    consulting.turn_to(file.changed({"goal": [2.0, 1.0, 0.0]}, {}))
    assert consulting.bounds is None
    consulting.ask()
    assert not wait_for(consulting).hopeless


@pytest.mark.parametrize("settings", [{"oracle": False}, {"keep_alive": True}])
def test_a_job_that_wants_no_oracle_or_waits_for_another_epoch_asks_nobody(closed, settings):
    consulting = Consulting()
    consulting.turn_to(load(closed).with_run(**settings))
    consulting.ask()
    assert (consulting.look_at, consulting.process) == (None, None)


# What may go wrong ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("does", ["takes too long", "takes too much memory", "dies", "raises"])
def test_an_oracle_that_comes_to_nothing_changes_nothing(own, does):
    consulting = Consulting()
    consulting.turn_to(load(own(does)))
    consulting.ask()
    process = consulting.process
    assert wait_for(consulting) is None
    assert is_gone(process)


def test_a_run_whose_oracle_is_killed_ends_as_it_would_without(own):
    with supernode.LocalCluster(torus="2x2") as cluster:
        job = cluster.submit(load(own("sleeps")))
        wait_until(lambda: asked_by(os.getpid()))
        os.kill(asked_by(os.getpid())[0], signal.SIGKILL)
        result = job.result(PATIENCE)
    assert (result.status, result.oracle) == ("stalled", None)


def test_its_process_ends_with_the_job(own):
    with supernode.LocalCluster(torus="2x2") as cluster:
        job = cluster.submit(load(own("sleeps")))
        wait_until(lambda: asked_by(os.getpid()))
        (process,) = asked_by(os.getpid())
        job.cancel()
        assert job.result(PATIENCE).oracle is None
        assert is_gone(process)


def test_its_process_dies_with_whoever_asked(own):
    script = (
        "import sys; from coordinator.jobs.consulting import Consulting; from problems import load\n"
        "consulting = Consulting(); consulting.turn_to(load(sys.argv[1])); consulting.ask()\n"
        "print(consulting.process, flush=True); sys.stdin.read()\n"
    )
    command = [sys.executable, "-c", script, str(own("sleeps"))]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as parent:
        process = int(parent.stdout.readline())
        assert not is_gone(process)
        parent.kill()
        parent.wait()
        wait_until(lambda: is_gone(process))
