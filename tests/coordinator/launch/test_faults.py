"""Processes are killed for real where none is replaced; whatever dies, all end within 5 s and leave no file behind."""

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

ENDS_WITHIN = 5.0

HOLDER = """
import json, sys
import supernode
with supernode.LocalCluster(torus=(2, 3), on_node_death="fail") as cluster:
    folder = str(cluster._launcher.folder)
    print(json.dumps({"processes": cluster.processes, "folder": folder}), flush=True)
    if sys.argv[1] == "idle":
        sys.stdin.read()
    job = cluster.submit(supernode.load(sys.argv[1]), stall=10**6)
    next(job.improvements())
    print("running", flush=True)
    result = job.result()
    print(json.dumps({"status": result.status, "message": result.message, "fitness": result.fitness}), flush=True)
    try:
        cluster.submit(supernode.load(sys.argv[1]))
    except supernode.ClusterFailed as error:
        print(json.dumps(str(error)), flush=True)
"""


class Holder:
    """A process that holds a cluster open, with a job running on it or idle."""

    def __init__(self, problem):
        self.process = subprocess.Popen(
            [sys.executable, "-c", HOLDER, problem],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        told = json.loads(self.process.stdout.readline())
        self.cluster = told["processes"]
        self.folder = Path(told["folder"])
        self.zygote = int(Path(f"/proc/{self.cluster['router']}/stat").read_text().rsplit(")", 1)[1].split()[1])
        self.watched = [os.pidfd_open(process) for process in [*self.cluster.values(), self.zygote]]
        assert self.folder.is_dir()
        if problem != "idle":
            assert self.process.stdout.readline() == "running\n"

    def gone_within(self, seconds):
        """Whether every process of the cluster has ended by then."""
        deadline = time.monotonic() + seconds
        waiting = list(self.watched)
        while waiting:
            ready, _, _ = select.select(waiting, [], [], max(0.0, deadline - time.monotonic()))
            if not ready:
                return False
            waiting = [descriptor for descriptor in waiting if descriptor not in ready]
        return True

    def close(self):
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout, self.process.stderr):
            pipe.close()
        for descriptor in self.watched:
            os.close(descriptor)


@pytest.fixture
def holder(own_problem, request):
    problem = "idle" if request.param == "idle" else str(own_problem("size = 4000"))
    holder = Holder(problem)
    yield holder
    holder.close()


def kill(holder, name):
    victim = {"parent": holder.process.pid, "zygote": holder.zygote}.get(name) or holder.cluster[name]
    os.kill(victim, signal.SIGKILL)


@pytest.mark.parametrize("holder", ["job", "idle"], indirect=True)
@pytest.mark.parametrize("name", ["parent", "router", "zygote", "spy", "node 0", "node 4"])
def test_when_one_is_killed_all_end_and_nothing_is_left(holder, name):
    kill(holder, name)
    assert holder.gone_within(ENDS_WITHIN)
    if name == "zygote":
        holder.process.stdin.close()
        holder.process.wait(ENDS_WITHIN)  # it is the caller who removes the folder then
    assert not holder.folder.exists()


@pytest.mark.parametrize("holder", ["job"], indirect=True)
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("node 4", "node 4 killed by SIGKILL (cell (1, 1))"),
        ("router", "router killed by SIGKILL"),
        ("spy", "spy killed by SIGKILL"),
        ("zygote", "the zygote ended"),
    ],
)
def test_the_job_fails_in_time_naming_who_died(holder, name, said):
    began = time.monotonic()
    kill(holder, name)
    result = json.loads(holder.process.stdout.readline())
    assert time.monotonic() - began < ENDS_WITHIN
    assert (result["status"], result["message"]) == ("failed", said)
    assert result["fitness"] < 4000, "the best so far is kept"
    assert json.loads(holder.process.stdout.readline()) == said, "the cluster takes no further job"


@pytest.mark.parametrize("holder", ["idle"], indirect=True)
def test_when_all_are_killed_at_once_the_next_cluster_removes_the_folder(holder):
    for process in (holder.process.pid, holder.zygote):
        os.kill(process, signal.SIGKILL)
    assert holder.gone_within(ENDS_WITHIN)
    holder.process.wait()
    if holder.folder.exists():
        old = time.time() - 60
        os.utime(holder.folder, (old, old))
        from coordinator.launch.folders import _remove_stale_folders

        _remove_stale_folders()
    assert not holder.folder.exists()


def test_a_folder_in_use_is_not_stale():
    from coordinator.launch.folders import _home, _lock, _remove_stale_folders

    folder = Path(tempfile.mkdtemp(prefix="supernode-", dir=_home()))
    descriptor = _lock(folder)
    old = time.time() - 60
    os.utime(folder, (old, old))
    _remove_stale_folders()
    assert folder.exists()
    os.close(descriptor)
    _remove_stale_folders()
    assert not folder.exists()


def test_a_caller_that_dies_while_the_zygote_still_imports_takes_it_along():
    script = (
        "import os, sys\n"
        "from coordinator.launch.launcher import Launcher\n"
        "launcher = Launcher('test', 'torus 2x2', print)\n"
        "print(launcher._zygote.pid, launcher.folder, flush=True)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    told = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False).stdout
    zygote, folder = told.split()
    try:
        descriptor = os.pidfd_open(int(zygote))
    except ProcessLookupError:
        descriptor = None  # it has ended already
    if descriptor is not None:
        assert select.select([descriptor], [], [], ENDS_WITHIN)[0]
        os.close(descriptor)
    assert not Path(folder).exists()
