"""A cluster on hosts that ssh reaches: this machine, twice, by a real sshd of the test's own."""

import getpass
import os
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from places import ROOT, free_port, until

import supernode
from supernode.__main__ import main
from supernode.deploy.ssh_cluster import SshCluster

needs_ssh = pytest.mark.skipif(shutil.which("ssh") is None, reason="needs ssh")
SSHD = shutil.which("sshd", path="/usr/sbin:/usr/bin")
EXAMPLE = supernode.load(str(ROOT / "examples" / "arm-ik.toml")).with_run(topology="torus 2x4", seed=1)


def agents():
    """The ids of all processes that run an agent of a lifeline."""
    found = set()
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if b"--lifeline" in words:
            found.add(int(folder.name))
    return found


@pytest.fixture
def host(tmp_path, monkeypatch):
    """A destination of ssh on this machine, with keys and a configuration of the test's own."""
    if SSHD is None or not shutil.which("ssh"):
        pytest.skip("needs sshd and ssh")
    port, keys = free_port(), tmp_path / "keys"
    keys.mkdir(mode=0o700)
    for name in ("server", "client"):
        subprocess.run(["ssh-keygen", "-q", "-N", "", "-t", "ed25519", "-f", keys / name], check=True)
    lines = f"""
        Port {port}
        ListenAddress 127.0.0.1
        HostKey {keys}/server
        AuthorizedKeysFile {keys}/client.pub
        StrictModes no
        UsePAM no
        PidFile none
    """
    (keys / "sshd").write_text(lines)
    Path("/run/sshd").mkdir(exist_ok=True)  # where root's sshd puts those whom it does not know yet
    programs = tmp_path / "bin"
    programs.mkdir()
    options = f"-o IdentityFile={keys}/client -o UserKnownHostsFile={keys}/known -o StrictHostKeyChecking=accept-new"
    (programs / "ssh").write_text(f'#!/bin/sh\nexec {shutil.which("ssh")} -F none {options} "$@"\n')
    (programs / "ssh").chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}:{os.environ['PATH']}")
    server = subprocess.Popen([SSHD, "-D", "-e", "-f", keys / "sshd"], stderr=subprocess.PIPE, text=True)
    said = iter(server.stderr.readline, "")
    assert any("listening" in line for line in said), "sshd has ended"
    threading.Thread(target=lambda: list(said), daemon=True).start()  # or its pipe would become full
    yield f"{getpass.getuser()}@127.0.0.1:{port}"
    server.kill()
    server.wait()


def test_a_cluster_on_two_hosts_gives_what_a_simulation_gives_and_mends_itself(host, tmp_path):
    with SshCluster([host, host], 8, options=["--state", str(tmp_path)]) as cluster:
        result = cluster.submit(EXAMPLE).result(60)
        assert result.history_sha256 == supernode.simulate(EXAMPLE).history_sha256
        assert {node["host"] for node in cluster.status()["nodes"]} == {"127.0.0.1-0", "127.0.0.1-1"}
        before = {node["process"] for node in cluster.status()["nodes"]}
        # The connection of one agent breaks: it ends there, and comes back under its name.
        os.kill(cluster._agents[0]._process.pid, signal.SIGKILL)
        until(lambda: len(before & {node["process"] for node in cluster.status()["nodes"]}) <= 4)
        until(lambda: all(node["process"] for node in cluster.status()["nodes"]))
        assert cluster.submit(EXAMPLE).result(60).history_sha256 == result.history_sha256
    until(lambda: not agents())


def test_up_and_down(host, tmp_path, capsys):
    command = ["up", "--on", f"ssh://{host}", "--torus", "2x2", "--state", str(tmp_path), "--detach", "--insecure"]
    done = subprocess.run([sys.executable, "-m", "supernode", *command], cwd=ROOT, capture_output=True, check=True)
    assert done.stdout.startswith(b"up: 4 nodes (torus 2x2) on ssh://")
    with supernode.connect(tmp_path) as client:
        assert client.submit(EXAMPLE.with_run(topology="torus 2x2")).result(60).status == "solved"
    assert main(["down", "--state", str(tmp_path)]) == 0
    assert "where they were started" not in capsys.readouterr().out
    until(lambda: not agents())


def test_nothing_is_left_when_the_lifeline_is_killed(host, tmp_path):
    command = ["up", "--on", f"ssh://{host}", "--nodes", "1", "--state", str(tmp_path), "--insecure"]
    process = subprocess.Popen([sys.executable, "-m", "supernode", *command], cwd=ROOT, stdout=subprocess.PIPE)
    assert process.stdout.readline().startswith(b"up: 1 nodes (torus 1x1) on ssh://")
    assert agents()
    process.kill()
    process.wait()
    process.stdout.close()
    until(lambda: not agents())


@needs_ssh
def test_a_host_that_cannot_be_reached_is_named(tmp_path):
    with pytest.raises(supernode.ClusterFailed, match=r"127\.0\.0\.1:1: ssh or the agent there ended with status 255"):
        SshCluster(["127.0.0.1:1"], 2, options=["--state", str(tmp_path)])


@needs_ssh
def test_what_is_no_host_is_refused():
    with pytest.raises(supernode.BadInput, match="--on: expected hosts such as user@host:22, found '-oProxyCommand=x'"):
        SshCluster(["-oProxyCommand=x"], 2)


def test_a_machine_without_ssh_is_told_what_to_install(monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(supernode.BadInput, match="--on: expected the program ssh, found none; install openssh-client"):
        SshCluster(["host"], 2)


@pytest.mark.parametrize("engine", ["moon", "ssh://", "ray://"])
def test_an_engine_that_is_not_known_is_refused(engine, tmp_path, capsys):
    assert main(["up", "--on", engine, "--insecure", "--state", str(tmp_path)]) == 2
    assert f"--on: expected ray, ray://HEAD:10001 or ssh://HOST,HOST, found '{engine}'" in capsys.readouterr().err
