"""A cluster on a terminal: what is drawn, and that `watch` shows it."""

import os
import pty
import re
import select
import signal
import subprocess
import sys

import pytest
from live_service import ROOT, live, until
from rich.console import Console

from problems.file import parse
from supernode.live.view import View
from supernode.terminal.screen import drawn
from wire.keys import Keys
from wire.news import Counters, Statistics

JOB = {
    "job": "office-1",
    "number": 3,
    "kind": "function",
    "status": "running",
    "fitness": 0.25,
    "cells": 4,
    "topology": "torus 2x2",
}


def seen(job=None, answers=True, killed=None):
    view = View()
    if answers:
        view.hear_status({"cluster": "c1", "jobs": {"running": 1}, "nodes": [{"node": node} for node in range(4)]})
        view.hear_jobs([JOB])
        counters = [
            Counters(node, 3 - node, 3, 0, 9, 80, 9, 36, 0, 0, 1.0 + node, 5.0, 6.0, 0.25, 2, node, 0.01)
            for node in range(4)
        ]
        view.hear_counters(*Counters.encode_all(counters))
        view.hear_statistics(Statistics(3, 0, 9, 320, 36, 144, 0, 0, 4, 88.0, 0.5, 2.5, 7.0, 4, 0.75, 0.01).encode())
        if killed is not None:
            for is_there in (True, False):
                view.hear_life(Keys("c1").life(killed, 7), is_there)
        view.found()
    else:
        view.lost("no cluster answers at tcp/nowhere")
    console = Console(width=100, record=True, file=open(os.devnull, "w"), force_terminal=True, color_system="truecolor")  # noqa: SIM115, PTH123
    console.print(drawn(view.snapshot(), job, cell_nodes=[3, 2, 1, 0]))
    return console.export_text(clear=False), console.export_text(styles=True)


def test_all_of_a_cluster():
    text, _ = seen()
    assert "cluster c1: " in text
    assert "jobs: 1 running" in text
    assert re.search(r"office-1 +function +running +0\.25 +9 +4", text)


def test_one_job_with_its_cells_the_better_the_lighter():
    text, styled = seen("office-1")
    assert "job office-1 (function, torus 2x2): running, fitness 0.25" in text
    assert "generation 9  best 0.5  median 2.5  worst 7  diversity 75%  champion's age 4  88 messages/s" in text
    above, below = painted(styled)
    brightness = [sum(each) for each in [*above, *below]]
    assert brightness == sorted(brightness), "node 3, the worst, lives on cell 0"


def painted(styled):
    """The colours of the upper cells and of the lower ones."""
    (row,) = [line for line in styled.splitlines() if "▀" in line]
    pairs = [tuple(map(int, each)) for each in re.findall(r"38;2;(\d+);(\d+);(\d+);48;2;(\d+);(\d+);(\d+)m▀▀", row)]
    assert len(pairs) == 2
    return [each[:3] for each in pairs], [each[3:] for each in pairs]


def test_a_dead_cell_of_a_job_is_red():
    above, below = painted(seen("office-1", killed=2)[1])
    assert above[1] == (200, 40, 40), "node 2 lives on cell 1"
    assert (200, 40, 40) not in [above[0], *below]


def test_a_cluster_that_does_not_answer():
    assert seen(answers=False)[0].strip() == "no cluster answers at tcp/nowhere"


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    with live(tmp_path_factory.mktemp("screen") / "state", "torus 2x2") as service:
        yield service


class Person:
    """Types a command at a terminal, and reads what it shows."""

    def __init__(self, *command):
        master, slave = pty.openpty()
        self._screen = master
        environment = os.environ | {"PYTHONPATH": str(ROOT), "TERM": "xterm-256color", "COLUMNS": "100"}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "supernode", *command], stdin=slave, stdout=slave, stderr=slave, env=environment
        )
        os.close(slave)
        self.seen = ""

    def sees(self, text):
        """Whether it has been shown by now; waits for more."""
        try:
            self.seen += os.read(self._screen, 1 << 16).decode(errors="replace")
        except OSError:  # the command has ended
            return text in self.seen or pytest.fail(f"never shown: {text}, but: {self.seen[-2000:]}")
        return text in self.seen

    def leaves(self):
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(30)

    def close(self):
        self.process.kill()
        self.process.wait()
        os.close(self._screen)


@pytest.fixture
def person():
    people = []

    def sit_down(*command):
        people.append(Person(*map(str, command)))
        return people[-1]

    yield sit_down
    for each in people:
        each.close()


def endless():
    return parse('kind = "function"\nname = "onemax"\ndimension = 64\ncost_us = 200\n', "job", ROOT)


def test_watch_shows_the_cluster_until_ctrl_c(service, person):
    with service.connect() as client:
        job = client.submit(endless(), id="shown", topology="torus 2x2", target=-1.0, stall=10**6)
        viewer = person("watch", "--state", service.state)
        until(lambda: viewer.sees("4 of 4 nodes alive"))
        until(lambda: viewer.sees("▀▀"))
        until(lambda: viewer.sees("shown"))
        assert viewer.leaves() == 0
        follower = person("watch", "shown", "--state", service.state)
        until(lambda: follower.sees("diversity"))
        until(lambda: follower.sees("▀▀"))
        job.cancel()
        until(lambda: follower.sees("cancelled: "))
        assert follower.process.wait(30) in (0, 3)


def test_without_a_terminal_there_are_lines(service):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "supernode", "watch", "--state", str(service.state)]
    with (
        service.connect() as client,
        subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, text=True) as watching,
    ):

        def told():  # the first jobs may have come before it looked
            client.submit(endless(), topology="torus 2x2", target=-1.0, generations=50).result(30)
            return select.select([watching.stdout], [], [], 0)[0]

        until(told)
        assert re.fullmatch(r"info: job \w+: \w+\n", watching.stdout.readline())
        watching.send_signal(signal.SIGINT)
        assert watching.wait(30) == 0
