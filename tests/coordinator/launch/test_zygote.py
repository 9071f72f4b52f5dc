"""The zygote between its forks: it ends with its caller, and when there cannot be another process."""

import errno
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]

# A zygote that forks nothing real; ``lifeline`` is the end of the pipe that its caller holds.
PLAYED = """
import errno, json, os, sys
from pathlib import Path
from coordinator.launch.zygote import Zygote
from node.evaluation_limits import EvaluationLimits
from problems.modules import Modules

end, lifeline = os.pipe()
os.dup2(end, 0)
os.close(end)
forked = []

class Played(Zygote):
    def _warm_up(self, nodes):
        pass

    def _kill_all(self):
        print(json.dumps({"forked": forked}), flush=True)

folder = Path(sys.argv[1])
played = Played("c1", "torus 8x8", folder, bytes(32), Modules(), None, limits=EvaluationLimits())
"""

ENDS_WHILE_FORKING = """
def fork(name, live):
    forked.append(name)
    if name == "node 2":
        os.close(lifeline)

played._fork, played._fork_router = fork, lambda: None
played.run()
"""

CANNOT_FORK = """
def fork():
    forked.append("?")
    if len(forked) > 3:
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
    return 2**22 + len(forked)  # no process has that id

os.fork = fork
played._fork_router = lambda: None
played.run()
"""


def play(script: str) -> list[dict]:
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", PLAYED + script, folder],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            timeout=60,
            check=False,
        )
    assert (done.returncode, done.stderr) == (0, "")
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_it_forks_no_more_nodes_when_its_caller_has_ended() -> None:
    assert play(ENDS_WHILE_FORKING) == [{"forked": ["spy", "node 0", "node 1", "node 2"]}]


def test_it_says_why_there_cannot_be_so_many_processes() -> None:
    reason = os.strerror(errno.EAGAIN)
    failed, forked = play(CANNOT_FORK)
    assert failed == {"failed": f"node 2 could not be forked: {reason}"}
    assert len(forked["forked"]) == 4


@pytest.mark.parametrize(("closes", "first"), [("lifeline", False), ("awaited", True)])
def test_it_waits_for_its_router_no_longer_than_for_its_caller(closes: str, first: bool) -> None:
    from coordinator.launch.lifeline import comes_first

    awaited, tell = os.pipe()
    lifeline, held = os.pipe()
    try:
        os.close(held if closes == "lifeline" else tell)
        assert comes_first(awaited, lifeline) is first
    finally:
        for descriptor in (awaited, lifeline, tell if closes == "lifeline" else held):
            os.close(descriptor)
