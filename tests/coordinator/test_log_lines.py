"""The log as lines: for people, and for programs."""

import contextlib
import io
import json
from pathlib import Path

import pytest

from coordinator.log_lines import LogLines
from wire.news import LEVELS, LogRecord

RECORD = LogRecord("warning", "node 7", "rejects messages of node 3: wrong type", 1.75e9, 7, 4, 1, 120)


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
