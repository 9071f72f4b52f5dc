import time
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError
from tiny_robots import ARM, SRDF, joint, link, lump, on_surface, robot, stl

from problems import BadInput
from problems.robots.arm import SCENE_ARRAYS, Arm, Scene
from problems.robots.chain import chain_of, frames_of
from problems.robots.fields import Attached, Obstacle, Robot
from problems.robots.loading import gather_description, gather_robot, robots_of_extra
from problems.robots.making import link_pieces, make_arm, make_scene, make_srdf, read_parts
from problems.robots.srdf import read_srdf
from problems.robots.urdf import read_urdf

HAS_EXTRA = bool(robots_of_extra())
UNSEEN = ["kinova", "xarm7", "talos_left_arm", "solo", "tiago"]
extra = pytest.mark.skipif(not HAS_EXTRA, reason="needs example-robot-data")
SCENE = {
    "obstacles": [
        {"shape": "box", "size": [1.0, 0.5, 0.1], "position": [0.0, 0.0, -0.5], "quaternion": [0.0, 0.0, 0.6, 0.8]},
        {"shape": "cylinder", "radius": 0.1, "length": 0.5, "id": "post"},
        {"shape": "sphere", "radius": 0.2, "position": [1.0, 1.0, 1.0]},
        {"shape": "mesh", "file": "lump.stl", "position": [0.0, 2.0, 0.0]},
    ],
    "attached": [{"shape": "box", "size": [0.1, 0.1, 0.3], "link": "tool", "may_touch": ["fore"], "id": "held"}],
}


def scene_of(folder, **own):
    stl(folder / "lump.stl", *lump(2, rows=8))
    (folder / "arm.urdf").write_text(ARM)
    (folder / "arm.srdf").write_text(SRDF)
    robot_ = {"urdf": "arm.urdf", "srdf": "arm.srdf", "group": "arm", **own}
    fields = gather_robot({"robot": robot_, **SCENE}, folder)
    obstacles = TypeAdapter(list[Obstacle]).validate_python(fields["obstacles"])
    attached = TypeAdapter(list[Attached]).validate_python(fields["attached"])
    return make_scene(Robot.model_validate(fields["robot"]), obstacles, attached, 0.01)


def description(name):
    return Robot.model_validate(gather_description({"urdf": f"example-robot-data:{name}"}, Path()))


def test_a_scene_has_pieces_pairs_and_solids(tmp_path):
    scene = scene_of(tmp_path)
    arm = scene.arm
    assert arm.joints == ("turn", "bend", "reach")
    assert arm.bodies == ("world", "turn", "bend", "reach", "finger")
    assert arm.parents.tolist() == [-1, 0, 1, 2, 3]
    assert arm.variables.tolist() == [-1, 0, 1, 2, 1]
    assert arm.scales[4].tolist() == [-0.5, 0.1]
    assert arm.pieces == ("base", "upper", "fore", "slide", "tool", "follower", "held", "obstacles[3]")
    assert arm.piece_body.tolist() == [0, 1, 2, 3, 3, 4, 3, 0]
    named = {tuple(sorted((arm.pieces[i], arm.pieces[j]))) for i, j in arm.pairs}
    assert ("base", "fore") not in named  # the SRDF disables it
    assert ("base", "upper") not in named  # across one joint
    assert ("fore", "held") not in named  # it may touch
    assert ("held", "tool") not in named  # on one body
    assert named >= {("base", "held"), ("held", "obstacles[3]"), ("fore", "obstacles[3]"), ("base", "tool")}
    assert ("base", "obstacles[3]") not in named  # both stand still
    assert scene.names == ("obstacles[0]", "post", "obstacles[2]")
    assert scene.solids[:, 0].tolist() == [0, 1, 2]
    assert scene.solids[:, 13:].tolist() == [[0.5, 0.25, 0.05], [0.1, 0.1, 0.25], [0.2, 0.2, 0.2]]
    # From the world into the box: its own x axis becomes (1, 0, 0).
    turn = scene.solids[0, 1:10].reshape(3, 3)
    assert turn @ [0.28, 0.96, 0.0] == pytest.approx([1.0, 0.0, 0.0])


def test_a_scene_s_text_round_trips_bit_for_bit(tmp_path):
    scene = scene_of(tmp_path)
    back = Scene.from_text(scene.to_text())
    assert len(scene.arrays()) == len(SCENE_ARRAYS)
    for name, one, other in zip(SCENE_ARRAYS, scene.arrays(), back.arrays(), strict=True):
        assert one.dtype == other.dtype, name
        assert np.array_equal(one, other, equal_nan=True), name
    assert (back.names, back.arm.links, back.arm.pieces) == (scene.names, scene.arm.links, scene.arm.pieces)
    arm = Arm.from_text(scene.arm.to_text())
    assert np.array_equal(arm.velocity, scene.arm.velocity, equal_nan=True)
    assert scene_of(tmp_path).to_text() == scene.to_text()


def test_no_point_moves_farther_than_reach_says(tmp_path):
    arm = scene_of(tmp_path).arm
    low, high = arm.limits.T
    random = np.random.default_rng(0)
    configurations = low + (high - low) * random.random((300, len(low)))
    points = [arm.triangles[:, :3]] * len(arm.parents)
    for piece, body in enumerate(arm.piece_body):
        last = arm.piece_root[piece + 1] if piece + 1 < len(arm.piece_root) else len(arm.spheres)
        own = arm.children[arm.piece_root[piece] : last]
        points[body] = np.concatenate([arm.triangles[-a - 1 : -a - 1 + n].reshape(-1, 3) for a, n in own if a < 0])
        for variable in range(len(low)):
            step = np.zeros(len(low))
            step[variable] = 1e-5
            before, after = (
                frames_of(arm, each)[:, body].reshape(-1, 3, 4) for each in (configurations, configurations + step)
            )
            moved = (
                np.einsum("nij,pj->npi", after[..., :3] - before[..., :3], points[body])
                + (after - before)[:, None, :, 3]
            )
            most = np.linalg.norm(moved, axis=2).max() / 1e-5
            assert most <= arm.reach[body, variable] * (1 + 1e-6) + 1e-9
            assert most >= 0.5 * arm.reach[body, variable] - 1e-6  # and it is no wild guess


def pinocchio_frames(text, joints, fixed, configurations, links):
    """Return the links' placements by pinocchio, with mimic joints set by hand, (N, K, 3, 4)."""
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromXML(text)
    data, urdf = model.createData(), read_urdf(text)
    answer = np.empty((len(configurations), len(links), 3, 4))
    for row, configuration in enumerate(configurations):
        values = {name: fixed.get(name, 0.0) for name in urdf.joints} | dict(zip(joints, configuration, strict=True))
        for own in urdf.joints.values():
            if own.limits and own.kind != "continuous" and own.name not in joints and own.name not in fixed:
                values[own.name] = float(np.clip(0.0, *own.limits))
        for own in urdf.joints.values():
            if own.mimic:
                values[own.name] = own.mimic[1] * values[own.mimic[0]] + own.mimic[2]
        q = pinocchio.neutral(model)
        for number in range(1, model.njoints):
            value, place = values[model.names[number]], model.joints[number].idx_q
            q[place : place + model.joints[number].nq] = (
                [value] if model.joints[number].nq == 1 else [np.cos(value), np.sin(value)]
            )
        pinocchio.framesForwardKinematics(model, data, q)
        for column, link_ in enumerate(links):
            pose = data.oMf[model.getFrameId(link_, pinocchio.FrameType.BODY)]
            answer[row, column] = np.concatenate([pose.rotation, pose.translation[:, None]], axis=1)
    return answer


def own_frames(chain, configurations):
    frames = frames_of(chain, configurations)[:, chain.link_body].reshape(len(configurations), -1, 3, 4)
    links = chain.link_placements.reshape(-1, 3, 4)
    turn = np.einsum("nkij,kjl->nkil", frames[..., :3], links[..., :3])
    place = np.einsum("nkij,kj->nki", frames[..., :3], links[..., 3]) + frames[..., 3]
    return np.concatenate([turn, place[..., None]], axis=3)


def test_kinematics_of_mimic_and_welded_joints_equal_pinocchio_s():
    for variables, fixed in [(["turn", "bend", "reach"], {}), (["reach", "turn"], {"bend": -1.3}), (["bend"], {})]:
        chain = chain_of(read_urdf(ARM), variables, fixed)
        configurations = chain.random(20, 1)
        theirs = pinocchio_frames(ARM, variables, fixed, configurations, chain.links)
        assert own_frames(chain, configurations) == pytest.approx(theirs, abs=1e-12)


@extra
@pytest.mark.parametrize("name", [*UNSEEN, "panda", "pr2"])
def test_kinematics_of_robots_equal_pinocchio_s(name):
    text = robots_of_extra()[name].read_text()
    urdf = read_urdf(text)
    chain = chain_of(urdf, urdf.movable, {})
    configurations = chain.random(3, 1)
    theirs = pinocchio_frames(text, chain.joints, {}, configurations, chain.links)
    assert own_frames(chain, configurations) == pytest.approx(theirs, abs=1e-9)


@extra
@pytest.mark.parametrize("name", UNSEEN)
def test_robots_never_seen_get_their_trees(name):
    robot_ = description(name)
    started = time.perf_counter()
    robot_ = robot_.model_copy(update={"srdf": make_srdf(robot_)})
    arm = make_arm(robot_)
    seconds, size = time.perf_counter() - started, len(arm.to_text()) // 1000
    print(f"{name}: {seconds:.2f} s, {len(arm.spheres)} spheres, {size} kB")  # noqa: T201
    assert read_srdf(robot_.srdf).says_pairs
    pieces = link_pieces(robot_, read_parts(robot_))
    assert tuple(piece.name for piece in pieces) == arm.pieces
    for number, piece in enumerate(pieces):
        root = arm.spheres[arm.piece_root[number]]
        points = on_surface(piece.soup, 500)
        assert (np.linalg.norm(points - root[:3], axis=1) <= root[3] + 1e-9).all()
    assert (arm.reach[arm.piece_body] >= 0).all()
    assert np.isfinite(arm.reach).all()


def test_pairs_are_found_by_sampling_where_no_srdf_has_them():
    robot_ = Robot(urdf=ARM)
    disabled = read_srdf(make_srdf(robot_)).disabled
    assert disabled["base", "upper"] == "Adjacent"
    assert ("base", "slide") not in disabled  # a bent arm reaches its base
    assert Robot(urdf=ARM, srdf=SRDF).srdf == make_srdf(Robot(urdf=ARM, srdf=SRDF))  # the SRDF's own pairs stay


def test_links_that_always_or_never_touch_are_found():
    fat = '<collision><geometry><sphere radius="0.4"/></geometry></collision>'
    text = robot(
        link("base", fat), link("a"), link("b", fat), link("c"),
        joint("one", "base", "a", axis="0 0 1"), joint("two", "a", "b", axis="0 0 1"),
        joint("three", "b", "c", axis="0 0 1", xyz="0 0 3"),
    )  # fmt: skip
    disabled = read_srdf(make_srdf(Robot(urdf=text))).disabled
    assert disabled["b", "base"] == "Always"
    assert disabled["base", "c"] == "Never"


@pytest.mark.parametrize(("own", "message"), [
    ({"joints": ["turn", "bent"]}, "robot.joints: expected a joint of the URDF, found 'bent'; did you mean 'bend'"),
    ({"joints": ["mount"]}, "robot.joints: expected joints that move, found 'mount' of type fixed"),
    ({"joints": ["finger"]}, "found 'finger', which follows 'bend'; leave it out"),
    ({"group": "legs", "srdf": SRDF}, "robot.group: expected one of arm, first, second, all of the SRDF, found 'legs'"),
])  # fmt: skip
def test_errors_of_chosen_joints(own, message):
    with pytest.raises(BadInput, match=message):
        make_arm(Robot(urdf=ARM, **own))


@pytest.mark.parametrize(("own", "message"), [
    ({"joints": ["turn", "turn"]}, "found 'turn' more than once"),
    ({"joints": ["turn"], "group": "arm", "srdf": SRDF}, "expected either group or joints, found both"),
    ({"group": "arm"}, "expected an srdf that says what 'arm' is, found none"),
    ({"base": {"quaternion": [0.0, 0.0, 1.0, 1.0]}}, "expected a unit quaternion .*of length 1.414"),
])  # fmt: skip
def test_errors_of_fields(own, message):
    with pytest.raises(ValidationError, match=message):
        Robot(urdf=ARM, **own)


def test_an_attached_thing_needs_a_link_of_the_robot():
    thing = TypeAdapter(Attached).validate_python({"shape": "sphere", "radius": 0.1, "link": "tol"})
    with pytest.raises(
        BadInput, match=r"attached\[0\].link: expected a link of the URDF, found 'tol'; did you mean 'tool'"
    ):
        make_scene(Robot(urdf=ARM), attached=[thing])


def test_an_attached_thing_may_touch_what_there_is_only():
    thing = {"shape": "sphere", "radius": 0.1, "link": "tool", "may_touch": ["fore", "bse"]}
    message = r"attached\[0\].may_touch: expected links of the URDF or mesh obstacles, found 'bse'; did you mean 'base'"
    with pytest.raises(BadInput, match=message):
        make_scene(Robot(urdf=ARM), attached=[TypeAdapter(Attached).validate_python(thing)])


def test_the_base_moves_the_robot(tmp_path):
    base = {"position": [1.0, 2.0, 3.0], "quaternion": [0.0, 0.0, 1.0, 0.0]}
    there, here = scene_of(tmp_path, base=base).arm, scene_of(tmp_path).arm
    q = np.array([[0.3, 0.5, 0.1]])
    one, other = (frames_of(arm, q)[0, -1].reshape(3, 4) for arm in (here, there))
    assert other[:, 3] == pytest.approx([1.0 - one[0, 3], 2.0 - one[1, 3], 3.0 + one[2, 3]])
