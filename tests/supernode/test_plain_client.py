"""The example that knows nothing but docs/protocol.md, with a coordinator that the test plays."""

import dataclasses
import json
import re
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import get_args

import msgpack

from problems import ProblemFile, load
from wire import jobs
from wire.news import Improvement

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "examples" / "plain_zenoh_client.py"
PROTOCOL = (ROOT / "docs" / "protocol.md").read_text()


def test_it_submits_and_prints_improvements_and_the_result(service):
    def play():
        service.wait_until_asked("show")
        (job,) = service.jobs
        for fitness in (3, 0):
            service.improve(job, fitness)
        time.sleep(0.1)
        service.end(job)

    thread = threading.Thread(target=play)
    thread.start()
    done = subprocess.run(
        [sys.executable, str(SCRIPT), service.endpoint], capture_output=True, text=True, timeout=60, check=False
    )
    thread.join()
    assert done.returncode == 0, done.stderr
    first, second, result = done.stdout.splitlines()
    assert "fitness 3" in first
    assert "fitness 0" in second
    assert json.loads(result)["status"] == "solved"
    (entry,) = service.jobs.values()
    arm = load(ROOT / "examples" / "arm-ik.toml")
    sent = ProblemFile.from_json(entry["file"])
    assert (sent.fields, sent.run) == (arm.fields, arm.run)


def test_a_refusal_is_one_line(service):
    def refuse(_):
        raise ValueError("the queue is full")

    service.value = refuse
    done = subprocess.run(
        [sys.executable, str(SCRIPT), service.endpoint], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "error: the queue is full\n")


def test_it_imports_nothing_of_supernode():
    imported = set(re.findall(r"^(?:import|from) (\w+)", SCRIPT.read_text(), re.MULTILINE))
    assert imported == {"json", "os", "queue", "sys", "tomllib", "uuid", "pathlib", "typing", "msgpack", "zenoh"}


def test_the_bytes_of_the_page_are_those_of_the_code():
    examples = re.findall(r"^    ((?:[0-9a-f]{2}){8,})$", PROTOCOL, re.MULTILINE)
    request, done, refused, state, best = map(bytes.fromhex, examples)
    assert jobs.decode(request) == jobs.Show("a1")
    assert jobs.decode_answer(done) == jobs.Done({"job": "a1", "status": "queued"})
    assert jobs.decode_answer(refused) == jobs.Refused("there is no job 'a2'")
    assert jobs.JobState.decode(state) == jobs.JobState("a1", 7, "running", None, None, 1.75e9)
    assert Improvement.decode(best) == Improvement(7, 0, 0.25, 17, 6, 0.5, True, {"x": 1})
    assert jobs.encode(jobs.Show("a1")) == request
    assert msgpack.unpackb(best)[0] == 7


def test_the_page_names_every_request_and_argument():
    for request in get_args(jobs.Request):
        assert f"`{request.name}`" in PROTOCOL
        for field in dataclasses.fields(request):
            assert f"`{field.name}`" in PROTOCOL
    assert f"version {jobs.VERSION}" in PROTOCOL
