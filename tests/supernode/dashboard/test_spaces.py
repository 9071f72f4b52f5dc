"""What is drawn in three dimensions, as numbers for a browser."""

import json

from live_service import ROOT
from matplotlib.figure import Figure

import supernode
from supernode.dashboard import spaces as module
from supernode.dashboard.spaces import spaces_of
from supernode.pictures.picture import drawn

SOLVED = {"length": 17.5, "crossed": 0, "path": [[0.5, 0.5, 0.5], [2.0, 9.0, 9.0], [9.5, 9.5, 9.5]]}


def problem(name):
    return supernode.load(ROOT / "examples" / f"{name}.toml").problem()


def of_type(space, kind, mode=""):
    return [trace for trace in space["traces"] if trace["type"] == kind and mode in trace.get("mode", "")]


def test_a_path_among_spheres():
    found = spaces_of(drawn(problem("sphere-path"), SOLVED))
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert found["whole"] is True
    (space,) = found["spaces"]
    assert space["title"] == "length 17.5, crosses no spheres"
    ends = {(*line["x"], *line["y"], *line["z"]) for line in of_type(space, "scatter3d", "lines")}
    assert ends == {(0.5, 2.0, 0.5, 9.0, 0.5, 9.0), (2.0, 9.5, 9.0, 9.5, 9.0, 9.5)}
    assert [trace["text"] for trace in of_type(space, "scatter3d", "text")] == [["start"], ["goal"]]
    (body,) = of_type(space, "mesh3d")
    assert max(*body["i"], *body["j"], *body["k"]) == len(body["x"]) - 1
    assert len(body["i"]) == len(body["facecolor"]) > 1000
    assert space["scene"]["xaxis"]["range"] == [0.0, 10.0]


def test_arms_beside_a_diagram_are_a_part_of_their_picture():
    found = spaces_of(drawn(problem("coordination-arms"), None))
    assert found["whole"] is False
    assert [space["title"] for space in found["spaces"]] == ["start", "end"]
    for space in found["spaces"]:
        assert [trace["name"] for trace in space["traces"] if trace["showlegend"]] == ["robot 1", "robot 2"]


def test_a_flat_picture_has_none():
    assert spaces_of(drawn(problem("arm-ik"), None)) == {"spaces": [], "whole": False}


def test_what_has_no_counterpart_stays_a_picture():
    axes = Figure().add_subplot(projection="3d")
    axes.bar3d([0.0], [0.0], [0.0], [1.0], [1.0], [1.0])
    assert len(spaces_of(axes.figure)["spaces"]) == 1
    axes.scatter([0.5], [0.5], [0.5])
    assert spaces_of(axes.figure) == {"spaces": [], "whole": False}


def test_what_is_too_much_for_a_browser_stays_a_picture(monkeypatch):
    monkeypatch.setattr(module, "_MOST_TRIANGLES", 1000)
    assert spaces_of(drawn(problem("sphere-path"), None)) == {"spaces": [], "whole": False}
