import base64
import json
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tiny_robots import ARM, SRDF, joint, link, lump, robot

from problems import BadInput
from problems.robots.arm import Arm, Scene
from problems.robots.chain import chain_of
from problems.robots.loading import gather_robot
from problems.robots.meshes import decode_mesh, encode_mesh, read_mesh
from problems.robots.packing import pack, unpack
from problems.robots.srdf import pair_of, read_srdf, write_srdf
from problems.robots.urdf import read_urdf

NUMBERS = st.one_of(st.floats(width=32), st.floats())


@settings(deadline=None, max_examples=60)
@given(
    st.lists(NUMBERS, max_size=30),
    st.lists(st.integers(-(2**63), 2**63 - 1), max_size=30),
    st.lists(st.text(max_size=5), max_size=4),
    st.integers(0, 12),
)
def test_what_is_packed_comes_back_bit_for_bit(reals, integers, names, count):
    soup = np.round(np.random.default_rng(count).normal(size=(count, 9)), 1)
    parts = {"a": np.array(reals), "b": np.array(integers, np.int64), "c": tuple(names), "d": soup}
    back = unpack(pack(parts))
    assert back.keys() == parts.keys()
    assert back["c"] == parts["c"]
    for name in ("a", "b", "d"):
        assert (back[name].dtype, back[name].shape) == (parts[name].dtype, parts[name].shape)
        assert np.array_equal(back[name], parts[name], equal_nan=True)
        assert back[name].flags.writeable


def packed(head):
    """As `pack`, with any header and no arrays."""
    return base64.b64encode(zlib.compress(len(head).to_bytes(4, "little") + head)).decode()


OTHER = ["", "no text", "eJwDAAAAAAE=", pack({"a": np.ones(400)})[:-8], packed(b'[[2,"a"]]'), packed(b"[[[],[1]]]")]


@pytest.mark.parametrize("text", [*OTHER, packed(b'[["a/which","b"],["a/corners","c"]]')])
def test_other_texts_are_no_models(text):
    with pytest.raises(ValueError, match="expected"):
        Arm.from_text(text)
    with pytest.raises(ValueError, match="expected"):
        decode_mesh(text)


def test_a_robot_s_text_is_no_scene():
    with pytest.raises(ValueError, match="without"):
        Scene.from_text(pack({"joints": ("a",)}))


def test_meshes_come_back_rounded_to_single_precision():
    vertices, triangles = lump(1, rows=6)
    back, faces = decode_mesh(encode_mesh(vertices * (1 + 1e-12), triangles))
    assert np.array_equal(back, vertices.astype(np.float32))
    assert np.array_equal(faces, triangles)


def test_srdf_groups_of_chains_joints_links_and_groups():
    urdf, srdf = read_urdf(ARM), read_srdf(SRDF)
    assert srdf.joints_of("arm", urdf) == ["turn", "bend", "reach"]
    assert srdf.joints_of("first", urdf) == ["turn"]
    assert srdf.joints_of("second", urdf) == ["bend", "reach"]
    assert srdf.joints_of("all", urdf) == ["bend", "reach", "turn"]
    assert srdf.states == {"arm": {"home": {"bend": 1.5}}}
    with pytest.raises(BadInput, match=r"robot.group: expected one of arm, .*'amr'; did you mean 'arm'"):
        srdf.joints_of("amr", urdf)


def test_srdf_pairs_are_read_written_and_added():
    srdf = read_srdf(SRDF)
    assert srdf.disabled == {("base", "fore"): "Never"}
    assert srdf.is_disabled("fore", "base")
    pairs = {pair_of("upper", "base"): "Adjacent", pair_of("a<b", 'c"'): "Always"}
    assert read_srdf(write_srdf("tiny & co", pairs)).disabled == pairs
    both = read_srdf(write_srdf("tiny", pairs, SRDF))
    assert both.disabled == {**srdf.disabled, **pairs}
    assert both.groups == srdf.groups
    assert read_srdf(write_srdf("tiny", pairs, '<robot name="x"/>')).disabled == pairs


def test_srdf_links_without_default_collisions():
    srdf = read_srdf(
        '<robot name="x"><disable_default_collisions link="a"/><enable_collisions link1="b" link2="a"/></robot>'
    )
    assert (srdf.is_disabled("a", "c"), srdf.is_disabled("a", "b"), srdf.is_disabled("b", "c")) == (True, False, False)


TWO = (link("a"), link("b"))


@pytest.mark.parametrize(("text", "message"), [
    ("<robot", "expected a URDF, found no XML"),
    ("<sdf/>", "with the element <robot>, found <sdf>"),
    ('<!DOCTYPE x><robot name="x"/>', "without a document type"),
    ('<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include/></robot>', "found a xacro file; write it out"),
    (robot(*TWO), "one link that no joint carries, found 'a', 'b'; join them"),
    (robot(*TWO, joint("j", "a", "c")), "joint 'j': expected a link of the URDF, found 'c'"),
    (robot(*TWO, joint("j", "a", "b", "ball")), "joint 'j': expected a type of revolute, .*found 'ball'"),
    (robot(*TWO, joint("j", "a", "b"), joint("k", "a", "b")), "link 'b': expected one joint that carries it"),
    (robot(*TWO, joint("j", "b", "b")), "joint 'j': expected a joint below the root link 'a', found one that"),
    (robot(*TWO, link("c"), joint("j", "b", "c"), joint("k", "c", "b")), "joint 'j': .* closed chain, or below it"),
    (robot(*TWO, link("a")), "found two links 'a'"),
    (robot(*TWO, joint("j", "a", "b", axis="0 0 0")), "joint 'j': expected an axis of some length"),
    (robot(*TWO, joint("j", "a", "b", xyz="0 0")), "joint 'j': origin's xyz: expected 3 numbers, found '0 0'"),
    (robot(link("a", "<collision><geometry><box/></geometry></collision>")), "'a': expected size of the box above 0"),
    (robot(link("a", "<collision/>")), "link 'a': expected <collision> with <geometry>"),
    (robot(link("a", "<collision><geometry><cone/></geometry></collision>")), "capsule or mesh, found <cone>"),
])  # fmt: skip
def test_errors_of_urdfs_name_the_element(text, message):
    with pytest.raises(BadInput, match=message):
        read_urdf(text)


def test_a_joint_that_follows_another_has_no_value_of_its_own():
    urdf = read_urdf(ARM)
    chain_of(urdf, ["turn"], {"bend": 0.4, "finger": -0.1})  # the value that it has anyway
    for variables, fixed in [(["turn"], {"bend": 0.4, "finger": 0.0}), (["bend"], {"finger": 0.1})]:
        with pytest.raises(BadInput, match=r"robot.fixed.finger: expected no value, as this joint follows 'bend'"):
            chain_of(urdf, variables, fixed)


@pytest.mark.parametrize(("extra", "kind", "variables", "fixed", "message"), [
    ("", "revolute", ["j"], {}, "joint 'j': expected limits.*found none; state <limit.*continuous"),
    ('<limit lower="1" upper="1"/>', "revolute", ["j"], {}, "expected lower < upper.* found 1 and 1"),
    ("", "floating", [], {}, "joint 'j': expected a joint of one axis, found type floating; weld it"),
    ('<limit lower="0" upper="1"/>', "prismatic", [], {"j": 2.0}, "fixed.j: expected a value from 0 to 1, found 2"),
    ('<limit lower="0" upper="1"/>', "prismatic", [], {"k": 2.0}, r"do not move \(j\), found 'k'"),
    ('<limit lower="0" upper="1"/>', "prismatic", ["j"], {"j": 0.0}, "found 'j'; it moves here"),
    ('<limit lower="0" upper="1"/><mimic joint="x"/>', "prismatic", [], {}, "joint 'j': expected to mimic .*'x'"),
    ('<limit lower="0" upper="1"/><mimic joint="j"/>', "prismatic", [], {}, "joint 'j': expected to mimic .*a circle"),
])  # fmt: skip
def test_errors_of_joints_say_how_to_mend(extra, kind, variables, fixed, message):
    with pytest.raises(BadInput, match=message):
        chain_of(read_urdf(robot(*TWO, joint("j", "a", "b", kind, extra))), variables, fixed)


def packed(header, body=b""):
    head = json.dumps(header).encode() if isinstance(header, list) else header
    return base64.b64encode(zlib.compress(len(head).to_bytes(4, "little") + head + body)).decode()


MANY = 1 << 24


@pytest.mark.parametrize(
    "text",
    [
        packed(b"[" * 100_000),
        packed([["a", "int8", [1 << 70]]]),
        packed([["a", "int8", [-1]]]),
        packed([["a", "int8", [4 * MANY]]], bytes(4 * MANY)),  # 64 MB, and 512 MB as int64
        packed([["a/which", "int8", [MANY]], ["a/corners", "int8", [1, 3]]], bytes(MANY + 3)),  # 400 MB of corners
    ],
    ids=["deep", "large", "negative", "unfolding", "repeating"],
)
def test_a_text_that_would_unfold_without_bound_is_refused(text):
    with pytest.raises(ValueError, match="expected a packed model"):
        unpack(text)


def test_groups_that_name_others_many_times_have_each_joint_once():
    groups = "".join(
        f'<group name="{number + 1}"><group name="{number}"/><group name="{number}"/></group>' for number in range(40)
    )
    srdf = read_srdf(
        f'<robot name="x"><group name="0"><joint name="turn"/><joint name="bend"/></group>{groups}</robot>'
    )
    assert srdf.joints_of("40", read_urdf(ARM)) == ["turn", "bend"]


def test_groups_within_very_many_are_refused():
    groups = "".join(f'<group name="{number}"><group name="{number + 1}"/></group>' for number in range(5000))
    with pytest.raises(BadInput, match="at most 50 others"):
        read_srdf(f'<robot name="x">{groups}</robot>').joints_of("0", read_urdf(ARM))


@pytest.mark.parametrize("encoding", ["gb2312", "no-such-encoding"])
def test_xml_of_an_encoding_that_cannot_be_read_is_refused(encoding):
    with pytest.raises(BadInput, match="expected a URDF, found no XML"):
        read_urdf(f'<?xml version="1.0" encoding="{encoding}"?><robot name="x"/>')


def test_a_text_that_utf_8_lacks_is_refused():
    with pytest.raises(BadInput, match="found no XML"):
        read_urdf('<robot name="\ud800"/>')


@pytest.mark.parametrize("name", ["x" * 300, "\0", "\ud800"])
def test_a_name_that_no_file_can_have_is_refused(tmp_path, name):
    with pytest.raises(BadInput, match=r"robot.urdf: expected a .*file, found"):
        gather_robot({"robot": {"urdf": name}}, tmp_path)
    obstacle = {"shape": "mesh", "file": name}
    with pytest.raises(BadInput, match=r"obstacles\[0\].file: expected a mesh, found no file"):
        gather_robot({"robot": {"urdf": ARM}, "obstacles": [obstacle]}, tmp_path)


def test_a_mesh_of_points_in_a_plane_is_refused(tmp_path):
    path = tmp_path / "flat.obj"
    path.write_text("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n")
    with pytest.raises(BadInput, match="mesh: expected"):
        read_mesh(path, (1.0, 1.0, 1.0), "mesh")
