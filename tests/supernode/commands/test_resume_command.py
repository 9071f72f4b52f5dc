"""Everything is killed, and `resume` goes on as if nothing had happened; what cannot go on is said in one line."""

import contextlib
import json
import os
import signal
import subprocess
import sys

import pytest
from command_line import in_process
from live_service import ROOT, children_of, until

from coordinator.jobs.checkpoint import Checkpoint
from coordinator.store.checkpoint_folder import CheckpointFolder
from node.fingerprint import fingerprint
from problems import load

PROBLEM = 'kind = "function"\nname = "onemax"\ndimension = 64\ncost_us = 150\n'
RUN = ("--torus", "2x3", "--generations", "1000", "--target", "-1", "--json", "--quiet")


@pytest.fixture
def problem(tmp_path):
    path = tmp_path / "ones.toml"
    path.write_text(PROBLEM)
    return path


def family(process):
    """The ids of a process and of all its descendants."""
    return [process, *(each for child in children_of(process) for each in family(child))]


def started(*arguments, folder):
    command = [sys.executable, "-m", "supernode", *map(str, arguments)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=folder, env=environment)


def kill_all_after_checkpoints(process, folder, count):
    """Kill everything once there are so many further checkpoints."""

    def newest():
        return max((int(each.stem) for each in folder.path.glob("*.checkpoint")), default=0)

    first = newest()
    until(lambda: newest() >= first + count or process.poll() is not None)
    for each in family(process.pid):
        with contextlib.suppress(ProcessLookupError):
            os.kill(each, signal.SIGKILL)
    process.communicate()


def test_all_are_killed_twice_and_the_result_is_that_of_an_undisturbed_run(problem, tmp_path, capsys):
    _, expected, _ = in_process(capsys, "simulate", problem, *RUN)
    folder = CheckpointFolder(tmp_path / "ones.run")
    first = started("solve", problem, *RUN, "--checkpoint", "300ms", folder=tmp_path)
    kill_all_after_checkpoints(first, folder, 2)
    second = started("resume", folder.path, "--checkpoint", "300ms", folder=tmp_path)
    kill_all_after_checkpoints(second, folder, 2)
    third = started("resume", folder.path, "--json", folder=tmp_path)
    out, told = third.communicate()
    assert b"goes on after generation " in told
    found, expected = json.loads(out), json.loads(expected)
    same = ("status", "fitness", "generations", "evaluations", "history_sha256", "directives", "found_at", "solution")
    assert {name: found[name] for name in same} == {name: expected[name] for name in same}


def test_a_run_that_ends_by_itself_leaves_no_checkpoints(problem, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        code, out, _ = in_process(capsys, "solve", problem, *RUN, "--generations", "20", "--checkpoint", "30s")
        assert (code, json.loads(out)["generations"]) == (3, 20)
        assert not (tmp_path / "ones.run").exists()


def test_other_versions_of_the_software_are_a_warning(problem, tmp_path, capsys):
    file = load(problem).with_run(topology="torus 1x2", generations=5, target=-1.0)
    folder = tmp_path / "ones.run"
    CheckpointFolder(folder).keep(Checkpoint(file, file, versions=fingerprint() | {"numpy": "0.9"}))
    code, _, told = in_process(capsys, "resume", folder, "--json", "--quiet")
    assert code == 3
    assert told.startswith("warning: numpy ")
    assert " instead of 0.9: the run may not go on bit for bit" in told


def test_two_processes_do_not_write_to_one_folder(problem, tmp_path, capsys):
    folder = CheckpointFolder(tmp_path / "ones.run")
    with folder.held():
        folder.keep(Checkpoint(load(problem), load(problem)))
        code, _, told = in_process(capsys, "resume", folder.path, "--quiet")
    assert (code, told.count("\n")) == (2, 1)
    assert "expected no other process" in told


def test_a_run_of_its_own_does_not_overwrite_the_checkpoints_of_another(problem, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ones.run").mkdir()
    (tmp_path / "ones.run" / "00000001.checkpoint").write_text("")
    code, _, told = in_process(capsys, "solve", problem, *RUN, "--checkpoint", "30s")
    assert (code, told.count("\n")) == (2, 1)
    assert "supernode resume ones.run" in told


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["solve", "ones.toml", "--checkpoint", "9s", "--checkpoints", "ones.toml/run"], "folder that can be written"),
        (["resume", "nowhere"], "nowhere: expected a folder"),
        (["resume", "damaged"], "damaged/00000001.checkpoint: expected a checkpoint, found another file"),
        (["resume", "damaged", "--checkpoint", "soon"], "expected a time such as 30s"),
        (["solve", "ones.toml", "--checkpoint", "0s"], "expected a time such as 30s"),
        (["solve", "ones.toml", "--checkpoints", "here"], "expected --checkpoint TIME with it"),
        (["solve", "ones.toml", "--checkpoint", "9s", "--connect", "tcp/127.0.0.1:9"], "expected none with a running"),
        (["solve", "ones.toml", "--checkpoint", "9s", "--dashboard", "127.0.0.1:0"], "expected none with --dashboard"),
    ],
)
def test_wrong_input_is_said_in_one_line(problem, tmp_path, capsys, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "00000001.checkpoint").write_text("lost")
    code, out, told = in_process(capsys, *arguments)
    assert (code, out, told.count("\n")) == (2, "", 1)
    assert words in told
