"""Solutions that move, as numbers for a browser."""

import gzip
import json

import numpy as np
import pytest
from jointed_robots import FIELDS, file_of
from live_service import ROOT

import supernode
from problems.guard import animated
from supernode.dashboard import scenes as module
from supernode.dashboard.animations import bodies_of, placements_of

PATH = {"path": [FIELDS["start"], [0.0, -1.0, 0.3], FIELDS["goal"]], "length": 3.0, "clearance": 0.0}
TOOL = {"shape": "sphere", "radius": 0.02, "link": "bar_3", "position": [0.4, 0.0, 0.0]}


@pytest.fixture(scope="module")
def file():
    return file_of(attached=[TOOL])


@pytest.fixture(scope="module")
def animation(file):
    return animated(file.problem(), PATH)


@pytest.fixture
def bodies(animation):
    return json.loads(gzip.decompress(bodies_of(animation).packed))


def view_of(best):
    return {"epoch": 0, "fitness": 3.0, "feasible": True, "solution": best}


def test_bodies_are_flat_lists_in_metres(animation, bodies):
    assert bodies["unit"] == "m"
    assert len(bodies["bodies"]) == len(animation.bodies)
    for sent, body in zip(bodies["bodies"], animation.bodies, strict=True):
        assert (sent["name"], sent["role"]) == (body.name, body.role)
        vertices, triangles = np.reshape(sent["vertices"], (-1, 3)), np.reshape(sent["triangles"], (-1, 3))
        assert vertices == pytest.approx(body.vertices, abs=1e-4)
        assert (triangles == body.triangles).all()
    assert {each["role"] for each in bodies["bodies"]} == {"robot", "attached", "obstacle"}


def test_placements_are_of_the_frames_that_bodies_have(animation, bodies):
    sent = json.loads(json.dumps(placements_of(animation, "key"), allow_nan=False))
    steps, used = len(animation.along), {body.frame for body in animation.bodies}
    frames = np.array(sent["frames"])
    assert frames.shape == (steps, len(used), 12)
    assert {each["frame"] for each in bodies["bodies"]} == set(range(len(used)))
    for each, body in zip(bodies["bodies"], animation.bodies, strict=True):
        assert frames[:, each["frame"]] == pytest.approx(animation.frames[:, body.frame], abs=1e-4)
    assert (sent["unit"], sent["bodies"], sent["along_name"]) == ("m", "key", "time / s")
    assert [ghost["name"] for ghost in sent["ghosts"]] == ["start", "goal"]
    assert np.shape([ghost["frames"] for ghost in sent["ghosts"]]) == (2, len(used), 12)
    assert np.shape(sent["lines"]) == (1, steps, 3)
    assert np.shape(sent["curves"]) == (steps, len(sent["names"])) == (steps, 3)
    assert np.shape(sent["box"]) == (2, 3)


def test_the_bodies_are_the_same_for_each_solution_and_others_for_other_obstacles(file, animation):
    key = bodies_of(animation).key
    assert bodies_of(animated(file.problem(), None)).key == key
    assert bodies_of(animated(file_of(obstacles=[]).problem(), None)).key != key


def test_a_better_solution_sends_placements_of_bodies_that_are_there(file, monkeypatch):
    module._stage.cache_clear()
    made = []
    monkeypatch.setattr(module, "bodies_of", lambda animation: made.append(1) or bodies_of(animation))
    text = file.to_json()
    for best in (None, view_of(PATH), view_of(PATH | {"path": [FIELDS["start"], FIELDS["goal"]]})):
        told = json.loads(module._draw(text, best, "spaces"))
        assert (told["spaces"], told["whole"]) == ([], True)
        assert told["animation"]["bodies"] == module._bodies(text).key
    assert made == [1]


@pytest.mark.parametrize("example", ["arm-ik", "sphere-path"])
def test_kinds_without_animation_answer_as_before(example, monkeypatch):
    text = supernode.load(ROOT / "examples" / f"{example}.toml").to_json()
    monkeypatch.setattr(module, "animated", None)  # the problem is not even asked
    assert json.loads(module._draw(text, None, "spaces")).keys() == {"spaces", "whole"}
    assert module._bodies(text) is None


def test_an_answer_of_another_form_is_refused_in_words(file):
    with pytest.raises(supernode.BadInput, match="animation"):
        module._draw(file.to_json(), view_of({"path": "none"}), "spaces")
