"""The folder of a run's checkpoints: the latest that is whole counts, whatever has happened to the others."""

import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from coordinator.jobs.checkpoint import KEPT, Checkpoint
from coordinator.store.checkpoint_folder import CheckpointFolder
from problems import BadInput
from problems.file import parse

FILE = parse('kind = "function"\nname = "onemax"\ndimension = 64\n', "onemax", Path("/"))


def checkpoint(seconds):
    return Checkpoint(FILE, FILE, seconds=float(seconds))


@pytest.fixture
def folder(tmp_path):
    return CheckpointFolder(tmp_path / "run")


def test_the_latest_few_are_kept(folder):
    for seconds in range(12):
        folder.keep(checkpoint(seconds))
    assert len(list(folder.path.iterdir())) == KEPT
    latest, damaged = folder.latest()
    assert (latest.seconds, damaged) == (11.0, [])


def test_a_damaged_one_is_named_and_the_one_before_is_used(folder):
    for seconds in range(3):
        folder.keep(checkpoint(seconds))
    last = max(folder.path.iterdir())
    last.write_bytes(last.read_bytes()[:-1])
    latest, (damaged,) = folder.latest()
    assert latest.seconds == 1.0
    assert str(last) in damaged
    folder.keep(checkpoint(5))
    assert folder.latest()[0].seconds == 5.0


def test_if_all_are_damaged_each_is_named(folder):
    for seconds in range(2):
        folder.keep(checkpoint(seconds))
    for each in folder.path.iterdir():
        each.write_text("lost")
    with pytest.raises(BadInput, match=r"00000002.checkpoint: .*; .*00000001.checkpoint: "):
        folder.latest()


def test_what_a_power_cut_left_half_written_does_not_count(folder):
    folder.keep(checkpoint(1))
    (folder.path / "00000002.part").write_bytes(b"supernode")
    assert folder.latest()[0].seconds == 1.0


def test_no_folder_and_an_empty_one_are_said(folder):
    with pytest.raises(BadInput, match="found no folder"):
        folder.latest()
    folder.path.mkdir()
    with pytest.raises(BadInput, match="found none"):
        folder.latest()


def test_another_runs_checkpoints_are_not_overwritten(folder):
    folder.refuse_other_runs()
    folder.keep(checkpoint(1))
    with pytest.raises(BadInput, match="supernode resume"):
        folder.refuse_other_runs()


KEEP = """
import sys
from pathlib import Path
from coordinator.jobs.checkpoint import Checkpoint
from coordinator.store.checkpoint_folder import CheckpointFolder
from problems.file import parse

file = parse('kind = "function"\\nname = "onemax"\\ndimension = 64\\n', "onemax", Path("/"))
CheckpointFolder(sys.argv[1]).keep(Checkpoint(file, file, states=((8, bytes(5000)),)))
"""


def no_room():
    """No file of this process may become longer than a thousand bytes."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))


def test_nothing_half_written_is_left_where_there_is_no_room(folder):
    folder.keep(checkpoint(1))
    command = [sys.executable, "-c", KEEP, str(folder.path)]
    done = subprocess.run(command, preexec_fn=no_room, capture_output=True, text=True, check=False)
    assert "OSError" in done.stderr, done.stderr
    assert [each.name for each in folder.path.iterdir()] == ["00000001.checkpoint"]
    assert folder.latest()[0].seconds == 1.0
