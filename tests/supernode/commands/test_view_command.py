"""`supernode view` as a person types it: what it shows, what it refuses, and how it ends."""

import json
import math
import os
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest
from command_line import in_process
from jointed_robots import FIELDS, chain

from supernode.pictures import viewer

ROOT = Path(__file__).resolve().parents[3]
ARM = ROOT / "examples" / "arm-ik.toml"
PROBLEM = f"""
kind = "robot-path"
start = {FIELDS["start"]}
goal = {FIELDS["goal"]}
[robot]
urdf = "chain.urdf"
"""
GOOD = {
    "path": [FIELDS["start"], FIELDS["goal"]],
    "length": math.dist(FIELDS["start"], FIELDS["goal"]),
    "clearance": 0.0,
}
needs_viser = pytest.mark.skipif("not __import__('importlib.util').util.find_spec('viser')")


@pytest.fixture
def problem(tmp_path):
    (tmp_path / "chain.urdf").write_text(chain())
    path = tmp_path / "chain.toml"
    path.write_text(PROBLEM)
    return path


@pytest.fixture
def shown(monkeypatch):
    """What the command would have served."""
    calls = []
    monkeypatch.setattr(viewer, "serve", lambda *arguments: calls.append(arguments))
    monkeypatch.setattr(viewer, "check_viser", lambda: None)
    return calls


def result_of(problem, solution):
    path = problem.with_name("result.json")
    path.write_text(json.dumps(solution))
    return path


def test_a_result_is_shown_at_the_address_asked_for(problem, shown, capsys):
    arguments = ("view", problem, result_of(problem, GOOD), "--host", "::1", "--port", 8123)
    code, _, err = in_process(capsys, *arguments)
    assert code == 0, err
    ((animation, title, host, port),) = shown
    assert len(animation.along) > 1
    assert (title, host, port) == ("chain.toml", "::1", 8123)


def test_without_a_result_the_problem_is_shown_on_this_machine_only(problem, shown, capsys):
    assert in_process(capsys, "view", problem)[0] == 0
    ((animation, _, host, port),) = shown
    assert len(animation.along) == 1
    assert (host, port) == ("127.0.0.1", 8080)


def test_a_rejected_result_is_not_shown(problem, shown, capsys):
    elsewhere = GOOD | {"path": [FIELDS["start"], FIELDS["start"]]}
    code, _, err = in_process(capsys, "view", problem, result_of(problem, elsewhere))
    assert code == 3
    assert "rejected: " in err
    assert shown == []


def test_a_kind_without_an_animation_is_refused_with_those_that_have_one(shown, capsys):
    code, _, err = in_process(capsys, "view", ARM)
    assert code == 2
    assert "(robot-ik, robot-path), found 'arm-ik'; `supernode solve --plot FILE` draws any kind" in err
    assert len(err.splitlines()) == 1
    assert shown == []


def test_a_kind_that_shows_nothing_without_a_solution_asks_for_a_result(own_problem, shown, capsys):
    path = own_problem()
    module = path.with_name("own_module.py")
    module.write_text(module.read_text() + "\n    def animation(self, solution):\n        return None\n")
    code, _, err = in_process(capsys, "view", path)
    assert code == 2
    assert "RESULT.json: expected a result, since kind 'own_module:OneMax' shows nothing without one" in err


def test_what_is_not_installed_is_named_with_its_extra(problem, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)
    said = "error: view: expected viser to be installed: pip install 'supernode[view]'\n"
    assert in_process(capsys, "view", problem) == (2, "", said)


@pytest.mark.parametrize("port", ["65536", "-1", "http"])
def test_a_port_is_a_number(problem, port, capsys):
    code, _, err = in_process(capsys, "view", problem, f"--port={port}")
    assert code == 2
    assert f"--port: expected a number from 0 to 65535, found {port}" in err


@needs_viser
@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_a_signal_and_ends_well(problem, kind):
    command = [sys.executable, "-m", "supernode", "view", str(problem), "--port", "0"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, env=os.environ | {"PYTHONPATH": str(ROOT)}, **pipes) as process:
        try:
            address = process.stdout.readline().removeprefix("view: ").strip()
            with urllib.request.urlopen(address, timeout=20) as answer:
                assert answer.status == 200
            process.send_signal(kind)
            out, err = process.communicate(timeout=20)
        finally:
            process.kill()
    assert (process.returncode, out, err) == (0, "", "")
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(address, timeout=5)
