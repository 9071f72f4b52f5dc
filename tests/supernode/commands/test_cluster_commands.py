"""The commands that talk to a running cluster, as a person types them, with a coordinator that the test plays."""

import json
import os
import socket
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import pytest
from command_line import in_process

from coordinator.store.database import url_in
from coordinator.store.job_store import Store
from problems import BadInput
from supernode.client.cluster_info import ClusterInfo, occupy, read_info, remove_info, write_info

COMMANDS = ("up", "down", "status", "submit", "jobs", "watch", "cancel", "update", "rewire")


@pytest.fixture
def supernode(service, capsys):
    """Runs a command on the service: exit code, stdout and stderr."""

    def run(*arguments, connect=True):
        place = ["--connect", service.endpoint] if connect else []
        return in_process(capsys, *arguments, *place)

    return run


def soon(*steps):
    def run():
        for step in steps:
            time.sleep(0.1)
            step()

    thread = threading.Thread(target=run)
    thread.start()
    return thread


def test_each_command_has_help_and_an_example(supernode):
    for command in COMMANDS:
        code, out, _ = supernode(command, "--help", connect=False)
        assert code == 0
        assert f"supernode {command}" in out.split("example:")[1]


def test_submit_prints_the_id_and_jobs_lists_it(supernode, service, file):
    code, out, err = supernode("submit", file, "--seed", 7, "--torus", "2x2", "--priority", -3)
    job = out.strip()
    assert (code, err) == (0, "")
    assert json.loads(service.jobs[job]["file"])[2] == {"seed": 7, "topology": "torus 2x2"}
    assert service.jobs[job]["priority"] == -3
    assert supernode("submit", file, "--id", "mine")[1] == "mine\n"
    assert supernode("submit", file, "--id", "kept", "--keep-alive")[0] == 0
    assert json.loads(service.jobs.pop("kept")["file"])[2] == {"keep_alive": True}
    assert json.loads(supernode("submit", file, "--id", "mine", "--json")[1]) == {"job": "mine", "status": "queued"}
    code, out, _ = supernode("jobs")
    title, first, second = out.splitlines()
    assert title.split()[:4] == ["job", "kind", "status", "fitness"]
    assert (first.split()[0], second.split()[0]) == (job, "mine")
    listed = json.loads(supernode("jobs", "--json")[1])
    assert [each["job"] for each in listed] == [job, "mine"]
    assert {"job", "kind", "status", "fitness", "submitted"} <= set(listed[0])


def test_one_job(supernode, service, file):
    supernode("submit", file, "--id", "a")
    service.improve("a", 2.5)
    code, out, _ = supernode("jobs", "a")
    assert (code, out.splitlines()[0]) == (0, "a: queued")
    assert "best: fitness 2.5, generation 3 of epoch 0" in out
    assert json.loads(supernode("jobs", "a", "--json")[1])["best"]["fitness"] == 2.5


def test_watch_shows_improvements_and_the_result(supernode, service, file):
    supernode("submit", file, "--id", "a")
    service.improve("a", 9)
    shown = partial(service.wait_until_asked, "show")
    thread = soon(shown, lambda: service.improve("a", 0), lambda: service.end("a"))
    code, out, err = supernode("watch", "a")
    thread.join()
    assert code == 0
    assert [line.split()[-2:] for line in err.splitlines()] == [["9", "feasible"], ["0", "feasible"]]
    assert out.splitlines()[0] == "solved: fitness 0, found by cell (0, 2) in generation 3"
    code, out, err = supernode("watch", "a", "--json", "--quiet")
    assert (code, err, json.loads(out)["status"]) == (0, "", "solved")


def test_watch_says_of_a_job_that_is_kept_alive_whether_it_waits_or_searches(supernode, service, file):
    supernode("submit", file, "--id", "a", "--keep-alive")
    service.improve("a", 9)
    service.tell("a", "searching")
    shown = partial(service.wait_until_asked, "show")
    retry = {"epoch": 3, "do": "retry", "attempt": 2, "seed": 77, "fields": {"commands": 16}}

    def solved():
        service.jobs["a"].update(epoch=3, epochs=[retry])
        service.improve("a", 0, epoch=3)

    steps = [solved, partial(service.tell, "a", "waiting"), partial(service.end, "a", "cancelled")]
    thread = soon(shown, *steps)
    code, _, err = supernode("watch", "a")
    thread.join()
    assert code == 3
    first, searching, anew, best, waiting = err.splitlines()
    assert first.endswith("fitness 9  feasible")
    assert searching.startswith("searching: it stalled without an answer, and begins anew until it has one (`supernode")
    assert anew == "stalled: begins anew, restart 2, seed 77, commands = 16"
    assert best.endswith("fitness 0  feasible")
    assert waiting.startswith("waiting: it is kept alive for an update (`supernode cancel a` ends it")


def test_watch_ends_as_the_job_did(supernode, service, file):
    supernode("submit", file, "--id", "a")
    service.tell("a", "cancelled")
    code, out, _ = supernode("watch", "a")
    assert (code, out.splitlines()[0]) == (3, "cancelled: it was still waiting for nodes, and never ran")
    supernode("submit", file, "--id", "b")
    service.tell("b", "failed", message="two nodes fell asleep")
    code, _, err = supernode("watch", "b")
    assert (code, err) == (1, "error: two nodes fell asleep\n")


def test_a_world_that_moves_is_shown_with_its_topology(supernode, service, file):
    supernode("submit", file, "--id", "a", "--torus", "2x2")
    service.jobs["a"]["epochs"].append({"epoch": 1, "topology": "ring 16"})
    service.jobs["a"]["epoch"] = 1
    service.improve("a", 3, epoch=0)
    shown = partial(service.wait_until_asked, "show")
    thread = soon(shown, lambda: service.improve("a", 5, epoch=1), lambda: service.end("a"))
    _, _, err = supernode("watch", "a")
    thread.join()
    assert "cell (1, 0)  fitness 3" in err
    assert "epoch 1: ring 16\n" in err
    assert "cell (2)  fitness 5" in err


def test_solve_on_a_running_cluster(supernode, service, file, tmp_path):
    log = tmp_path / "run.jsonl"

    def play():
        service.wait_until_asked("submit")
        (job,) = service.jobs
        soon(lambda: service.improve(job, 1), lambda: service.end(job)).join()

    thread = threading.Thread(target=play)
    thread.start()
    code, out, err = supernode("solve", file, "--json", "--log", log)
    thread.join()
    result = json.loads(out)
    assert (code, result["status"], result["fitness"]) == (0, "solved", 1.0)
    assert "fitness 1" in err
    logged = [json.loads(line) for line in log.read_text().splitlines()]
    assert [line["event"] for line in logged] == ["start", "news", "improvement", "end"]
    noted = {"epoch": 0, "generation": 3, "cell": [0, 2], "evaluations": 400, "fitness": 1.0}
    assert logged[2] == {"event": "improvement", **noted}


def test_cancel_update_and_rewire(supernode, service, file, tmp_path):
    supernode("submit", file, "--id", "a")
    patch = tmp_path / "patch.toml"
    patch.write_text("goal = [1.0, 2.0]\n[robot]\nradius = 0.5\n")
    assert supernode("update", "a", patch)[:2] == (0, "a: epoch 1\n")
    assert json.loads(service.jobs["a"]["epochs"][0]) == {"goal": [1.0, 2.0], "robot": {"radius": 0.5}}
    for text, said in (("", "expected keys of a problem file, found nothing"), ("goal = [", "expected TOML, found ")):
        patch.write_text(text)
        assert supernode("update", "a", patch)[2].startswith(f"error: {patch}: {said}")
    no_such = f"error: {tmp_path}/none.toml: expected a patch of a problem file, found no such file\n"
    assert supernode("update", "a", tmp_path / "none.toml") == (2, "", no_such)
    assert json.loads(supernode("rewire", "a", "--topology", "ring 16", "--json")[1]) == {"job": "a", "epoch": 2}
    assert json.loads(supernode("rewire", "a", "--torus", "2x8", "--json")[1]) == {"job": "a", "epoch": 3}
    assert service.jobs["a"]["epochs"][1] == "ring 16"
    assert supernode("cancel", "a")[:2] == (0, "a is being cancelled (it was queued)\n")
    assert supernode("watch", "a")[0] == 3


def test_status_is_a_table_of_nodes(supernode, service):
    node = {"node": 0, "process": 4711, "job": "a", "cell": [0, 1], "epoch": 2, "generation": 37, "seconds": 12.3,
            "reported": 1.6, "memory": 7_000_000, "sent": 40, "received": 160}  # fmt: skip
    idle = node | {"node": 1, "job": None, "cell": None, "epoch": None, "generation": None, "reported": None}
    status = {"cluster": "fake", "version": "0", "nodes": [node, idle], "placements": [], "jobs": {"running": 1}}
    service.value = lambda _: status
    code, out, _ = supernode("status")
    head, titles, first, second = out.splitlines()
    assert code == 0
    assert head == "cluster fake, supernode 0: 2 nodes; jobs: 1 running"
    assert titles == "node  process  job  cell    epoch  generation  age  reported  memory  sent  received"
    assert first.split() == ["0", "4711", "a", "(0,", "1)", "2", "37", "12", "2", "7.0", "MB", "40", "160"]
    assert second.split() == ["1", "4711", "-", "-", "-", "-", "12", "-", "7.0", "MB", "40", "160"]
    assert json.loads(supernode("status", "--json")[1])["nodes"] == [node, idle]


def test_status_shows_how_jobs_are_spread_over_hosts(supernode, service):
    nodes = [{"node": 0, "job": "a", "host": "left"}, {"node": 1, "job": "a", "host": "right"}]
    spread = {"job": "a", "hosts": {"left": 1, "right": 1}, "crossing": 4, "edges": 8}
    service.value = lambda _: {"cluster": "fake", "version": "0", "nodes": nodes, "placements": [spread], "jobs": {}}
    code, out, err = supernode("status")
    assert (code, err) == (0, "")
    _, placement, titles, first, _ = out.splitlines()
    assert placement == "job a: cells by host: left 1, right 1; 4 of 8 edges cross (50%)"
    assert titles.endswith("  host")
    assert first.endswith("  left")


@pytest.mark.parametrize(
    ("arguments", "said", "code"),
    [
        (["watch", "none"], "there is no job 'none'", 2),
        (["cancel", "none"], "there is no job 'none'", 2),
        (["jobs", "none"], "there is no job 'none'", 2),
        (["jobs", "no job"], "expected a job's id", 2),
        (["rewire", "a", "--topology", "cube"], "--topology: expected a topology", 2),
        (["rewire", "a", "--torus", "cube"], "--torus: expected rows and columns", 2),
        (["rewire", "a"], "--topology", 2),
        (["update", "none", "none.toml"], "there is no job 'none'", 2),
        (["submit", "none.toml"], "none.toml: expected a problem file", 2),
    ],
)
def test_whatever_is_wrong_is_one_line(supernode, arguments, said, code):
    found, out, err = supernode(*arguments)
    assert (found, out, len(err.splitlines())) == (code, "", 1), err
    assert err.startswith("error: ")
    assert said in err


def test_where_no_cluster_is_up(supernode, tmp_path, file):
    for arguments in (["status"], ["down"], ["jobs"], ["submit", file], ["solve", file], ["watch", "a"]):
        code, out, err = supernode(*arguments, "--state", tmp_path / "x", connect=False)
        assert (code, out) == (1, "")
        assert err == f"error: no cluster is up in {tmp_path / 'x'}; start one with `supernode up`\n"
    code, _, err = supernode("status", "--connect", "nowhere", connect=False)
    assert (code, err) == (2, "error: --connect: expected an endpoint such as tcp/127.0.0.1:7447, found nowhere\n")
    code, _, err = supernode("status", "--connect", "tcp/127.0.0.1:9", connect=False)
    assert (code, err) == (1, "error: no cluster answers at tcp/127.0.0.1:9\n")


def test_down_waits_until_the_lifeline_has_ended(supernode, service, tmp_path):
    lifeline = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    threading.Thread(target=lifeline.wait).start()  # or it stays as a zombie
    write_info(tmp_path, ClusterInfo(service.endpoint, "fake", lifeline.pid, "0"))
    soon(lambda: service.wait_until_asked("down"), lifeline.terminate)
    code, out, _ = supernode("down", "--state", tmp_path, connect=False)
    assert (code, out) == (0, f"down: {tmp_path}\n")
    with pytest.raises(ProcessLookupError):
        os.kill(lifeline.pid, 0)


def test_down_from_afar_waits_until_the_coordinator_has_ended_and_says_what_lives_on(supernode, service):
    service.ends = "coordinator"
    code, out, _ = supernode("down")
    assert (code, out) == (
        0,
        f"down: {service.endpoint}; router, spy and nodes end where they were started, or with `up --on`\n",
    )
    assert service.session is None


def test_down_ends_a_lifeline_whose_cluster_is_silent(supernode, service, tmp_path):
    service.stop()
    lifeline = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    threading.Thread(target=lifeline.wait).start()
    write_info(tmp_path, ClusterInfo(service.endpoint, "fake", lifeline.pid, "0"))
    lock = occupy(tmp_path)  # without it the entry would be that of a cluster killed long ago
    assert supernode("down", "--state", tmp_path, connect=False)[0] == 0
    with pytest.raises(ProcessLookupError):
        os.kill(lifeline.pid, 0)
    os.close(lock)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--nodes", "0"], "--nodes: expected at least 1, found 0"),
        (["--topology", "cube"], "--topology: expected a topology"),
        (["--listen", "here"], "--listen: expected an endpoint"),
        (["--max-queue", "-1"], "--max-queue: expected at least 0"),
        (["--client-nodes", "0"], "--client-nodes: expected at least 1"),
        (["--nodes", "4", "--torus", "2x2"], "not allowed with"),
    ],
)
def test_bad_options_of_up(supernode, tmp_path, arguments, said):
    for detach in ([], ["--detach"]):
        done = subprocess.run(
            [sys.executable, "-m", "supernode", "up", "--state", str(tmp_path), *arguments, *detach],
            capture_output=True, text=True, timeout=60, check=False,
        )  # fmt: skip
        assert (done.returncode, done.stdout) == (2, "")
        (line,) = done.stderr.splitlines()
        assert line.startswith("error: ")
        assert said in line


@pytest.mark.parametrize("command", [["up", "--torus", "1x1"], ["up", "--torus", "1x1", "--detach"], ["router"]])
def test_a_port_that_is_taken_is_one_line_that_names_it(tmp_path, command):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        state = ["--state", str(tmp_path)] if command[0] == "up" else []
        done = subprocess.run(
            [sys.executable, "-m", "supernode", *command, "--listen", endpoint, *state],
            capture_output=True, text=True, timeout=120, check=False,
        )  # fmt: skip
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr in (
        f"error: router cannot listen at {endpoint}: Address already in use\n",
        f"error: cannot listen at {endpoint}: Address already in use\n",
    )


def test_a_second_up_in_one_folder_is_refused(supernode, tmp_path):
    lock = occupy(tmp_path)
    code, _, err = supernode("up", "--state", tmp_path, connect=False)
    assert (code, err) == (1, f"error: a cluster is up in {tmp_path} already; end it with `supernode down`\n")
    os.close(lock)


def test_the_state_folder_is_private_and_its_card_comes_and_goes(tmp_path):
    folder = tmp_path / "state" / "supernode"
    lock = occupy(folder)
    assert folder.stat().st_mode & 0o777 == 0o700
    info = ClusterInfo("tcp/127.0.0.1:1", "c", os.getpid(), "0")
    write_info(folder, info)
    assert read_info(folder) == info
    remove_info(folder)
    remove_info(folder)
    assert [path.name for path in folder.iterdir()] == ["up.lock"]
    os.close(lock)


def test_a_folder_that_is_there_keeps_its_mode(tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    for mode in (0o755, 0o775, 0o500 | 0o200):
        home.chmod(mode)
        os.close(occupy(home))
        assert home.stat().st_mode & 0o777 == mode
    home.chmod(0o1777)
    with pytest.raises(BadInput, match=f"^--state: expected a folder that not every user may write into, found {home}"):
        occupy(home)


def test_what_tells_of_jobs_is_private_in_a_folder_that_is_not(tmp_path):
    tmp_path.chmod(0o755)
    Store(url_in(tmp_path)).close()
    assert {path.name: path.stat().st_mode & 0o077 for path in tmp_path.iterdir()} == {
        "jobs.sqlite": 0,
        "jobs.sqlite.lock": 0,
    }


def test_listing_jobs_and_status_load_no_compiled_kernels():
    script = (
        "import sys, supernode.client.client, supernode.commands.jobs, supernode.client.cluster_info\n"
        "assert 'numba' not in sys.modules\n"
    )
    root = Path(__file__).resolve().parents[3]
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=root)
    assert done.returncode == 0, done.stderr
