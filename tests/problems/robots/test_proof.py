"""The proof on exact meshes: its kinematics, its pairs, its distances, and that nothing slips between its tests."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_robots import JOINTS, LIMITS, crane, cubes, srdf

from problems.errors import BadInput
from problems.robots.proof import Proof
from problems.robots.proof_robot import Robot
from problems.robots.proof_shapes import pose

pytest.importorskip("coal", reason="an extra")

BOX = {"shape": "box", "size": [0.2, 0.2, 0.2], "position": [0.6, 0.0, 0.5]}
shares = st.lists(st.floats(0, 1), min_size=4, max_size=4)


def at(share):
    return LIMITS[:, 0] + (LIMITS[:, 1] - LIMITS[:, 0]) * np.array(share)


def turn(axis, angle):
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def frame(rotation=None, position=(0, 0, 0)):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.eye(3) if rotation is None else rotation, position
    return matrix


def by_hand(q):
    """The frame of the crane's tip."""
    return (
        frame(turn([0, 0, 1], 0.2), [0, 0, 0.1]) @ frame(turn([0, 0, 1], q[0]))
        @ frame(position=[0.02, 0, 0.4]) @ frame(position=[0, 0, q[1]])
        @ frame(turn([1, 0, 0], 0.3), [0.12, 0, 0]) @ frame(turn([0, 1, 1], q[2]))
        @ frame(position=[0.45, 0, 0]) @ frame(turn([0, 1, 0], q[3]))
        @ frame(position=[0.1, 0, 0]) @ frame(turn([0, 0, 1], 0.1 - 0.5 * q[3])) @ frame(position=[0.1, 0, 0])
    )  # fmt: skip


@given(shares)
def test_kinematics_are_those_of_the_urdf(share):
    proof = Proof.of(crane())
    np.testing.assert_allclose(proof.pose(at(share), "tip"), by_hand(at(share)), atol=1e-12)


def test_joints_limits_and_base():
    base = {"position": [1.0, 2.0, 3.0], "quaternion": [0.0, 0.0, np.sin(0.5), np.cos(0.5)]}
    proof = Proof(crane(base=base))
    assert proof.joints == tuple(JOINTS)
    np.testing.assert_allclose(proof.limits, LIMITS)
    assert proof.turning.tolist() == [True, False, True, True]
    placed = pose(base["position"], base["quaternion"])
    np.testing.assert_allclose(proof.pose(np.zeros(4), "tip"), placed @ by_hand(np.zeros(4)), atol=1e-12)
    np.testing.assert_allclose(proof.pose(np.zeros(4), "base"), placed, atol=1e-12)
    texts = list(proof.beyond_limits([0.0, 0.5, -2.5, 0.0]))
    assert texts == [
        "joint lift is at 0.5, outside its limits [-0.1, 0.3]",
        "joint bend is at -2.5, outside its limits [-2, 2.2]",
    ]


def test_a_joint_that_is_fixed_stands_where_the_file_says():
    some = Proof(crane(joints=["turn", "bend"], fixed={"lift": 0.2, "curl": 0.7}))
    np.testing.assert_allclose(some.pose([0.3, 0.4], "tip"), by_hand([0.3, 0.2, 0.4, 0.7]), atol=1e-12)


def test_a_group_of_the_srdf_names_the_joints():
    group = '<robot name="crane"><group name="arm"><chain base_link="slide" tip_link="tip"/></group></robot>'
    assert Proof(crane(srdf=group, group="arm")).joints == ("bend", "curl")
    with pytest.raises(BadInput, match="expected a group of the SRDF, found 'leg'"):
        Proof(crane(srdf=group, group="leg"))


@given(shares, shares)
def test_no_point_moves_farther_than_the_bound(share, other):
    robot = Robot(crane())
    begin, end = at(share), at(other)
    for shape, link in zip(robot.shapes, robot.link_of, strict=True):
        joint, placement = robot.attachment(link)
        placement = placement @ shape.placement
        corners = shape.corners @ placement[:3, :3].T + placement[:3, 3]
        reach = robot.reach(joint, corners, shape.rounding)
        most = 0.0
        for mover, bound in reach.items():
            variable, multiplier = robot.variable(mover)
            most += bound * multiplier * abs(end - begin)[variable]
        frames = [robot.pose(each, link) @ np.linalg.inv(robot.attachment(link)[1]) for each in (begin, end)]
        moved = [corners @ matrix[:3, :3].T + matrix[:3, 3] for matrix in frames]
        assert np.linalg.norm(moved[1] - moved[0], axis=1).max() <= most + 1e-9


def test_pairs_that_never_or_always_touch_are_not_tested():
    """Of the links of one body, of one joint, or those that the SRDF exempts."""

    def tested(proof):
        pairs = proof._pairs
        return {frozenset(pairs.names(number)) for number in range(len(pairs._pairs))}

    links = tested(Proof(crane()))
    assert frozenset(("base", "boom")) in links
    assert frozenset(("boom", "finger")) in links
    assert links & {frozenset(("base", "tower")), frozenset(("boom", "hand")), frozenset(("hand", "finger"))} == set()
    assert tested(Proof(crane(srdf=srdf(("base", "boom"))))) == links - {frozenset(("base", "boom"))}
    assert tested(Proof(crane(), self_collision=False)) == set()
    with_box = tested(Proof(crane(), [BOX | {"id": "box"}]))
    assert {name for pair in with_box - links for name in pair} == {"box", "tower", "slide", "boom", "hand", "finger"}
    welded = tested(Proof(crane(joints=["curl"])))
    assert welded == {frozenset(("base", "hand")), frozenset(("tower", "hand")), frozenset(("slide", "hand"))} | {
        frozenset((link, "finger")) for link in ("base", "tower", "slide", "boom")
    }


def test_attached_things_move_with_their_link_and_may_touch_what_is_allowed():
    stick = {"id": "stick", "link": "finger", "shape": "box", "size": [0.4, 0.01, 0.01], "position": [0.2, 0, 0]}
    q = [0.0, 0.0, 0.0, 0.0]
    place = (by_hand(q) @ [0.2, 0, 0, 1])[:3].tolist()  # in the stick, beyond the finger
    ball = {"id": "ball", "shape": "sphere", "radius": 0.01, "position": place}
    assert Proof(crane(), [ball]).contacts(q) == []
    (contact,) = Proof(crane(), [ball], [stick]).contacts(q)
    assert {contact.one, contact.other} == {"stick", "ball"}
    back = stick | {"position": [-0.2, 0, 0]}
    touched = {name for each in Proof(crane(), [], [back]).contacts(q) for name in (each.one, each.other)}
    assert touched == {"stick", "hand", "boom"}
    free = back | {"may_touch": ["hand", "boom"]}
    assert Proof(crane(), [], [free]).contacts(q) == []


def test_a_contact_says_who_and_how_deep():
    ball = {"id": "ball", "shape": "sphere", "radius": 0.05, "position": (by_hand(np.zeros(4)) @ [0, 0, 0.05, 1])[:3]}
    proof = Proof(crane(), [ball | {"position": ball["position"].tolist()}])
    (contact,) = proof.contacts(np.zeros(4))
    assert {contact.one, contact.other} == {"finger", "ball"}
    assert contact.depth == pytest.approx(0.01, abs=1e-4)
    assert contact.in_words() == f"{contact.one} touches {contact.other}, 10 mm deep"
    assert proof.gap(np.zeros(4)) == (0.0, (contact.one, contact.other))
    away = Proof(crane(), [ball | {"radius": 0.03, "position": ball["position"].tolist()}])
    gap, names = away.gap(np.zeros(4))
    assert (gap, set(names)) == (pytest.approx(0.01, abs=1e-4), {"finger", "ball"})
    (near,) = away.contacts(np.zeros(4), clearance=0.02)
    assert near.depth == 0.0
    assert near.in_words(0.02).endswith("less than the clearance 0.02 m")


def test_what_is_wholly_inside_a_mesh_touches_it():
    """The mesh is not convex, and coal knows of it only the surface."""
    mesh = cubes(((0.0, 0.0, 0.0), 0.4), ((1.5, 0.0, 0.0), 0.1))
    meshes = {"house": mesh, "package://crane/hand.stl": cubes(((0, 0, 0), 0.03))}
    place = (by_hand(np.zeros(4)) @ [0.35, 0, 0, 1])[:3].tolist()
    house = {"id": "house", "shape": "mesh", "file": "house", "position": place}
    inside = {frozenset((each.one, each.other)) for each in Proof(crane(meshes=meshes), [house]).contacts(np.zeros(4))}
    assert frozenset(("finger", "house")) in inside
    beside = house | {"position": [place[0] - 0.75, place[1], place[2] + 0.5]}
    assert Proof(crane(meshes=meshes), [beside]).gap(np.zeros(4))[0] > 0.0


def test_nothing_to_touch():
    proof = Proof(crane(), self_collision=False)
    assert proof.gap(np.zeros(4)) == (np.inf, None)
    found = proof.of_path([np.zeros(4), at([1, 1, 1, 1])])
    assert (found.least, found.where, found.objections) == (np.inf, {}, ())


obstacles = st.lists(
    st.tuples(
        st.sampled_from(["box", "cylinder", "sphere", "mesh"]), st.floats(-1, 1), st.floats(-1, 1), st.floats(0, 1)
    ),
    min_size=1,
    max_size=4,
)


@settings(max_examples=15, deadline=None)
@given(obstacles, shares, shares, shares, st.sampled_from([0.0, 0.03]))
def test_a_path_is_judged_as_all_of_its_points_are(solids, one, two, three, clearance):
    sizes = {"size": [0.1, 0.3, 0.05], "radius": 0.08, "length": 0.3, "file": "two"}
    own = {"box": ["size"], "cylinder": ["radius", "length"], "sphere": ["radius"], "mesh": ["file"]}
    tables = [
        {"shape": shape, "position": place, "quaternion": [0.2, 0.4, 0.1, 0.9]}
        | {name: sizes[name] for name in own[shape]}
        for shape, *place in solids
    ]
    meshes = crane()["meshes"] | {"two": cubes(((0, 0, 0), 0.05), ((0.2, 0, 0), 0.05))}
    proof = Proof.of(crane(meshes=meshes), tables)
    path = np.array([at(one), at(two), at(three)])
    path[1:] = path[0] + 0.2 * (path[1:] - path[0])
    found = proof.of_path(path, clearance)
    dense = [a + share * (b - a) for a, b in pairwise(path) for share in np.linspace(0, 1, 100)]
    gaps = [proof.gap(each)[0] for each in dense]
    assert bool(found.objections) >= (min(gaps) <= 0.0 or min(gaps) < clearance)
    assert found.least <= min(gaps) + max(1e-3, 0.02 * found.least) + 1e-5 or found.objections
    if found.where:
        assert proof.gap(found.where["configuration"])[0] == pytest.approx(found.least, abs=1e-5)
    assert found.length == pytest.approx(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def test_objections_name_the_place():
    ball = {"id": "ball", "shape": "sphere", "radius": 0.05, "position": by_hand(np.zeros(4))[:3, 3].tolist()}
    proof = Proof(crane(), [ball])
    away = [1.0, 0.0, 0.0, 0.0]
    assert "at the start: " in proof.of_path([np.zeros(4), away]).objections[0]
    assert "at the goal: " in proof.of_path([away, np.zeros(4)]).objections[0]
    assert "at point 2: " in proof.of_path([away, np.zeros(4), away]).objections[0]
    assert "on segment 1, after " in proof.of_path([[-1.0, 0, 0, 0], away]).objections[0]
    assert "less than the clearance 0.2 m" in proof.of_path([away, [1.1, 0, 0, 0]], 0.9).objections[0].replace(
        "0.9 m", "0.2 m"
    )
    assert proof.of_path([away, [7.0, 0, 0, 0]]).objections[0] == (
        "point 2: joint turn is at 7, outside its limits [-6.28319, 6.28319]"
    )


def test_of_a_path_that_leaves_the_limits_by_far_no_segment_is_tested():
    ball = {"id": "ball", "shape": "sphere", "radius": 0.05, "position": [0.0, 0.0, 5.0]}
    found = Proof(crane(), [ball]).of_path([np.zeros(4), [1e12, 0.0, 0.0, 0.0]])
    assert "outside its limits" in found.objections[0]
    assert found.tests == 2


def test_a_thin_wall_is_not_jumped_over():
    """At both ends and in the middle the arm is far away from it."""
    place = (by_hand(np.zeros(4)) @ [-0.05, 0, 0, 1])[:3].tolist()
    wall = {"shape": "box", "size": [0.05, 1e-4, 0.05], "position": place}
    proof = Proof(crane(), [wall])
    path = [[-1.5, 0, 0, 0], [1.1, 0, 0, 0]]
    assert all(not proof.contacts(each) for each in (*path, np.mean(path, axis=0)))
    assert proof.of_path(path).objections


def test_a_robot_is_made_once():
    one, other = Proof.of(crane(), [BOX]), Proof.of(crane(), [])
    assert one.robot is other.robot
    assert Proof.of(crane(), [dict(BOX)]) is one


@pytest.mark.parametrize(
    ("fields", "obstacle", "message"),
    [
        ({"urdf": "<robot"}, None, r"robot.urdf: expected XML"),
        ({"joints": ["weld"]}, None, r"robot.joints: expected joints that move, found 'weld'"),
        ({"meshes": {}}, None, r"robot.meshes: expected the mesh 'package://crane/hand.stl'"),
        ({}, {"shape": "mesh", "file": "no"}, r"expected the mesh 'no'"),
        ({}, {"shape": "cone"}, r"obstacles\[0\]: expected a box, cylinder, sphere or mesh, found cone"),
    ],
)
def test_what_does_not_fit_is_said_in_one_line(fields, obstacle, message):
    with pytest.raises(BadInput, match=message):
        Proof(crane(**fields), [obstacle] if obstacle else [])
    with pytest.raises(BadInput, match=r"link: expected one of .*tip.*, found 'nose'"):
        Proof.of(crane()).pose(np.zeros(4), "nose")
