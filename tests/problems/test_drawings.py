"""What pictures show of bodies: as thick as they are, and labels that do not lie over each other."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from problems import load
from problems.arm_path import drawing as arm_path
from problems.outlines import capsule

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_a_capsule_is_all_that_is_near_its_segment() -> None:
    start, end = np.array([1.0, 2.0]), np.array([4.0, 6.0])
    outline = capsule(start, end, 0.5)
    along = (end - start) / 5.0
    places = np.clip((outline - start) @ along, 0.0, 5.0)
    assert np.linalg.norm(outline - start - places[:, None] * along, axis=1) == pytest.approx(0.5)


def test_the_links_that_arm_path_sweeps_are_as_thick_as_they_are() -> None:
    problem = load(EXAMPLES / "arm-path.toml").problem()
    axes = Figure().subplots()
    arm_path._draw_world(problem, axes, np.array([problem.start, problem.goal]))
    swept, start, goal = (each for each in axes.collections if isinstance(each, PolyCollection))
    assert len(start.get_paths()) == len(goal.get_paths()) == len(problem.arm.links)
    assert len(swept.get_paths()) > 10 * len(problem.arm.links)
    for path in swept.get_paths():
        corners = path.vertices[:38]
        assert np.linalg.norm(corners[9] - corners[28]) > problem.arm.radius, "the ends of its caps"
        assert np.linalg.norm(corners[0] - corners[18]) == pytest.approx(2 * problem.arm.radius)


def test_the_labels_of_coordination_s_axes_do_not_overlap() -> None:
    pytest.importorskip("fcl")
    problem = load(EXAMPLES / "coordination-arms.toml").problem()
    figure = Figure()
    canvas = FigureCanvasAgg(figure)
    problem.draw(figure, None, {})
    canvas.draw()
    renderer = canvas.get_renderer()
    spaces = [axes for axes in figure.axes if axes.name == "3d"]
    assert spaces
    for axes in spaces:
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            low, high = sorted(axis.get_view_interval())
            shown = [
                label
                for tick, label in zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=False)
                if low <= tick <= high and label.get_text()
            ]
            boxes = [label.get_window_extent(renderer) for label in shown]
            assert not any(one.overlaps(other) for one, other in pairwise(boxes))


def test_the_ball_of_sphere_path_is_drawn_along_its_path(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    (tmp_path / "corner.obj").write_text("v 5 5 5\nv 6 5 5\nv 5 6 5\nv 5 5 6\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    (tmp_path / "ball.toml").write_text(
        'kind = "sphere-path"\nstart = [1.0, 1.0, 1.0]\ngoal = [2.0, 1.0, 1.0]\n'
        "bounds = [[0.0, 3.0], [0.0, 2.0], [0.0, 2.0]]\n"
        'nodes = 1\nbits = 4\naccuracy = 0.3\n[vehicle]\nradius = 0.25\n[mesh]\nfile = "corner.obj"\nunit = 1.0\n'
    )
    problem = load(tmp_path / "ball.toml").problem()
    figure = Figure()
    path = [[1.0, 1.0, 1.0], [1.5, 1.0, 1.0], [2.0, 1.0, 1.0]]
    problem.draw(figure, {"path": path, "length": 1.0, "crossed": 0}, {})
    (axes,) = figure.axes
    bodies = [each for each in axes.collections if isinstance(each, Poly3DCollection)]
    balls = [faces for body in bodies if len(faces := np.asarray(body._faces).reshape(-1, 3)) == 128 * 4]
    assert len(balls) > 5
    for faces in balls:
        centre = (faces.min(axis=0) + faces.max(axis=0)) / 2
        assert np.linalg.norm(faces - centre, axis=1) == pytest.approx(0.25)
        assert centre[1:] == pytest.approx([1.0, 1.0])
