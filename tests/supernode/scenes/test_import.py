"""`supernode import`: scenes from elsewhere become problem files that validate and mean the same."""

import contextlib
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter

from problems.errors import BadInput
from problems.robots.fields import Attached, GoalPose, Obstacle, rotation_of
from problems.robots.loading import gather_robot
from supernode.__main__ import main
from supernode.files.toml_text import as_tables
from supernode.scenes import shapes
from supernode.scenes.moveit_text import read_scene
from supernode.scenes.places import inverse, place, position_of, quaternion_of

DATA = Path(__file__).parent / "data"
SHARED = Path(__file__).resolve().parents[4] / "shared" / "data"
LEVER = ("--robot", DATA / "lever.urdf", "--srdf", DATA / "lever.srdf")


def run(capsys, *arguments):
    code = main(["import", *map(str, arguments)])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def imported(capsys, tmp_path, *arguments):
    """The fields of the written file, once its tables have validated, and what was said on stderr."""
    output = tmp_path / "out.toml"
    code, _, err = run(capsys, *arguments, "-o", output)
    assert code == 0, err
    fields = tomllib.loads(output.read_text())
    text = json.dumps([fields.get("obstacles", []), fields.get("attached", [])])
    TypeAdapter(tuple[list[Obstacle], list[Attached]]).validate_json(text, strict=True)
    if "goal_pose" in fields:
        GoalPose.model_validate(fields["goal_pose"])
    gathered = gather_robot(fields, tmp_path)
    assert "<robot" in gathered["robot"]["urdf"]
    return fields, err


def error(capsys, *arguments):
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    return err


# .scene ---------------------------------------------------------------------------------------------------------------
def test_a_scene_of_the_old_form(capsys, tmp_path):
    states = ("--group", "crane", "--start", "rest", "--goal", "0.5,-0.5")
    fields, err = imported(capsys, tmp_path, DATA / "old.scene", *LEVER, *states)
    assert err == ""
    assert (fields["kind"], fields["start"], fields["goal"]) == ("robot-path", [0.0, -0.5], [0.5, -0.5])
    assert fields["robot"]["group"] == "crane"
    box, ball = fields["obstacles"]
    assert box == {"id": "big box", "shape": "box", "size": [0.5, 0.25, 0.125], "position": [1.0, 2.0, 3.0]}
    assert (ball["shape"], ball["radius"], ball["position"]) == ("sphere", 0.1, [0.5, 0.0, 0.5])
    assert ball["quaternion"] == pytest.approx([0, 0, 0.5**0.5, 0.5**0.5])


def test_a_scene_of_the_new_form_with_subframes_cones_and_meshes(capsys, tmp_path):
    fields, err = imported(capsys, tmp_path, DATA / "new.scene", *LEVER)
    assert "add start" in err
    assert "add goal" in err
    shelf, post, hat, tent = fields["obstacles"]
    assert (shelf["id"], post["id"]) == ("shelf", "shelf.2")
    assert shelf["position"] == pytest.approx([1.0, 0.5, 0.0])  # the shape's place, turned by the object's
    assert post == post | {"shape": "cylinder", "radius": 0.05, "length": 0.3, "position": [1.0, 0.0, 1.0]}
    assert (hat["shape"], hat["file"], tent["file"]) == ("mesh", "out-meshes/hat.obj", "out-meshes/tent.obj")
    assert (tmp_path / tent["file"]).read_text().splitlines()[:5] == [
        "v 0.0 0.0 0.0", "v 1.0 0.0 0.0", "v 0.0 1.0 0.0", "v 0.0 0.0 1.0", "f 1 3 2"
    ]  # fmt: skip


def test_to_standard_output_without_meshes_only(capsys):
    code, out, _ = run(capsys, DATA / "old.scene", *LEVER)
    assert code == 0
    assert tomllib.loads(out)["robot"]["urdf"].endswith("lever.urdf")
    assert "-o: expected a file" in error(capsys, DATA / "new.scene", *LEVER)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("\n.", "", "expected '* id' of an object, or '.' at the end, found the end of the file"),
        ("0.5 0.25 0.125", "0.5 0.25 wide", "line 5: object 'big box': expected a number (sizes of a box), found \"wi"),
        ("sphere", "plane", "line 11: object 'ball': expected box, sphere, cylinder, cone or mesh, found \"plane\""),
        ("0.1\n", "-0.1\n", "expected 1 sizes of a sphere above 0 m, found [-0.1]"),
        ("0.70710678 0.70710678", "0 3", "expected a unit quaternion x, y, z, w"),
    ],
)
def test_a_wrong_scene_gets_one_clear_error(capsys, tmp_path, old, new, expected):
    path = tmp_path / "bad.scene"
    path.write_text((DATA / "old.scene").read_text().replace(old, new, 1))
    message = error(capsys, path, *LEVER)
    assert message.startswith(f"error: {path}: line ")
    assert expected in message


triples = st.tuples(*[st.floats(-100, 100)] * 3)
quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1).map(
    lambda q: tuple(np.array(q) / np.linalg.norm(q))
)  # fmt: skip


@settings(deadline=None, max_examples=30)
@given(st.lists(st.tuples(triples, quaternions, triples, quaternions), max_size=3), st.booleans())
def test_what_is_written_as_moveit_does_is_read(objects, is_new):
    def numbers(values):
        return " ".join(repr(float(each)) for each in values)

    lines = ["any name"]
    for number, (origin, turn, position, rotation) in enumerate(objects):
        lines += [f"* id {number}", *([numbers(origin), numbers(turn)] if is_new else []), "1", "box", "1 2 3"]
        lines += [numbers(position), numbers(rotation), "0 0 0 0", *(["0"] if is_new else [])]
    solids = read_scene("\n".join([*lines, ".", ""]), "x.scene").solids
    assert [each.id for each in solids] == [f"id {number}" for number in range(len(objects))]
    for solid, (origin, turn, position, rotation) in zip(solids, objects, strict=True):
        outer = place(origin, turn) if is_new else np.eye(4)
        np.testing.assert_allclose(solid.pose, outer @ place(position, rotation), atol=1e-9)


@settings(deadline=None, max_examples=50)
@given(st.text(alphabet=" \n*.0123456789boxspheremesh-", max_size=80))
def test_any_text_is_read_or_refused(text):
    with contextlib.suppress(BadInput):  # anything else fails the test
        read_scene(text, "x.scene")


# YAML -----------------------------------------------------------------------------------------------------------------
def test_a_planning_scene_and_a_request(capsys, tmp_path):
    fields, err = imported(capsys, tmp_path, DATA / "scene.yaml", DATA / "request.yaml", *LEVER)
    assert fields["start"] == [0.25, -0.5]  # the request's, which comes later
    assert fields["goal"] == [1.5, -1.5]
    assert "goal: tilt was moved from -1.75 to its limit -1.5" in err
    assert fields["robot"]["group"] == "crane"
    assert fields["robot"]["fixed"] == {"slide": 0.1}
    top, leg, ball, wedge = fields["obstacles"]
    assert (top["id"], top["size"], top["position"]) == ("table", [0.4, 0.5, 0.02], [1.0, 0.0, 0.3])
    assert (leg["id"], leg["radius"], leg["length"]) == ("table.2", 0.04, 0.3)
    assert "quaternion" not in leg  # all zeros means none
    assert (ball["id"], ball["position"]) == ("7", pytest.approx([0.5, -0.5, 1.5]))  # the camera looks down
    assert wedge["file"] == "out-meshes/wedge.obj"
    load, lamp = fields["attached"]
    assert (load["link"], load["radius"], load["length"], load["position"]) == ("hook", 0.03, 0.2, [0.0, 0.0, -0.15])
    assert load["may_touch"] == ["hook", "boom"]
    assert lamp["link"] == "boom"


def test_an_attached_solid_keeps_its_place_in_the_world(capsys, tmp_path):
    fields, _ = imported(capsys, tmp_path, DATA / "scene.yaml", *LEVER)
    lamp = fields["attached"][1]
    turn, tilt = 0.0, -0.5
    boom = place((0, 0, 0.5), (0, np.sin(tilt / 2), 0, np.cos(tilt / 2)))
    assert turn == 0.0
    np.testing.assert_allclose(boom[:3, :3] @ lamp["position"] + boom[:3, 3], [0.3, 0, 0.9], atol=1e-9)


def test_a_pose_goal(capsys, tmp_path):
    fields, err = imported(capsys, tmp_path, DATA / "pose.yaml", *LEVER)
    assert err == ""
    goal = fields["goal_pose"]
    assert goal["link"] == "hook"
    assert (goal["position_tolerance"], goal["angle_tolerance"]) == (0.002, 0.01)
    turned = rotation_of(goal["quaternion"]) @ [0, 0, 0.1]  # the link's z axis is the world's x axis
    np.testing.assert_allclose(goal["position"] + turned, [0.5, 0, 0.75], atol=1e-9)
    assert "goal" not in fields
    fields, _ = imported(capsys, tmp_path, DATA / "pose.yaml", *LEVER, "--kind", "robot-ik")
    assert fields["kind"] == "robot-ik"
    assert "start" not in fields


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "dimensions: [0.4, 0.5, 0.02]",
            "dimensions: [0.4, 0.5]",
            "primitives[0]: expected 3 sizes of a box above 0 m",
        ),
        ("type: box", "type: pyramid", "world.collision_objects[0].primitives[0]: expected box, sphere, cylinder, co"),
        (
            "frame_id: camera}\n      prim",
            "frame_id: lamp}\n      prim",
            "expected a frame that is known (map, world, fo",
        ),
        ("[1, 2, 3]\n", "[1, 2, 4]\n", "meshes[0]: expected triangles of vertices 0 to 3, found 0 to 4"),
        ("link_name: boom", "link_name: bom", "expected a link of"),
        ("[0, -5e-01, 0.1, 3]", "[0, 1]", "robot_state.joint_state.position: expected 4 values, one for each name, fo"),
        ("    - id: table", "    - name: table", "world.collision_objects[0].id: expected this field, found nothing"),
        ("translation: [0, 0, 2]", "translation: [0, 0]", "transform.translation: expected 3 numbers, found [0, 0]"),
        ("name: (noname)", "name: [", "expected YAML, found"),
        ("world:", "word:", None),
    ],
)
def test_a_wrong_message_gets_one_clear_error(capsys, tmp_path, old, new, expected):
    path = tmp_path / "bad.yaml"
    text = (DATA / "scene.yaml").read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    if expected is None:
        fields, _ = imported(capsys, tmp_path, path, *LEVER)
        assert "obstacles" not in fields
        return
    message = error(capsys, path, *LEVER, "-o", tmp_path / "out.toml")
    assert message.startswith(f"error: {path}: ")
    assert expected in message


def test_other_files_and_robots_are_refused(capsys, tmp_path):
    assert "expected a scene, found no such file" in error(capsys, tmp_path / "none.scene", *LEVER)
    assert "expected a file that ends in .scene" in error(capsys, DATA / "lever.urdf", *LEVER)
    assert "--robot: expected the robot's URDF, found none in the scene" in error(capsys, DATA / "old.scene")
    assert "found 'lever'" in error(capsys, DATA / "scene.yaml")
    assert "--start: expected 2 numbers (turn, tilt)" in error(
        capsys, DATA / "old.scene", *LEVER, "--group", "crane", "--start", "1,2,3"
    )
    assert "did you mean 'rest'?" in error(capsys, DATA / "old.scene", *LEVER, "--group", "crane", "--start", "rst")
    assert "expected a file with many problems" in error(capsys, DATA / "old.scene", *LEVER, "--problem", "2")
    assert "--kind: expected robot-path" in error(capsys, DATA / "request.yaml", *LEVER, "--kind", "robot-ik")
    assert "--kind: expected robot-path with --start or --goal" in error(
        capsys, DATA / "old.scene", *LEVER, "--group", "crane", "--kind", "robot-ik", "--goal", "rest"
    )
    (tmp_path / "list.yaml").write_text("- 1\n")
    assert "expected a planning scene or a motion-plan request" in error(capsys, tmp_path / "list.yaml", *LEVER)


def test_a_goal_of_some_joints_takes_the_others_from_the_start(capsys, tmp_path):
    request = (DATA / "request.yaml").read_text().replace("      - {position: -1.75, joint_name: tilt}\n", "")
    (tmp_path / "request.yaml").write_text(request)
    fields, err = imported(capsys, tmp_path, DATA / "scene.yaml", tmp_path / "request.yaml", *LEVER)
    assert fields["goal"] == [1.5, fields["start"][1]]
    assert "note: goal: the scene has no value of tilt; the start's was taken\n" in err


# JSON -----------------------------------------------------------------------------------------------------------------
def test_a_problem_of_many(capsys, tmp_path):
    fields, err = imported(capsys, tmp_path, DATA / "problems.json", *LEVER, "--problem", "4")
    assert err == ""
    assert (fields["start"], fields["goal"]) == ([0.0, 0.0, 0.1], [-1.0, 0.0, 0.1])
    can, base = fields["obstacles"]
    assert can == {"id": "can", "shape": "cylinder", "radius": 0.03, "length": 0.14, "position": [0.6, 0.4, 0.2]}
    assert (base["id"], base["size"]) == ("base", [0.7, 0.7, 0.04])
    assert "expected one of the problems" in error(capsys, DATA / "problems.json", *LEVER, "--problem", "5")


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs ../shared/data")
@pytest.mark.parametrize("robot", ["panda", "ur5", "fetch", "baxter"])
def test_problems_of_motion_bench_maker(capsys, tmp_path, robot):
    family = sorted((SHARED / "motionbenchmaker" / robot).glob("*.json"))[0]
    given = json.loads(family.read_text())["problems"][-1]
    described = ("--robot", SHARED / robot / f"{robot}.urdf", "--srdf", SHARED / robot / f"{robot}.srdf")
    fields, _ = imported(capsys, tmp_path, family, "--problem", given["index"], *described)
    assert (fields["start"], fields["goal"]) == (pytest.approx(given["start"]), pytest.approx(given["goal"]))
    assert len(fields["obstacles"]) == len(given["obstacles"])


# Parts ----------------------------------------------------------------------------------------------------------------
@settings(deadline=None, max_examples=50)
@given(triples, quaternions)
def test_places_are_written_as_they_were_read(position, quaternion):
    matrix = place(position, quaternion)
    np.testing.assert_allclose(place(position_of(matrix), quaternion_of(matrix)), matrix, atol=1e-9)
    np.testing.assert_allclose(inverse(matrix) @ matrix, np.eye(4), atol=1e-9)


@settings(deadline=None, max_examples=30)
@given(st.floats(0.01, 10), st.floats(0.01, 10), st.integers(0, 1000))
def test_a_cone_s_mesh_contains_the_cone(radius, length, seed):
    vertices, triangles = shapes.cone(radius, length)
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rng = np.random.default_rng(seed)
    up, turn = rng.random(100), 2 * np.pi * rng.random(100)
    wide = radius * (1 - up)
    points = np.stack([wide * np.cos(turn), wide * np.sin(turn), length * (up - 0.5)], axis=1)
    inside = np.einsum("tk,ptk->pt", normals, points[:, None] - corners[None, :, 0])
    assert (inside <= 1e-9 * radius * length * max(radius, length)).all()  # normals point outwards


values = st.recursive(
    st.booleans() | st.integers(-1000, 1000) | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=12,
)


@settings(deadline=None, max_examples=100)
@given(st.dictionaries(st.text(max_size=5), values, max_size=4))
def test_tables_are_read_as_they_were_written(fields):
    assert tomllib.loads(as_tables(fields)) == fields


def test_the_example_is_what_the_tutorial_s_command_writes(capsys, tmp_path):
    examples = Path(__file__).resolve().parents[3] / "examples" / "robots"
    described = ("--robot", examples / "sorter.urdf", "--srdf", examples / "sorter.srdf", "--group", "arm")
    fields, err = imported(capsys, tmp_path, examples / "bench.scene", *described, "--start", "left", "--goal", "right")
    assert err == ""
    expected = tomllib.loads((examples / "bench.toml").read_text())
    assert {**fields, "robot": None} == {**expected, "robot": None}


# What others made
BOX = "(noname)+\n* thing\n1\nbox\n{size}\n{place}\n0 0 0 1\n0 0 0 0\n.\n"
MESH = "(noname)+\n* thing\n1\nmesh\n3 1\n0 0 0\n1 0 0\n0 1 0\n{corners}\n0 0 0\n0 0 0 1\n0 0 0 0\n.\n"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (BOX.format(size="1 1 1", place="nan 0 0"), "line 6: object 'thing': expected a number"),
        (BOX.format(size="1 1 1", place="1e999 0 0"), "line 6: object 'thing': expected a number"),
        (BOX.format(size="1 1 1", place="1e308 0 0"), "expected a position within 1e+06 m"),
        (MESH.format(corners="0 1 99999999999999999999"), "expected triangles of vertices 0 to 2"),
    ],
)
def test_numbers_that_no_scene_has_are_refused(capsys, tmp_path, text, complaint):
    path = tmp_path / "strange.scene"
    path.write_text(text)
    assert complaint in error(capsys, path, *LEVER)


@pytest.mark.parametrize(
    "text",
    [
        "&a [*a]",  # a list within itself
        "2001-01-01: 1",  # a key that JSON lacks
        "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9) if n else 'x'}]\n" for n in range(30)),  # 9^29 elements
        "world: {collision_objects: &a [*a]}",
    ],
    ids=["within itself", "date", "many", "objects"],
)
def test_values_that_only_yaml_has_are_refused_by_one_error(capsys, tmp_path, text):
    path = tmp_path / "strange.yaml"
    path.write_text(text)
    assert "expected" in error(capsys, path, *LEVER)


@pytest.mark.parametrize("others", ["7", '["turn"]', '"turn"'])
def test_other_values_that_are_no_table_are_refused(capsys, tmp_path, others):
    path = tmp_path / "strange.json"
    problem = f'{{"index": 1, "start": [0, 0, 0], "goal": [1, 0, 0], "others": {others}}}'
    path.write_text(f'{{"joints": ["turn", "tilt", "slide"], "problems": [{problem}]}}')
    assert "problems[0].others: expected a table" in error(capsys, path, *LEVER)


def test_a_name_that_utf_8_lacks_is_refused(capsys, tmp_path):
    path = tmp_path / "strange.json"
    box = '{"id": "\\ud800", "primitives": [{"type": "box", "dimensions": [1, 1, 1]}]}'
    path.write_text(f'{{"world": {{"collision_objects": [{box}]}}}}')
    assert "id: expected a text that UTF-8 can hold" in error(capsys, path, *LEVER)
