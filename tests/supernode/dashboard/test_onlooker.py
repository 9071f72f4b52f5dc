"""`spy --dashboard`: which cluster it shows."""

import contextlib
import os
import select
import signal
import subprocess
import sys
import urllib.request

import pytest
from fake_service import FakeService
from live_service import ROOT, until

SPY = [sys.executable, "-m", "supernode", "spy"]
ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.startswith("SUPERNODE_")}


@contextlib.contextmanager
def onlooker(*options):
    """Its process, and its address."""
    command = [*SPY, "--dashboard", "127.0.0.1:0", *options]
    environment = ENVIRONMENT | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, text=True) as process:
        try:
            assert select.select([process.stdout], [], [], 30)[0]
            yield process, process.stdout.readline().strip().rpartition(": ")[2]
        finally:
            process.kill()


def refusal(*options):
    done = subprocess.run(
        [*SPY, *options], check=False, capture_output=True, env=ENVIRONMENT | {"PYTHONPATH": str(ROOT)}, text=True
    )
    return done.returncode, done.stderr


def news(address):
    with urllib.request.urlopen(address + "events?nodes=0", timeout=20) as answer:
        return answer.readline().decode()


@pytest.fixture
def neighbour(service):
    """Another cluster at the same router."""
    neighbour = FakeService("neighbour")
    neighbour.stop()
    neighbour.stop_router()
    neighbour.endpoint = service.endpoint
    neighbour.start()
    yield neighbour
    neighbour.close()


def test_of_several_at_a_router_it_shows_the_one_that_is_named(service, neighbour):
    with onlooker("--connect", service.endpoint, "--cluster", "neighbour") as (process, address):
        until(lambda: '"cluster":"neighbour"' in news(address))
        assert os.getpriority(os.PRIO_PROCESS, process.pid) > os.getpriority(os.PRIO_PROCESS, 0)
        process.send_signal(signal.SIGINT)
        assert process.wait(10) == 130


def test_it_does_not_choose_by_itself(service, neighbour):
    with onlooker("--connect", service.endpoint) as (_, address):
        until(lambda: "more than one cluster answers" in news(address))


def test_a_state_folder_is_a_place_too(tmp_path):
    with onlooker("--state", str(tmp_path)) as (_, address):
        until(lambda: f"no cluster is up in {tmp_path}" in news(address))


def test_options_that_contradict_each_other_are_refused(tmp_path):
    assert refusal("--state", str(tmp_path)) == (2, "error: --state: expected --dashboard too\n")
    options = ("--dashboard", "127.0.0.1:0", "--connect", "tcp/127.0.0.1:1", "--state", str(tmp_path))
    assert refusal(*options) == (2, "error: --state: expected none with --connect\n")
