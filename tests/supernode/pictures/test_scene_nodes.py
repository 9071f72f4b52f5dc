"""Animations as nodes of a scene: names, frames, ghosts, and the playback of their steps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jointed_robots import FIELDS, WALL, problem_of

from problems.animation import WORLD, Animation, Body, Ghost
from problems.guard import animated
from problems.robots.shapes import box
from supernode.pictures.scene_nodes import COLORS, Playback, SceneNodes, pose_of, seconds_of, slider_of

PATH = {"path": [FIELDS["start"], [0.0, -1.0, 0.3], FIELDS["goal"]], "length": 3.0, "clearance": 0.0}
STILL = np.eye(3, 4).reshape(12)
TURNED = np.array([[0.0, -1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0]]).reshape(12)


def animation_of(*names, along=(0.0, 0.5, 2.0), along_name="time / s", **more):
    """A box of each name that moves with frame 1, which is turned at every step but the first."""
    bodies = tuple(Body.of_soup(name, "robot", 1, box((1.0, 1.0, 1.0))) for name in names)
    frames = np.tile(STILL, (len(along), 2, 1))
    frames[1:, 1] = TURNED
    return Animation(bodies, frames, np.array(along), along_name, **more)


def test_each_body_is_a_mesh_below_the_frame_that_it_moves_with():
    animation = animated(problem_of(), PATH)
    nodes = SceneNodes.of(animation)
    above = {node.name: node.frame for node in nodes.frames}
    assert len(nodes.meshes) == len(animation.bodies)
    for mesh, body in zip(nodes.meshes, animation.bodies, strict=True):
        assert above[mesh.name.rpartition("/")[0]] == body.frame
        assert mesh.color == COLORS[body.role]
        assert (mesh.opacity is None) == (body.role != "obstacle")
        assert mesh.vertices == pytest.approx(body.vertices, abs=1e-6)
        assert mesh.triangles.tolist() == body.triangles.tolist()
    assert f"/obstacle/{WORLD}/{WALL['id']}" in {mesh.name for mesh in nodes.meshes}


def test_ghosts_are_pale_copies_of_what_moves():
    nodes = SceneNodes.of(animated(problem_of(), PATH))
    assert [ghost.name for ghost in nodes.ghosts] == ["/ghosts/start", "/ghosts/goal"]
    moving = {mesh.name for mesh in nodes.meshes if mesh.name.startswith("/robot/") and "/0/" not in mesh.name}
    for ghost in nodes.ghosts:
        assert {mesh.name.removeprefix(ghost.name) for mesh in ghost.meshes} == {
            name.removeprefix("/robot") for name in moving
        }
        assert all(0.0 < mesh.opacity < 1.0 for mesh in ghost.meshes)
    start, goal = nodes.ghosts
    assert [nodes.shown(start, 0), nodes.shown(start, -1)] == [False, True]
    assert [nodes.shown(goal, 0), nodes.shown(goal, -1)] == [True, False]


def test_lines_lead_from_step_to_step_and_a_single_step_has_none():
    line = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0]])
    ((name, segments),) = SceneNodes.of(animation_of("a", lines=(line,))).lines
    assert name == "/lines/0"
    assert segments.tolist() == [line[:2].tolist(), line[1:].tolist()]
    assert SceneNodes.of(animation_of("a", along=(0.0,), lines=(line[:1],))).lines == ()


def test_targets_have_the_pose_that_they_ask_for():
    ((name, placement),) = SceneNodes.of(animation_of("a", targets=TURNED[None])).targets
    position, wxyz = pose_of(placement)
    assert name == "/targets/0"
    assert position.tolist() == [1.0, 2.0, 3.0]
    assert wxyz == pytest.approx(np.sqrt([0.5, 0.0, 0.0, 0.5]))


def test_bodies_of_one_name_are_two_nodes_and_a_slash_makes_no_level():
    nodes = SceneNodes.of(animation_of("a/b", "a/b", "", ghosts=(Ghost("x/y", np.array([STILL, TURNED])),)))
    assert [mesh.name for mesh in nodes.meshes] == ["/robot/1/a_b", "/robot/1/a_b 2", "/robot/1/_"]
    assert nodes.ghosts[0].name == "/ghosts/x_y"


# Playback -------------------------------------------------------------------------------------------------------------
def test_moments_are_played_as_they_are_and_other_steps_in_seconds():
    assert seconds_of(animation_of("a")).tolist() == [0.0, 0.5, 2.0]
    assert seconds_of(animation_of("a", along=(1.0, 2.0, 3.0), along_name="solution")).tolist() == [0.0, 1.0, 2.0]
    long = seconds_of(animation_of("a", along=np.linspace(0.0, 300.0, 101), along_name="path / rad"))
    assert long[-1] == 5.0
    assert seconds_of(animation_of("a", along=(7.0,), along_name="path / rad")).tolist() == [0.0]


def test_it_plays_to_the_end_pauses_there_and_begins_again():
    playback = Playback(np.array([10.0, 20.0, 30.0]), np.array([0.0, 0.5, 2.0]))
    assert not playback.advance(1.0), "it does not play yet"
    playback.toggle()
    assert not playback.advance(0.4)
    assert playback.advance(0.2)
    assert (playback.step, playback.playing) == (1, True)
    assert playback.advance(100.0)
    assert (playback.step, playback.playing) == (2, False)
    playback.toggle()
    assert (playback.step, playback.playing) == (0, True)
    playback.toggle()
    assert not playback.playing


def test_it_goes_to_the_nearest_step_and_plays_on_from_there():
    playback = Playback(np.array([10.0, 20.0, 30.0]), np.array([0.0, 0.5, 2.0]))
    playback.seek(18.0)
    assert playback.step == 1
    playback.toggle()
    assert not playback.advance(1.4)
    assert playback.advance(0.2)
    assert playback.step == 2


@pytest.mark.parametrize(
    ("along", "expected"),
    [
        (np.arange(1.0, 5.0), (1.0, 4.0, 1.0)),
        (np.linspace(0.0, 1.83, 101), (0.0, 1.83, 0.01)),
        (np.linspace(0.0, 3.306, 101), (0.0, 3.31, 0.01)),
        (np.linspace(0.0, 0.0042, 11), (0.0, 0.0042, 0.0001)),
    ],
)
def test_a_slider_has_steps_of_few_digits(along, expected):
    assert slider_of(along) == pytest.approx(expected)


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e4), st.integers(2, 300))
def test_each_step_has_a_place_on_the_slider(first, span, count):
    along = np.linspace(first, first + span, count)
    low, high, step = slider_of(along)
    slack = 1e-5 * step
    assert low - slack <= along[0]
    assert along[-1] <= high + slack
    assert 0.0 < step <= span / (count - 1) * (1.0 + 1e-6)
    assert step <= high - low + slack
