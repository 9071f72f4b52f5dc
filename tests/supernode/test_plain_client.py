"""The example that knows nothing but docs/protocol.md, with a coordinator that the test plays."""

import base64
import dataclasses
import json
import re
import struct
import subprocess
import sys
import threading
import time
import tomllib
import zlib
from pathlib import Path
from typing import get_args

import msgpack
import numpy as np
import pytest

from coordinator.jobs.states import TRANSITIONS
from coordinator.service.checking import Checker
from problems import BadInput, ProblemFile, load, registry
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


def fields_of(name):
    fields = tomllib.loads((ROOT / "examples" / name).read_text())
    del fields["run"]
    return fields


def checked(fields):
    """A problem as a client sends it, on the cluster's side."""
    checker = Checker()
    file = checker.read(json.dumps(["x.toml", fields, {}, "/nowhere"]))
    checker.check(file)
    return file.problem()


def test_a_map_is_sent_as_the_page_says():
    fields = fields_of("terrain-map.toml")
    with pytest.raises(BadInput, match=r"file: expected map, the rows themselves"):
        checked(fields)
    lines = (ROOT / "examples" / fields.pop("file")).read_text().splitlines()
    assert checked(fields | {"map": lines[4:]}).map == load(ROOT / "examples" / "terrain-map.toml").fields["map"]


def test_a_mesh_is_sent_as_the_page_says():
    fields = fields_of("sphere-path-mesh.toml")
    with pytest.raises(BadInput, match=r"expected the triangles of a mesh"):
        checked(fields)
    solids = {"mesh": packed(fields["mesh"]), "vehicle": {"mesh": packed(fields["vehicle"]["mesh"])}}
    loaded = load(ROOT / "examples" / "sphere-path-mesh.toml").problem()
    problem = checked(fields | solids)
    for mine, theirs in ((problem.mesh, loaded.mesh), (problem.vehicle.mesh, loaded.vehicle.mesh)):
        np.testing.assert_allclose(mine.triangles, theirs.triangles, atol=1e-6)


def packed(mesh):
    """The triangles of an OBJ file."""
    corners, faces = [], []
    for line in (ROOT / "examples" / mesh["file"]).read_text().splitlines():
        word, *numbers = line.split() or [""]
        if word == "v":
            corners += (float(number) * mesh["unit"] for number in numbers)
        elif word == "f":
            faces += (int(number) - 1 for number in numbers)
    assert len(faces) % 3 == 0
    data = struct.pack(f"<i{len(corners)}f{len(faces)}i", len(corners) // 3, *corners, *faces)
    return {"packed": base64.b64encode(zlib.compress(data)).decode()}


def test_a_robots_path_is_sent_as_the_page_says():
    fields = fields_of("coordination-arms.toml")
    named = [{"result": "r.json"}, fields["robots"][1]]
    with pytest.raises(BadInput, match=r"expected a path, .* found only the name \"r.json\""):
        checked(fields | {"robots": named})
    assert "path" in fields["robots"][0]
    checked(fields)


def test_the_page_says_how_what_files_hold_is_sent_for_each_kind_that_names_some():
    for kind in (name for name in registry.kinds() if "gather" in vars(registry.find(name))):
        assert f"\n| {kind} |" in PROTOCOL


def test_the_pages_table_of_states_is_that_of_the_code():
    rows = re.findall(r"^\| ([a-z]+) \| ([a-z, ]+) \|$", PROTOCOL.partition("what it may become")[2], re.MULTILINE)
    table = {state: frozenset(then.split(", ")) for state, then in rows if state in TRANSITIONS}
    assert table == {state: then for state, then in TRANSITIONS.items() if then}


def test_the_page_names_every_request_and_argument():
    for request in get_args(jobs.Request):
        assert f"`{request.name}`" in PROTOCOL
        for field in dataclasses.fields(request):
            assert f"`{field.name}`" in PROTOCOL
    assert f"version {jobs.VERSION}" in PROTOCOL
