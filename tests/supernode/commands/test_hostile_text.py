"""Whatever a cluster answers, no command writes control characters on the screen."""

import io
import time
import unicodedata

import pytest
from command_line import in_process
from fake_service import SOLUTION, result_of
from live_service import live, until
from rich.console import Console

from problems import load
from spy.terminal import Terminal
from supernode.live.view import View
from supernode.reports.records import Page, write_csv
from supernode.terminal.screen import drawn
from topologies import parse
from wire import jobs, sessions
from wire.keys import Keys
from wire.news import Improvement, LogRecord

HOSTILE = "\x1b]0;owned\x07\x1b[2J\r\x9b31m\u202eevil\u2066"
SHOWN = r"\x1b]0;owned\x07\x1b[2J\r\x9b31m\u202eevil\u2066"


def is_harmless(text):
    return {unicodedata.category(each) for each in text if each != "\n"} & {"Cc", "Cf", "Cs", "Zl", "Zp"} == set()


@pytest.fixture
def supernode(service, capsys):
    """Runs a command on the service: all that it writes."""

    def run(*arguments):
        _, out, err = in_process(capsys, *arguments, "--connect", service.endpoint)
        return out + err

    return run


@pytest.fixture
def job(service, file):
    """A job of a cluster that is hostile wherever it answers in text."""
    service.submitted(jobs.Submit(load(file).to_json(), "a"))
    service.end = lambda *_: None  # it does not end when it is cancelled
    service.jobs["a"].update(job=HOSTILE, kind=HOSTILE, status=HOSTILE, message=HOSTILE)
    return service.jobs["a"]


@pytest.mark.parametrize("command", [["jobs"], ["jobs", "a"], ["cancel", "a"]])
def test_jobs(supernode, job, command):
    told = supernode(*command)
    assert SHOWN in told
    assert is_harmless(told)


def test_status(supernode, service):
    node = {"node": 0, "process": HOSTILE, "job": HOSTILE, "cell": [HOSTILE], "host": HOSTILE}
    spread = {"job": HOSTILE, "hosts": {HOSTILE: 1}, "crossing": 1, "edges": 2}
    service.value = lambda _: {
        "cluster": "fake", "version": HOSTILE, "nodes": [node], "placements": [spread], "jobs": {HOSTILE: 1}
    }  # fmt: skip
    told = supernode("status")
    assert told.count(SHOWN) == 8
    assert is_harmless(told)


def test_logs(supernode, service):
    columns = ["id", "at", "level", "process", "node", "cell", "job", "generation", "text"]
    row = [1, 1.0, HOSTILE, HOSTILE, 1, 2, HOSTILE, 3, f"{HOSTILE}\nforged"]
    page, value = {"columns": columns, "rows": [row], "more": False}, service.value
    service.value = lambda request: page if isinstance(request, jobs.Records | jobs.Logs) else value(request)
    told = supernode("logs")
    assert told.count(SHOWN) == 4
    assert is_harmless(told)
    assert len(told.splitlines()) == 1, "a record cannot pretend to be two"


def test_refusals(supernode, service, file):
    value = service.value

    def refuse(request):
        if isinstance(request, jobs.Status):  # the client's first question
            return value(request)
        raise LookupError(HOSTILE)

    service.value = refuse
    for command in (["jobs"], ["down"], ["logs"], ["watch", "a"], ["submit", file]):
        told = supernode(*command)
        assert SHOWN.replace(r"\r", " ") in told, "an error is one line"
        assert is_harmless(told)


@pytest.mark.parametrize("status", ["failed", "solved"])
def test_results(supernode, service, job, status):
    result = result_of("a", status, 1.5) | {"message": HOSTILE, "solution": SOLUTION, "mode": HOSTILE}
    job.update(job="a", kind="function", status=status, result=result, ended=time.time(), fitness=1.5, message=HOSTILE)
    told = supernode("watch", "a")
    assert told.count(SHOWN) >= 2
    assert is_harmless(told)


def test_progress(capsys):
    with Terminal(parse("torus 2x2")) as terminal:
        terminal.say(HOSTILE)
        terminal.begins_anew({"attempt": 1, "seed": 2, "fields": {HOSTILE: HOSTILE}})
        terminal.improvement(Improvement(1, 0, 0.1, 3, 2, 1.5, True, SOLUTION))
    told = capsys.readouterr().err
    assert SHOWN in told
    assert is_harmless(told)


@pytest.mark.parametrize("only", [None, HOSTILE])
def test_the_screen(only):
    view = View()
    view.hear_status({"cluster": HOSTILE, "jobs": {HOSTILE: 1}, "nodes": [{"node": node} for node in range(4)]})
    about = {"job": HOSTILE, "kind": HOSTILE, "status": HOSTILE, "topology": "torus 2x2"}
    view.hear_jobs([about | {"number": 1, "fitness": 1.0, "cells": 4}])
    view.hear_log(LogRecord("error", HOSTILE, f"{HOSTILE}\nforged", 1.0).encode())
    view.found()
    told = written(drawn(view.snapshot(), only))
    assert told.count(SHOWN) >= 7
    assert is_harmless(told)
    view = View()
    view.lost(HOSTILE)
    assert written(drawn(view.snapshot(), only)).strip() == SHOWN


def written(drawing):
    """What Rich writes, without colours: those need escape sequences."""
    console = Console(file=io.StringIO(), width=400, color_system=None)
    console.print(drawing)
    return console.file.getvalue()


class Screen(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize("stdout", [Screen, io.StringIO])
def test_exported_records_are_harmless_on_a_terminal_and_exact_elsewhere(monkeypatch, stdout):
    monkeypatch.setattr("sys.stdout", told := stdout())
    write_csv(iter([Page(["job", "text"], [[1, HOSTILE]])]), None)
    assert told.getvalue() == f"job,text\n1,{SHOWN if stdout is Screen else HOSTILE}\n"


def test_the_log_of_a_real_cluster(tmp_path, capsys):
    record = LogRecord("warning", "node 0", f"hostile {HOSTILE}", time.time(), 0)
    with live(tmp_path / "state", "torus 1x1") as service:
        info = service.info()
        session = sessions.client(info.endpoint)

        def told():
            session.put(Keys(info.cluster).log, record.encode())
            return [line for line in logged() if "hostile" in line]

        def logged():
            return in_process(capsys, "logs", "--state", service.state)[1].split("\n")

        line = until(told)[0]
        session.close()
    assert SHOWN in line
    assert is_harmless(line)
