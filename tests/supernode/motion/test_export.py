"""Motions in files: what `supernode export` writes, read back by other code than wrote it."""

import csv
import io
import json
import math
import sys

import numpy as np
import pytest
from command_line import in_process
from mcap.reader import make_reader
from mcap_files import read
from rooms import EMPTY_ROOM
from scipy.spatial.transform import Rotation

from problems.motion import Body, Column, Joints, Motion, Values
from supernode.__main__ import main
from supernode.motion.mcap_file import as_mcap

ROOM = (
    EMPTY_ROOM
    + """
radius = 0.5
[[obstacles]]
shape = "circle"
center = [5.0, 5.0]
radius = 0.5
"""
)
DRIVE = {
    "commands": [["rotate", 0.0], ["move", 2.0], ["rotate", 1.5]],
    "path": [[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [3.0, 1.0, 0.0], [3.0, 1.0, 1.5]],
    "length": 2.0,
}
MEETING = """
kind = "coordination"
[diagram]
cells = [4, 3]
times = [[0.5, 0.1], [0.25, 0.2]]
"""
MET = {"time": 1.7, "points": [[2, 1]]}  # robot 1 is the slower one in both rectangles
LIMITS = """limit: speed 0.5 m/s (--speed)
limit: acceleration 1 m/s^2 (default: full speed after 0.5 s)
limit: turn speed 1 rad/s (default: no point of it, 0.5 from the axis at most, exceeds the speed)
limit: turn acceleration 2 rad/s^2 (default: as soon at full speed as along the path)
note: it rests at 1 corner of the path
"""


@pytest.fixture
def export(tmp_path, capsys):
    """Runs the command on a problem and a result as texts; exit code, stdout and stderr."""

    def run(problem, result, *options):
        (tmp_path / "problem.toml").write_text(problem)
        (tmp_path / "result.json").write_text(result if isinstance(result, str) else json.dumps(result))
        return in_process(capsys, "export", tmp_path / "problem.toml", tmp_path / "result.json", *options)

    return run


def test_csv_has_names_with_units_and_goes_from_start_to_goal(export):
    code, out, err = export(ROOM, DRIVE, "--speed", 0.5, "--rate", 2)
    assert (code, err) == (0, LIMITS)
    names, *rows = csv.reader(io.StringIO(out))
    assert names == ["t [s]", "x [m]", "y [m]", "heading [rad]"]
    numbers = np.array(rows, float)
    assert np.all(np.diff(numbers[:, 0]) > 0.0)
    np.testing.assert_array_equal(numbers[[0, -1]], [[0.0, 1.0, 1.0, 0.0], [6.5, 3.0, 1.0, 1.5]])
    assert [4.5, 3.0, 1.0, 0.0] in numbers.tolist()


def test_json_has_the_same_rows(export):
    _, text, _ = export(ROOM, DRIVE, "--speed", 0.5)
    code, out, err = export(ROOM, {"solution": DRIVE}, "--speed", 0.5, "--format", "json")
    assert (code, err, len(out.splitlines())) == (0, LIMITS, 1)
    table = json.loads(out)
    assert list(table) == ["kind", "limits", "notes", "columns", "units", "rows"]
    assert table["limits"][1] == {
        "name": "acceleration",
        "values": [1.0],
        "unit": "m/s^2",
        "source": "default: full speed after 0.5 s",
    }
    assert table["notes"] == ["it rests at 1 corner of the path"]
    assert (table["kind"], table["columns"]) == ("mobile-robot", ["t", "x", "y", "heading"])
    assert table["units"] == ["s", "m", "m", "rad"]
    assert table["rows"] == [[float(cell) for cell in row] for row in list(csv.reader(io.StringIO(text)))[1:]]


def test_mcap_shows_a_robot_among_its_obstacles(export, tmp_path):
    path = tmp_path / "motion.mcap"
    assert export(ROOM, DRIVE, "--speed", 0.5, "-o", path) == (0, "", LIMITS)
    (said,) = make_reader(io.BytesIO(path.read_bytes())).iter_metadata()
    assert said.name == "limits"
    assert said.metadata["speed"] == "[0.5] m/s (--speed)"
    table = json.loads(export(ROOM, DRIVE, "--speed", 0.5, "--format", "json")[1])
    found = read(path.read_bytes())
    poses = found["/pose", "foxglove.PoseInFrame"]
    frames = found["/tf", "foxglove.FrameTransform"]
    ((_, scene),) = found["/scene", "foxglove.SceneUpdate"]
    assert len(found) == 3
    assert len(poses) == len(frames) == len(table["rows"])
    for (time, pose), (_, frame), (t, x, y, heading) in zip(poses, frames, table["rows"], strict=True):
        assert time == round(t * 1e9)
        assert pose["frame_id"] == frame["parent_frame_id"] == "world"
        assert pose["pose"]["position"] == frame["translation"] == {"x": x, "y": y, "z": 0.0}
        turn = pose["pose"]["orientation"]
        assert turn == frame["rotation"]
        assert 2.0 * math.atan2(turn["z"], turn["w"]) == pytest.approx(heading)
    lines = {entity["id"]: (entity["frame_id"], len(entity["lines"])) for entity in scene["entities"]}
    assert lines == {"robot": (frames[0][1]["child_frame_id"], 1), "obstacles": ("world", 2)}


def test_mcap_has_a_topic_for_each_robot(export, tmp_path):
    path = tmp_path / "motion.mcap"
    code, out, err = export(MEETING, MET, "-o", path)
    assert (code, out) == (0, "")
    assert err.splitlines()[0] == "limit: robot_1 speed 2 cells/s (diagram.times)"
    found = read(path.read_bytes())
    ends = {topic: messages[-1][1] for (topic, _), messages in found.items()}
    assert {topic: end["cell"] for topic, end in ends.items()} == {"/robot_1/values": 3.0, "/robot_2/values": 2.0}
    assert {name for _, name in found} == {"supernode.Values"}
    assert {messages[-1][0] for messages in found.values()} == {1_700_000_000}


def arm(name, rows=5, **known):
    generator = np.random.default_rng(3)
    some = {quantity: generator.normal(size=(rows, 2)) for quantity in ("position", *known)}
    return Joints(name, ("hip", "knee"), **some, links=generator.normal(size=(rows, 3, 3)))


def test_joints_say_what_is_known_of_them():
    times = np.arange(5) * 0.25
    arms = (arm("left"), arm("right", velocity=1, acceleration=1, effort=1))
    found = read(as_mcap(Motion(times, arms)))
    for track in arms:
        messages = found[f"/{track.name}/joints", "foxglove.JointStates"]
        assert [time for time, _ in messages] == [0, 250_000_000, 500_000_000, 750_000_000, 1_000_000_000]
        for row, (_, message) in enumerate(messages):
            assert [joint["name"] for joint in message["joints"]] == ["hip", "knee"]
            for quantity, (_, values) in track.quantities.items():
                assert [joint[quantity] for joint in message["joints"]] == values[row].tolist()
            assert all(joint.keys() == {"name", *track.quantities} for joint in message["joints"])
        links = [scene["entities"][0] for _, scene in found[f"/{track.name}/links", "foxglove.SceneUpdate"]]
        assert {entity["id"] for entity in links} == {track.name}
        points = [[list(point.values()) for point in entity["lines"][0]["points"]] for entity in links]
        np.testing.assert_array_equal(points, track.links)
    assert len(found) == 4


def test_a_body_turns_about_axes_that_stand_still():
    angles = np.random.default_rng(5).uniform(-4.0, 4.0, (9, 3))
    body = Body("", (Column("yaw", "rad", angles[:, 2]),), angles, angles)
    found = read(as_mcap(Motion(np.arange(9.0), (body, Values("v", (Column("w", "", angles[:, 0]),))))))
    turns = [list(pose["pose"]["orientation"].values()) for _, pose in found["/pose", "foxglove.PoseInFrame"]]
    expected = Rotation.from_euler("xyz", angles)
    assert np.abs((Rotation.from_quat(turns) * expected.inv()).magnitude()).max() < 1e-9
    assert ("/scene", "foxglove.SceneUpdate") not in found


def test_the_format_is_the_files_unless_it_is_told(export, tmp_path):
    for name, options, start in (
        ("a.json", [], b'{"kind"'),
        ("a.csv", [], b"t [s],"),
        ("a", [], b"t [s],"),
        ("a.txt", ["--format", "csv"], b"t [s],"),
        ("a.mcap", [], b"\x89MCAP0"),
        ("b.csv", ["--format", "json"], b'{"kind"'),
    ):
        assert export(ROOM, DRIVE, "--speed", 1, "-o", tmp_path / name, *options)[:2] == (0, "")
        assert (tmp_path / name).read_bytes().startswith(start)


@pytest.mark.parametrize(
    ("problem", "result", "options", "said"),
    [
        (ROOM, DRIVE, [], "--speed: expected a speed in m/s, as a path of mobile-robot has no times, found nothing"),
        (ROOM, DRIVE, ["--speed", 0], "--speed: expected a number greater than 0, found 0 (see "),
        (ROOM, DRIVE, ["--speed", "nan"], "--speed: expected a number greater than 0, found nan (see "),
        (ROOM, DRIVE, ["--speed", "fast"], "--speed: expected a number greater than 0, found fast (see "),
        (ROOM, DRIVE, ["--speed", 1, "--rate", 1e9], "--rate: expected at most 1,000,000 rows, found "),
        (ROOM, DRIVE, ["--speed", 5e-324], "--rate: expected at most 1,000,000 rows, found inf: 50 a second for inf s"),
        (ROOM, DRIVE, ["--speed", 1, "--format", "mcap"], "-o: expected a file to write MCAP to, found nothing"),
        (
            ROOM,
            DRIVE,
            ["--speed", 1, "-o", "x.bag"],
            "-o: expected a file that ends in one of .csv, .json, .mcap, or --format, found x.bag",
        ),
        (ROOM, DRIVE, ["--speed", 1, "--acceleration", 0], "--acceleration: expected a number greater than 0, found 0"),
        (ROOM, DRIVE, ["--speed", 1, "-o", "/nowhere/x.csv"], "-o: expected a file that can be written, found /nowher"),
        (ROOM, "{", ["--speed", 1], "{folder}/result.json: expected JSON, found "),
        (ROOM, {"path": []}, ["--speed", 1], "{folder}/result.json: solution: "),
        (ROOM + "oops = 1", DRIVE, ["--speed", 1], "{folder}/problem.toml: "),
        (MEETING, MET, ["--speed", 1], "--speed: expected none for coordination, which has times of "),
        (
            'kind = "function"\nname = "sphere"\ndimension = 2',
            {},
            [],
            "{folder}/problem.toml: kind: expected one whose solution is a motion (arm-path, coordination, min-time, "
            "mobile-robot, robot-path, sphere-path, terrain), found 'function'",
        ),
    ],
)
def test_wrong_input_is_one_error_line(export, tmp_path, problem, result, options, said):
    code, out, err = export(problem, result, *options)
    assert (code, out) == (2, "")
    assert err.startswith("error: " + said.replace("{folder}", str(tmp_path)))
    assert len(err.splitlines()) == 1


def test_what_the_check_rejects_is_not_written(export, tmp_path):
    path = tmp_path / "motion.csv"
    for result, why in (
        (DRIVE | {"length": 9.0}, "the path is 2 m long"),
        ({"solution": None}, "there is no solution"),
        ({"solution": None, "best_attempt": DRIVE}, "there is no solution, only a best attempt"),
    ):
        code, out, err = export(ROOM, result, "--speed", 1, "-o", path)
        assert (code, out, len(err.splitlines())) == (3, "", 1)
        assert err.startswith(f"rejected: {why}")
        assert not path.exists()


def test_without_the_package_mcap_it_says_what_to_install(export, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    code, _, err = export(ROOM, DRIVE, "--speed", 1, "-o", tmp_path / "motion.mcap")
    assert (code, err) == (2, "error: --format: writing MCAP needs the package mcap: pip install 'supernode[mcap]'\n")


def test_a_problem_of_ones_own_has_a_motion_if_its_class_says_so(own_problem, tmp_path, capsys):
    path, result = own_problem(), tmp_path / "result.json"
    with (tmp_path / "own_module.py").open("a") as module:
        module.write(
            "    def motion(self, solution, pace):\n"
            "        from problems.motion import Column, Motion, Values\n"
            "        print('moving')\n"
            "        times = np.arange(3.0) / pace.along('one-max', 'bits/s')\n"
            "        return Motion(times, (Values('', (Column('bits', 'bit', np.arange(3.0)),)),))\n"
        )
    result.write_text(json.dumps({"integers": [1] * 40}))
    assert main(["export", str(path), str(result), "--speed", "2"]) == 0
    assert capsys.readouterr().out == "t [s],bits [bit]\n0.0,0.0\n0.5,1.0\n1.0,2.0\n"
