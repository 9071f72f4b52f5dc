import json

import pytest
from tiny_robots import ARM, SRDF, joint, limit, link, robot

from problems.robots.loading import robots_of_extra
from supernode.__main__ import main

extra = pytest.mark.skipif(not robots_of_extra(), reason="needs example-robot-data")


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    return path


@extra
def test_robots_are_listed_and_shown(capsys):
    assert main(["robots"]) == 0
    assert "panda_description/urdf/panda.urdf" in capsys.readouterr().out
    assert main(["robots", "panda"]) == 0
    shown = capsys.readouterr().out
    for part in (
        "panda_joint4",
        "-3.0718",
        "follows panda_finger_joint1",
        "mesh link1.stl, 300 triangles",
        "arm_and_hand",
    ):
        assert part in shown


def test_a_robot_is_shown_as_json(arm, tmp_path, capsys):
    (tmp_path / "arm.srdf").write_text(SRDF)
    assert main(["robots", str(arm), "--semantics", str(tmp_path / "arm.srdf"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert [each["name"] for each in facts["joints"]] == ["turn", "bend", "reach", "finger"]
    assert facts["groups"]["arm"] == ["turn", "bend", "reach"]
    assert facts["links"]["base"] == ["box 0.05 × 0.04 × 0.2 m"]


def test_an_input_is_never_overwritten(arm, capsys):
    assert main(["robots", str(arm), "--srdf", str(arm)]) == 2
    assert "--srdf: expected a file to write, found " in capsys.readouterr().err
    assert arm.read_text() == ARM


def test_a_check_writes_no_files(arm, tmp_path, capsys):
    assert main(["robots", str(arm), "--check", "--spheres", str(tmp_path / "a.png")]) == 2
    assert "--check: expected no --spheres beside it, found both" in capsys.readouterr().err


def test_spheres_need_collision_geometry_and_a_picture(tmp_path, arm, capsys):
    (tmp_path / "bare.urdf").write_text(robot(link("a", "<visual/>"), link("b", "<visual/>"), joint("j", "a", "b")))
    assert main(["robots", str(tmp_path / "bare.urdf"), "--spheres", str(tmp_path / "a.png")]) == 2
    assert "--spheres: expected links with <collision> in the URDF, found none" in capsys.readouterr().err
    assert main(["robots", str(arm), "--spheres", str(tmp_path / "a.gif")]) == 2
    assert "--spheres: expected a name that ends in .png" in capsys.readouterr().err


def test_a_good_robot_passes_the_check(arm, capsys):
    assert main(["robots", "--check", str(arm)]) == 0
    said = capsys.readouterr().out
    assert "note: joint 'finger': follows 'bend': -0.5 times its value plus 0.1" in said
    assert said.rstrip().endswith("nothing is wrong")


MESH = '<collision><geometry><mesh filename="package://a/b.stl"/></geometry></collision>'


@pytest.mark.parametrize(("text", "said"), [
    (robot(link("a", MESH)), "wrong: link 'a': expected the mesh package://a/b.stl, found no file"),
    (robot(link("a"), link("b"), joint("j", "a", "b", "planar")), "joint 'j': type planar cannot move here; weld"),
    (robot(link("a"), link("b"), joint("j", "a", "b", extra="")), "wrong: joint 'j': has no limits; state <limit"),
    (robot(link("a"), link("b"), joint("j", "a", "b", extra=limit(2, 1))), "leave no room; mend them"),
    (robot(link("a"), link("b"), joint("j", "a", "b", extra='<mimic joint="x"/>')), "mimics 'x', which is no joint"),
    (robot(link("a", "<visual/>")), "note: 1 links are drawn but have no <collision>"),
    ("<robot", "found no XML"),
])  # fmt: skip
def test_the_check_says_what_is_wrong_and_how_to_mend_it(text, said, tmp_path, capsys):
    path = tmp_path / "r.urdf"
    path.write_text(text)
    assert main(["robots", "--check", str(path)]) == 1
    out = capsys.readouterr().out
    assert said in out
    assert "to mend" in out


def test_the_check_finds_links_that_always_collide(tmp_path, capsys):
    fat = '<collision><geometry><sphere radius="0.4"/></geometry></collision>'
    joints = (joint("one", "base", "a", axis="0 0 1"), joint("two", "a", "b", axis="0 0 1"))
    path, srdf = tmp_path / "r.urdf", tmp_path / "r.srdf"
    path.write_text(robot(link("base", fat), link("a"), link("b", fat), *joints))
    srdf.write_text('<robot name="r"><disable_collisions link1="a" link2="b" reason="Adjacent"/></robot>')
    assert main(["robots", "--check", str(path)]) == 0
    assert "note: 1 pairs of links collide in every configuration, such as 'base' and 'b'" in capsys.readouterr().out
    assert main(["robots", "--check", str(path), "--semantics", str(srdf)]) == 1
    assert "wrong: links 'base' and 'b' collide in every configuration; say <disable" in capsys.readouterr().out
    assert main(["robots", str(path), "--srdf", str(tmp_path / "new.srdf")]) == 0
    assert 'link1="b" link2="base" reason="Always"' in (tmp_path / "new.srdf").read_text()
    assert main(["robots", "--check", str(path), "--semantics", str(tmp_path / "new.srdf")]) == 0


def test_spheres_are_drawn(arm, tmp_path, capsys):
    picture = tmp_path / "arm.png"
    assert main(["robots", str(arm), "--spheres", str(picture)]) == 0
    assert picture.stat().st_size > 10_000
    assert "6 links" in capsys.readouterr().out


@pytest.mark.parametrize(("arguments", "message"), [
    (["nosuch.urdf"], "expected a file, found no file nosuch.urdf"),
    (["--check"], "expected a URDF file or a robot"),
    (["nosuch", "--check"], "expected a robot of example-robot-data"),
])  # fmt: skip
def test_errors_of_the_command(arguments, message, capsys):
    assert main(["robots", *arguments]) in (1, 2)
    captured = capsys.readouterr()
    assert message in captured.err + captured.out
