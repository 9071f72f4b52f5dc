"""The targets that are files: problem files, robots, scenes, meshes, maps, results and run logs.

A target returns if the file is refused by one clear error, or is read. Files are written to a folder in memory.
"""

import argparse
import base64
import contextlib
import io
import json
import shutil
import tempfile
import tomllib
import zlib
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

import numpy as np

from coordinator.service.checking import check
from fuzz.forms import BYTES, JSON, TOML, XML, YAML
from fuzz.target import ROOT, Target
from genetics.coding import Keys
from problems import BadInput, ProblemFile
from problems.file import load
from problems.guard import checked, decoded
from problems.modules import Modules
from problems.robots.chain import chain_of
from problems.robots.meshes import UNSCALED, decode_mesh, encode_mesh, read_mesh
from problems.robots.packing import pack, unpack
from problems.robots.srdf import read_srdf
from problems.robots.urdf import completed, read_urdf
from problems.sphere_path.vehicle import packed, unpacked
from problems.terrain import movingai
from supernode.commands import logs
from supernode.files.toml_text import as_tables
from supernode.runs.results import read_table
from supernode.scenes.problem_fields import Wishes, fields_of
from supernode.scenes.reading import read_files
from supernode.scenes.robot import Choice, RobotOfScene

_EXAMPLES = ROOT / "examples"
_SCENES = ROOT / "tests" / "supernode" / "scenes" / "data"
# Not the large robots: reading their meshes takes a second, and a small one runs the same code.
_LARGE = ("baxter-both-arms", "fetch-table", "panda-ik", "panda-shelf", "ur5-bin", "coordination-arms")
_OWN = ("inspection_tour", "own_coding", "own_problem")  # users' modules: no foreign text may have them imported


def _examples() -> list[Path]:
    names = [each for each in sorted(_EXAMPLES.glob("*.toml")) if each.stem not in (*_LARGE, *_OWN)]
    return [*names, _EXAMPLES / "robots" / "bench.toml"]


@cache
def _folder() -> Path:
    """Return a folder with the files that examples name; it is removed when the process ends."""
    folder = tempfile.TemporaryDirectory(prefix="fuzz-", dir="/dev/shm")
    _kept.append(folder)
    shutil.copytree(_EXAMPLES, folder.name, dirs_exist_ok=True)
    shutil.copytree(_EXAMPLES / "robots", folder.name, dirs_exist_ok=True)
    shutil.copytree(_SCENES, folder.name, dirs_exist_ok=True)
    return Path(folder.name)


_kept: list[tempfile.TemporaryDirectory[str]] = []


def _written(data: bytes, ending: str) -> Path:
    path = _folder() / f"input{ending}"
    path.write_bytes(data)
    return path


def _tolerant(read: Callable[[bytes], object]) -> Callable[[bytes], bool]:
    def reads(data: bytes) -> bool:
        try:
            read(data)
        except BadInput:
            return False
        return True

    return reads


def _bytes_of(paths: Iterable[Path]) -> Callable[[], list[bytes]]:
    return lambda: [path.read_bytes() for path in paths]


# Problems -------------------------------------------------------------------------------------------------------------
def _read_problem_file(data: bytes) -> None:
    file = load(_written(data, ".toml"))
    assert ProblemFile.from_json(file.to_json()) == file


def _read_submitted(data: bytes) -> None:
    """Read and check a problem as the coordinator does that gets it from a client."""
    file = Modules().read(data.decode("utf-8", "replace"))
    assert ProblemFile.from_json(file.to_json()) == file
    check(file)


def _submitted() -> list[bytes]:
    return [load(path).to_json().encode() for path in _examples()]


@cache
def _problems() -> list[ProblemFile]:
    return [load(path) for path in _examples()]


def _solutions() -> list[bytes]:
    seeds = []
    for number, file in enumerate(_problems()):
        problem = file.problem(checked=True)
        genome = problem.coding.random(Keys(np.zeros(1, np.int64), np.uint64(1), 0), 1).reshape(-1)
        seeds.append(json.dumps({"number": number, "solution": decoded(problem, genome)}).encode())
    return seeds


def _read_solution(data: bytes) -> None:
    """Check a foreign solution as `supernode check` does; the input says for which example."""
    table = read_table(str(_written(data, ".json")))
    number, solution = table.get("number"), table.get("solution")
    if type(number) is int and 0 <= number < len(_problems()) and isinstance(solution, dict):
        checked(_problems()[number].problem(checked=True), solution)


# Robots and scenes ----------------------------------------------------------------------------------------------------
def _read_urdf(data: bytes) -> None:
    text = data.decode("utf-8", "replace")
    urdf = read_urdf(text)
    again = read_urdf(completed(text))
    assert again.movable == urdf.movable
    chain_of(urdf, urdf.movable, {})


def _read_srdf(data: bytes) -> None:
    urdf = read_urdf((_EXAMPLES / "robots" / "sorter.urdf").read_text())
    srdf = read_srdf(data.decode("utf-8", "replace"))
    for group in srdf.groups:
        with contextlib.suppress(BadInput):
            srdf.joints_of(group, urdf)


def _read_scene(ending: str) -> Callable[[bytes], bool]:
    def reads(data: bytes) -> None:
        choice = Choice(str(_folder() / "lever.urdf"), str(_folder() / "lever.srdf"))
        problem = 4 if b'"problems"' in data else None  # the second of the file that begins with 3
        scene = read_files([str(_written(data, ending))], problem)
        robot = RobotOfScene.of(choice, scene)
        imported = fields_of(scene, robot, Wishes("robot-path", None, None, _folder(), _folder() / "meshes"))
        tomllib.loads(as_tables(imported.fields).encode().decode())  # what is written can be read

    return _tolerant(reads)


def _read_mesh(ending: str) -> Callable[[bytes], bool]:
    def reads(data: bytes) -> None:
        decode_mesh(encode_mesh(*read_mesh(_written(data, ending), UNSCALED, "mesh")))

    return _tolerant(reads)


def _read_meshes(data: bytes) -> bool:
    return max([_read_mesh(ending)(data) for ending in (".stl", ".obj", ".dae")])  # every one is called


def _meshes() -> list[bytes]:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    stl = bytes(80) + np.uint32(1).tobytes() + bytes(12) + corners.tobytes() + bytes(2)
    return [stl, *(path.read_bytes() for path in sorted(_EXAMPLES.glob("*.obj")))]


# Packed texts ---------------------------------------------------------------------------------------------------------
def _read_packed(data: bytes) -> bool:
    """Read base64 of compressed bytes; the input is the bytes, since no mutation would hit such a text."""
    text = base64.b64encode(zlib.compress(data, 1)).decode()
    is_right = False
    for read in (unpack, decode_mesh, unpacked):
        with contextlib.suppress(ValueError):
            read(text)
            is_right = True
    return is_right


def _packed() -> list[bytes]:
    soup = np.arange(18.0).reshape(2, 9)
    triangle = np.arange(9.0).reshape(1, 3, 3)
    texts = (
        pack({"names": ("a", "b"), "numbers": np.arange(5), "reals": np.ones((2, 3)) / 3, "soup": soup}),
        encode_mesh(triangle[0], np.array([[0, 1, 2]])),
        packed(triangle),
    )
    return [zlib.decompress(base64.b64decode(text)) for text in texts]


# Lines ----------------------------------------------------------------------------------------------------------------
def _read_map(data: bytes) -> None:
    movingai.read(_written(data, ".map"))


def _read_run_log(data: bytes) -> None:
    path = str(_written(data, ".jsonl"))
    with contextlib.redirect_stdout(io.StringIO()):
        logs.run(argparse.Namespace(improvements=[path, path]))


_RUN_LOG = (
    b'{"time": 1.5, "event": "start", "job": 1, "epoch": 0, "run": {}}\n'
    b'{"event": "improvement", "epoch": 0, "generation": 3, "cell": [0, 1], "evaluations": 40, "fitness": 0.5}\n'
)


def targets() -> list[Target]:
    """Return the targets that are files."""
    scenes = sorted(_SCENES.glob("*.scene"))
    messages = [*sorted(_SCENES.glob("*.yaml")), *sorted(_SCENES.glob("*.json"))]
    robots = [_SCENES / "lever.urdf", _EXAMPLES / "robots" / "sorter.urdf"]
    groups = [_SCENES / "lever.srdf", *sorted((_EXAMPLES / "robots").glob("*.srdf"))]
    return [
        Target("problem-files", TOML, _bytes_of(_examples()), _tolerant(_read_problem_file)),
        Target("submitted", JSON, _submitted, _tolerant(_read_submitted)),
        Target("solutions", JSON, _solutions, _tolerant(_read_solution)),
        Target("urdf", XML, _bytes_of(robots), _tolerant(_read_urdf)),
        Target("srdf", XML, _bytes_of(groups), _tolerant(_read_srdf)),
        Target("scene-texts", BYTES, _bytes_of(scenes), _read_scene(".scene")),
        Target("scenes", YAML, _bytes_of(messages), _read_scene(".yaml")),
        Target("meshes", BYTES, _meshes, _read_meshes),
        Target("packed-texts", BYTES, _packed, _read_packed),
        Target("maps", BYTES, _bytes_of([_EXAMPLES / "valley.map"]), _tolerant(_read_map)),
        Target("run-logs", JSON, lambda: [_RUN_LOG], _tolerant(_read_run_log)),
    ]
