"""Users' modules in the sandbox: no network, little memory; and the same modules without it."""

import os
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest
from command_line import in_process
from live_service import ROOT, live, log_texts
from places import until
from user_namespaces import needs_namespaces

import supernode
from coordinator.launch.sandbox import node_memory

MODULE = """
import socket

import numpy as np
import supernode


class Greedy(supernode.Problem):
    port: int
    gigabytes: float = 0.0

    @property
    def coding(self):
        return supernode.BitString(8, 1)

    def evaluate(self, genomes):
        if np.any(genomes[:, 0] < 128):
            np.empty(int(self.gigabytes * (1 << 30)), np.uint8)  # not touched: it takes no memory, and counts
        return genomes[:, 0] + 1000.0 * self.reaches()

    def reaches(self):
        try:
            socket.create_connection(("127.0.0.1", self.port), 5).close()
        except OSError:
            return False
        return True
"""


@pytest.fixture
def port():
    """One at which somebody listens."""
    with socket.create_server(("127.0.0.1", 0), backlog=4096) as server:
        yield server.getsockname()[1]


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A user's own, where processes look for it."""
    (tmp_path / "greedy_module.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)


@pytest.fixture
def up(module, tmp_path):
    """Starts a cluster that may run the module."""

    @contextmanager
    def start(*options):
        with live(tmp_path / "state", "torus 1x2", "--allow-module", "greedy_module", *options) as service:
            yield service

    return start


def problem_in(folder, port, gigabytes=0.0):
    path = folder / "greedy.toml"
    path.write_text(f'kind = "greedy_module:Greedy"\nport = {port}\ngigabytes = {gigabytes}\n[run]\ntarget = -1.0\n')
    return path


@needs_namespaces
@pytest.mark.parametrize("options", [("--sandbox",), ()], ids=["sandbox", "without"])
def test_a_connection_fails_in_the_sandbox_only(up, tmp_path, port, options):
    with up(*options) as service, service.connect() as client:
        result = client.submit(problem_in(tmp_path, port), topology="torus 1x2", generations=30).result(60)
        assert result.status == "exhausted", result.message
        assert result.feasible
        assert (result.fitness >= 1000.0) == (not options)


@needs_namespaces
@pytest.mark.parametrize("options", [("--sandbox",), ()], ids=["sandbox", "without"])
def test_an_individual_that_takes_too_much_memory_counts_as_infeasible_in_the_sandbox(up, tmp_path, options):
    with up(*options) as service, service.connect() as client:
        job = client.submit(problem_in(tmp_path, 1, gigabytes=2.5), topology="torus 1x2", generations=20)
        result = job.result(60)
        texts = log_texts(client, job)
    blamed = [text for text in texts if "counts as infeasible: it took more than --node-memory" in text]
    if options:
        assert blamed or "has crashed" in (result.message or "")
        assert result.fitness is None or result.fitness >= 128.0
    else:
        assert (blamed, result.status) == ([], "exhausted")
        assert result.fitness < 128.0


@needs_namespaces
@pytest.mark.parametrize("database", [False, True])
def test_who_is_in_the_sandbox(up, tmp_path, database):
    more = ["--database", f"sqlite:///{tmp_path}/other.sqlite"] if database else []
    with up("--sandbox", *more) as service:
        here = Path("/proc/self/ns/net").readlink()

        def confined():
            networks = {name: Path(f"/proc/{each}/ns/net").readlink() for name, each in service.processes().items()}
            assert len({network for network in networks.values() if network != here}) == 1, "all share one"
            return {name for name, network in networks.items() if network != here}

        expected = {"node 0", "node 1", "spy"} | (set() if database else {"coordinator"})
        assert service.processes().keys() - expected == {"router"} | ({"coordinator"} if database else set())
        assert confined() == expected
        service.kill("node 1")
        service.kill("spy")
        assert confined() == expected, "those that take their place are in it too"
        assert service.all_gone_within(60, lambda: os.kill(service.zygote, signal.SIGKILL))


@needs_namespaces
def test_nodes_that_join_by_a_unix_socket(module, tmp_path):
    endpoint = f"unixsock-stream/{tmp_path}/router.sock"
    common = ["--connect", endpoint, "--secret-file", str(tmp_path / "secret"), "--allow-module", "greedy_module"]
    commands = [
        ["router", "--listen", endpoint],
        ["coordinator", *common, "--nodes", "2", "--database", f"sqlite:///{tmp_path}/jobs.sqlite"],
        ["spy", *common],
        ["node", *common, "--nodes", "2", "--sandbox"],
    ]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    running = [subprocess.Popen([sys.executable, "-m", "supernode", *each], env=environment) for each in commands]
    try:
        with until_connected(endpoint) as client:
            nodes = until(lambda: told if len(told := client.status()["nodes"]) == 2 else None)
            # The spy is not in the sandbox, and must find the same fitness: nobody listens at port 1.
            result = client.submit(problem_in(tmp_path, 1), topology="torus 1x2", generations=30).result(60)
            networks = {Path(f"/proc/{node['process']}/ns/net").readlink() for node in nodes}
        assert (result.status, result.feasible) == ("exhausted", True), result.message
        assert len(networks) == 1
        assert networks != {Path("/proc/self/ns/net").readlink()}
    finally:
        for each in reversed(running):
            each.terminate()
        for each in reversed(running):
            each.wait(60)


def until_connected(endpoint):
    def connected():
        try:
            return supernode.connect(endpoint)
        except supernode.ClusterFailed:
            return None

    return until(connected)


@needs_namespaces
def test_where_namespaces_are_forbidden_the_error_says_so(tmp_path):
    command = f"{sys.executable} -m supernode up --torus 1x1 --state {tmp_path}/state --sandbox"
    script = f"echo 0 > /proc/sys/user/max_net_namespaces; exec {command}"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["unshare", "--user", "--map-root-user", "sh", "-c", script],
        env=environment, capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: --sandbox: expected a system that lets this user make user and network namespaces,")
    assert line.endswith("or start without --sandbox")


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (
            ["node", "--connect", "tcp/127.0.0.1:7447"],
            "--sandbox: expected --connect with the Unix socket of a cluster on this machine (unixsock-stream/PATH),"
            " since nodes in the sandbox have no network, found tcp/127.0.0.1:7447",
        ),
        (
            ["node", "--connect", "unixsock-stream//run/router.sock", "--listen", "tcp/127.0.0.1:7450"],
            "--listen: expected none with --sandbox, since its nodes have no network, found tcp/127.0.0.1:7450",
        ),
        (
            ["up", "--on", "ssh://a", "--insecure"],
            "--sandbox: expected none with --on, whose nodes need a network, found --on ssh://a",
        ),
    ],
)
def test_what_needs_a_network_is_refused(capsys, command, said):
    assert in_process(capsys, *command, "--sandbox") == (2, "", f"error: {said}\n")


def test_the_sandbox_has_a_limit_of_memory_unless_another_is_given():
    assert node_memory(None, True) == 2 << 30
    assert node_memory(1 << 20, True) == 1 << 20
    assert node_memory(None, False) is None
