"""The log as lines: for people, and for programs."""

import contextlib
import io
import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from coordinator.log_lines import LogLines
from wire.news import LEVELS, LogRecord

RECORD = LogRecord("warning", "node 7", "rejects messages of node 3: wrong type", 1.75e9, 7, 4, 1, 120)

TRYING = """
import sys
from pathlib import Path
from coordinator.launch.zygote import Zygote
from node.evaluation_limits import EvaluationLimits
from problems.modules import Modules

service, limits = {"listen": [sys.argv[2]], "log_json": True, "keys": None}, EvaluationLimits()
zygote = Zygote("c1", "torus 2x2", Path(sys.argv[1]), bytes(32), Modules(), service, limits=limits)
zygote._fork_again("router")
"""


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_lines_that_nobody_takes_any_more_harm_nobody():
    file = io.StringIO()
    file.close()
    LogLines("c1", True, file).write(RECORD)
    with contextlib.suppress(OSError), Path("/dev/full").open("w", buffering=1) as full:  # it is full at the end too
        LogLines("c1", True, full).write(RECORD)


@pytest.mark.parametrize(("file", "as_json"), [(io.StringIO, None), (io.StringIO, True), (Terminal, True)])
def test_json_lines_tell_all_that_a_record_is_about(file, as_json):
    file = file()
    lines = LogLines("c1", as_json, file)
    for level in LEVELS:
        lines.write(RECORD._replace(level=level), "office")
    lines.write(LogRecord("info", "spy", 'a "quote" and\na line', 1.75e9))
    *told, last = [json.loads(line) for line in file.getvalue().splitlines()]
    assert [each.pop("level") for each in told] == list(LEVELS)
    for each in told:
        assert each == {
            "cluster": "c1",
            "process": "node 7",
            "event": RECORD.text,
            "timestamp": "2025-06-15T15:06:40.000+00:00",
            "node": 7,
            "cell": 4,
            "job": "office",
            "generation": 120,
        }
    assert last["event"] == 'a "quote" and\na line'
    assert not {"node", "cell", "job", "generation"} & last.keys()


@pytest.mark.parametrize("file", [Terminal(), io.StringIO()])
def test_people_read_one_line_too(file):
    LogLines("c1", None if file.isatty() else False, file).write(RECORD)
    (line,) = file.getvalue().splitlines()
    for word in ("2025-06-15T15:06:40.000+00:00", "warning", RECORD.text, "node 7", "120"):
        assert word in line


@pytest.mark.parametrize("as_json", [True, False])
def test_text_of_others_cannot_move_the_cursor(as_json):
    file, hostile = io.StringIO(), "\x1b[2J\r\x9b31m\u202e"
    LogLines("c1", as_json, file).write(RECORD._replace(process=hostile, text=f"{hostile}\nforged"), hostile)
    (line,) = file.getvalue().split("\n")[:-1]
    assert not {"\x1b", "\r", "\x9b", "\u202e"} & set(line)
    if as_json:
        assert json.loads(line)["event"] == f"{hostile}\nforged"
    else:
        assert line.count(r"\x1b[2J\r\x9b31m\u202e") == 3


def test_a_router_that_cannot_listen_any_more_is_a_line_of_the_log_too(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        command = [sys.executable, "-c", TRYING, str(tmp_path), endpoint]
        environment = os.environ | {"PYTHONPATH": str(Path(__file__).resolve().parents[2])}
        lifeline, held = os.pipe()
        done = subprocess.run(
            command, stdin=lifeline, capture_output=True, text=True, env=environment, timeout=60, check=True
        )
        os.close(lifeline)
        os.close(held)
    (line,) = done.stderr.splitlines()
    told = json.loads(line)
    assert told["event"] == f"router: cannot listen at {endpoint}: Address already in use"
    assert (told["cluster"], told["process"], told["level"]) == ("c1", "zygote", "warning")


def test_each_line_is_written_at_once():
    """Several processes write to one file; it may be unbuffered."""
    written = []

    class File(io.StringIO):
        def write(self, text):
            written.append(text)
            return len(text)

    LogLines("c", as_json=True, file=File()).write(LogRecord("warning", "coordinator", "careful", 0.0))
    (line,) = written
    assert line.endswith("}\n")
