"""The life of `supernode up`, its launcher starting a played coordinator; see test_served_jobs.py for real ones."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from fake_service import FakeService

import supernode
from coordinator.launch.launcher import ServiceOptions
from supernode.__main__ import main
from supernode.client.cluster_info import read_info
from supernode.launch import supervisor
from supernode.launch.detached import detached
from supernode.launch.supervisor import LaunchRequest, Supervisor

LISTEN = "tcp/127.0.0.1:0"


class FakeLauncher:
    """Starts a played coordinator."""

    latest = None

    def __init__(self, cluster, topology, on_death, *, service, force):
        FakeLauncher.latest = self
        self.asked = (topology, service)
        self.on_death = on_death
        self.closed = False
        self.started = threading.Event()
        self.started.set()
        self.service = FakeService(cluster)
        self.folder = self.service.folder

    def close(self):
        self.closed = True
        self.service.close()


def supervisor_in(folder):
    keep = {"max_queue": 5, "keep_records": 1000, "allow_modules": ("mine",)}
    return Supervisor(LaunchRequest("torus 2x2", ServiceOptions(state=folder, listen=(LISTEN,), **keep)))


@pytest.fixture(autouse=True)
def _played(monkeypatch):
    monkeypatch.setattr(supervisor, "Launcher", FakeLauncher)


def test_it_is_up_until_ctrl_c_and_leaves_no_card(tmp_path):
    seen = []

    def look(line):
        seen.append(line)
        with supernode.connect(tmp_path) as client:
            seen.append(client.status()["cluster"])
        seen.append(read_info(tmp_path))
        with pytest.raises(supernode.ClusterFailed, match=r"is up in .* already"):
            supervisor_in(tmp_path).run(tmp_path, print)
        os.kill(os.getpid(), signal.SIGINT)

    supervisor_in(tmp_path).run(tmp_path, look)
    line, cluster, info = seen
    assert line == f"up: 0 nodes (torus 2x2) in {tmp_path}, {LISTEN}"
    assert (info.cluster, info.process) == (cluster, os.getpid())
    topology, options = FakeLauncher.latest.asked
    assert topology == "torus 2x2"
    assert vars(options) == {
        "state": tmp_path,
        "database": None,
        "listen": (LISTEN,),
        "max_queue": 5,
        "client_nodes": None,
        "log_json": None,
        "keep_days": 30.0,
        "keep_records": 1000,
        "allow_modules": ("mine",),
        "modules": None,
        "node_timeout": 15.0,
        "eval_timeout": None,
        "node_memory": None,
        "checkpoint_every": 30.0,
        "keys": None,
        "sandbox": False,
    }
    assert FakeLauncher.latest.closed
    assert not (tmp_path / "cluster.json").exists()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_what_breaks_is_said(tmp_path):
    def run():
        supervisor_in(tmp_path).run(tmp_path, lambda _: FakeLauncher.latest.on_death("the zygote ended"))

    with pytest.raises(supernode.ClusterFailed, match="the zygote ended"):
        run()
    assert FakeLauncher.latest.closed
    assert not (tmp_path / "cluster.json").exists()
    supervisor_in(tmp_path).run(tmp_path, lambda _: os.kill(os.getpid(), signal.SIGTERM))


def in_a_process(script):
    """Standard output of a script that imports `detached`."""
    imported = "from pathlib import Path\nfrom supernode.launch.detached import detached, leave_terminal\n"
    header = f"import os, sys, time\n{imported}"
    root = Path(__file__).resolve().parents[3]
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", header + script], cwd=root, capture_output=True, text=True, timeout=60, check=False
    )
    assert time.monotonic() - began < 20
    return done


def test_detached_work_goes_on_and_has_no_terminal(tmp_path):
    log = tmp_path / "up.log"
    done = in_a_process(
        "def work(ready):\n"
        f"    leave_terminal(Path({str(log)!r}))\n"
        "    ready('it is up')\n"
        "    time.sleep(0.5)\n"
        "    print(os.getsid(0) == os.getpid(), flush=True)\n"
        "    raise RuntimeError('later')\n"
        "print(detached(work))\n"
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "it is up\n", "")
    for _ in range(100):
        if "later" in log.read_text():
            break
        time.sleep(0.05)
    assert log.read_text() == "True\nerror: later\n"
    assert log.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize(
    ("work", "said"),
    [
        ("from problems.errors import BadInput; raise BadInput('so not')", "problems.errors.BadInput: so not"),
        ("raise RuntimeError('broken')", "coordinator.errors.ClusterFailed: broken"),
        ("os._exit(3)", "coordinator.errors.ClusterFailed: the cluster ended before it was ready"),
    ],
)
def test_detached_work_that_does_not_start(work, said):
    done = in_a_process(f"def work(ready):\n    {work}\ndetached(work)\n")
    assert done.stderr.splitlines()[-1] == said


def test_detached_is_importable_without_anything_that_has_threads():
    assert (
        "numpy"
        not in subprocess.run(
            [sys.executable, "-c", "import sys, supernode.launch.detached; print(list(sys.modules))"],
            cwd=Path(__file__).resolve().parents[3],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
    )
    assert detached.__doc__


def test_a_database_that_cannot_be_used_is_one_error_before_anything_is_launched(tmp_path, capsys):
    pytest.importorskip("psycopg")
    nowhere = f"postgresql://ada@/jobs?host={tmp_path}"
    assert main(["up", "--torus", "1x1", "--state", str(tmp_path / "state"), "--database", nowhere]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    assert line.startswith("error: store postgresql")
