from pathlib import Path

import numpy as np
import pytest
from tiny_robots import joint, link, lump, robot, stl

from problems import BadInput
from problems.robots.loading import gather_description, gather_robot, robots_of_extra, shape_name
from problems.robots.meshes import mesh_of
from problems.robots.urdf import read_urdf

pytest.importorskip("trimesh")
MESH = lump(1, rows=6)


def urdf(name, scale=""):
    return robot(f'<link name="a"><collision><geometry><mesh filename="{name}"{scale}/></geometry></collision></link>')


def gathered(folder, text, **own):
    (folder / "robots").mkdir(exist_ok=True)
    (folder / "robots" / "r.urdf").write_text(text)
    return gather_description({"urdf": "robots/r.urdf", **own}, folder)


@pytest.mark.parametrize(("name", "place"), [
    ("package://meshes/m.stl", "robots/meshes/m.stl"),
    ("package://mine/meshes/m.stl", "mine/meshes/m.stl"),  # beside the URDF's folder
    ("package://robots/m.stl", "robots/m.stl"),  # the package is the URDF's folder
    ("model://mine/m.stl", "mine/m.stl"),
    ("../other/m.stl", "other/m.stl"),
    ("m.STL", "robots/m.STL"),
])  # fmt: skip
def test_meshes_are_found(tmp_path, name, place):
    stl(tmp_path / place, *MESH)
    meshes = gathered(tmp_path, urdf(name))["meshes"]
    vertices, triangles = mesh_of(meshes, name)
    assert np.ptp(vertices, axis=0) == pytest.approx(np.ptp(MESH[0], axis=0), abs=1e-6)
    assert len(triangles) > 0


def test_a_file_url_and_chosen_packages(tmp_path):
    stl(tmp_path / "else where" / "mine" / "m.stl", *MESH)
    name = f"file://{tmp_path}/else%20where/mine/m.stl"
    assert mesh_of(gathered(tmp_path, urdf(name))["meshes"], name)
    fields = gathered(tmp_path, urdf("package://mine/m.stl"), packages=["else where"])
    assert mesh_of(fields["meshes"], "package://mine/m.stl")
    assert "packages" not in fields


@pytest.mark.parametrize(("name", "message"), [
    ("package://mine/m.stl", r"link 'a': expected the mesh package://mine/m.stl, found no file .*mine/m.stl.* and \d+ "
     r"more places; say packages = \[\"FOLDER\"\]"),
    ("m.stl", "expected the mesh m.stl, found no file .*robots/m.stl$"),
    ("https://a/m.stl", "expected a mesh on this computer, found https"),
    ("m.ply", "expected a mesh as STL, OBJ or DAE, found m.ply; convert"),
    ("bad.obj", "expected a mesh .*bad.obj"),
])  # fmt: skip
def test_errors_name_the_file_and_where_it_was_looked_for(tmp_path, name, message):
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "m.ply").write_text("x")
    (tmp_path / "robots" / "bad.obj").write_text("v 0 0 0\n")
    with pytest.raises(BadInput, match=message) as caught:
        gathered(tmp_path, urdf(name))
    assert "robots/r.urdf" in str(caught.value)


def test_scales_are_applied_and_kept_apart(tmp_path):
    stl(tmp_path / "robots" / "m.stl", *MESH)
    parts = "".join(
        f'<collision><geometry><mesh filename="m.stl" scale="{scale}"/></geometry></collision>'
        for scale in ("2 2 2", "1 -1 1")
    )
    meshes = gathered(tmp_path, robot(f'<link name="a">{parts}</link>'))["meshes"]
    assert len(meshes) == 2
    double, mirrored = mesh_of(meshes, "m.stl", (2.0, 2.0, 2.0))[0], mesh_of(meshes, "m.stl", (1.0, -1.0, 1.0))[0]
    assert np.ptp(double, axis=0) == pytest.approx(2 * np.ptp(mirrored, axis=0))
    assert mirrored.min(axis=0)[1] == pytest.approx(-double.max(axis=0)[1] / 2)


def test_parts_of_a_scene_are_joined_at_their_places(tmp_path):
    pytest.importorskip("collada")
    import trimesh

    scene = trimesh.Scene()
    for number in range(2):
        move = np.eye(4)
        move[0, 3] = number
        scene.add_geometry(trimesh.creation.box((0.2, 0.2, 0.2)), transform=move)
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "m.dae").write_bytes(trimesh.exchange.dae.export_collada(
        list(scene.dump())
    ))  # fmt: skip
    vertices, triangles = mesh_of(gathered(tmp_path, urdf("m.dae"))["meshes"], "m.dae")
    assert np.ptp(vertices, axis=0) == pytest.approx([1.2, 0.2, 0.2], abs=1e-6)
    assert len(triangles) == 24


def test_no_field_names_a_file_afterwards(tmp_path):
    stl(tmp_path / "rock.stl", *MESH)
    (tmp_path / "r.srdf").write_text('<robot name="tiny"/>')
    (tmp_path / "r.urdf").write_text(urdf("rock.stl"))
    rock = {"shape": "mesh", "file": "rock.stl", "scale": 2.0}
    fields = {
        "robot": {"urdf": "r.urdf", "srdf": "r.srdf"},
        "obstacles": [rock],
        "attached": [{**rock, "scale": [1.0, 1.0, 1.0]}],
    }
    done = gather_robot(fields, tmp_path)
    assert done["robot"]["urdf"].startswith("<robot")
    assert done["robot"]["srdf"].startswith("<robot")
    assert done["robot"]["meshes"].keys() == {"rock.stl", shape_name("rock.stl", (2.0, 2.0, 2.0))}
    for path in tmp_path.iterdir():
        path.unlink()
    assert gather_description(done["robot"], tmp_path) == done["robot"]


@pytest.mark.parametrize("fields", [{}, {"robot": 3}, {"robot": {"urdf": 3}}, {"robot": {}}])
def test_wrong_types_are_left_to_validation(fields, tmp_path):
    assert gather_robot(fields, tmp_path) == fields


def test_a_mesh_obstacle_that_is_missing(tmp_path):
    (tmp_path / "r.urdf").write_text(robot('<link name="a"/>'))
    fields = {"robot": {"urdf": "r.urdf"}, "obstacles": [{"shape": "box"}, {"shape": "mesh", "file": "no.stl"}]}
    with pytest.raises(BadInput, match=r"obstacles\[1\].file: expected a mesh, found no file .*no.stl"):
        gather_robot(fields, tmp_path)


@pytest.mark.skipif(not robots_of_extra(), reason="needs example-robot-data")
def test_robots_of_the_extra_come_with_their_srdf():
    assert {"panda", "ur5", "kinova", "xarm7", "solo12", "tiago", "talos_left_arm"} <= robots_of_extra().keys()
    fields = gather_description({"urdf": "example-robot-data:panda"}, Path())
    assert "disable_collisions" in fields["srdf"]
    with pytest.raises(
        BadInput, match=r"robot.urdf: expected a robot of example-robot-data, found 'pandda'; did you mean 'panda'"
    ):
        gather_description({"urdf": "example-robot-data:pandda"}, Path())


def test_limits_that_pinocchio_needs_are_completed(tmp_path):
    own = joint("j", "a", "b", extra='<limit lower="-1" upper="1"/>') + joint("k", "b", "c", extra="")
    fields = gathered(tmp_path, robot(link("a"), link("b"), link("c"), own))
    pinocchio = pytest.importorskip("pinocchio")
    assert list(pinocchio.buildModelFromXML(fields["urdf"]).names) == ["universe", "j", "k"]
    joints = read_urdf(fields["urdf"]).joints
    assert np.isnan([joints["j"].velocity, joints["j"].effort]).all()
    assert (joints["j"].limits, joints["k"].limits) == ((-1.0, 1.0), None)
