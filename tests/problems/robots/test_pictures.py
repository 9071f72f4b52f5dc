"""Robots and what surrounds them are drawn where they are, told apart by color, and named."""

import numpy as np
import pytest
from jointed_robots import FIELDS, WALL, chain, problem_of
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from problems.robot_path.drawing import GOAL, START, SWEPT
from problems.robots.animating import tips_of
from problems.robots.pictures import color_of, shells_of

CORNER = "v 0.2 0.2 0.1\nv 0.5 0.2 0.1\nv 0.2 0.5 0.1\nv 0.2 0.2 0.4\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
FLOOR = {"id": "floor", "shape": "box", "size": [40.0, 40.0, 0.1], "position": [0.0, 0.0, -0.8]}


def two_armed(**fields):
    """Two chains side by side, the second one with names in capitals."""
    other = chain().replace("bar_", "BAR_").replace("joint_", "JOINT_").replace("post", "POST")
    stand = (
        '<joint name="stand" type="fixed"><parent link="post"/><child link="POST"/><origin xyz="0 3 0"/></joint>'
        '<joint name="pair" type="fixed"><parent link="stage"/><child link="post"/></joint><link name="stage"/>'
    )
    urdf = chain().replace(
        "</robot>", other.removeprefix('<robot name="chain">').replace("</robot>", stand + "</robot>")
    )
    start, goal = FIELDS["start"], FIELDS["goal"]
    return problem_of(**({"robot": {"urdf": urdf}, "start": start * 2, "goal": goal * 2, "obstacles": []} | fields))


def solution_of(problem):
    path = [problem.start, *([np.zeros(len(problem.start)).tolist()]), problem.ends[0]]
    return {"path": path, "length": 3.0, "clearance": 0.0}


def drawn(problem, solution):
    """The axes of the scene, and the texts of its legend, after all has been rendered."""
    figure = Figure()
    canvas = FigureCanvasAgg(figure)
    problem.draw(figure, solution, {})
    canvas.draw()
    (axes,) = (each for each in figure.axes if each.name == "3d")
    return axes, [text.get_text() for legend in axes.figure.legends for text in legend.get_texts()]


def faces_in(axes, color):
    """The faces of about this hue, whatever their shade, shape (n, 3, 3)."""
    (solids,) = axes.collections
    colors = solids._facecolor3d
    hues = colors[:, :3] / np.maximum(colors[:, :3].max(axis=1, keepdims=True), 1e-9)
    wanted = np.array(to_rgb(color)) / max(to_rgb(color))
    return np.asarray(solids._faces)[(np.abs(hues - wanted).max(axis=1) < 1e-6) & (colors[:, 3] > 0.0)][:, :3]


def ways_in(axes):
    return {line.get_label(): np.array(line.get_data_3d()).T for line in axes.lines if len(line.get_data_3d()[0]) > 2}


def test_a_picture_names_and_colors_start_goal_way_and_obstacles():
    post = {"id": "post", "shape": "cylinder", "radius": 0.05, "length": 0.4, "position": [0.0, 0.9, 0.0]}
    problem = problem_of(obstacles=[WALL, post])
    axes, texts = drawn(problem, solution_of(problem))
    assert texts == ["start", "goal", "on the way", "nearly the same in all", "way of bar_3", "wall", "post"]
    for color in (START, GOAL, SWEPT):
        assert len(faces_in(axes, color))
    corners = faces_in(axes, color_of(0)[:3]).reshape(-1, 3)
    size, middle = np.array(WALL["size"]), np.array(WALL["position"])
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [middle - size / 2, middle + size / 2])
    assert len(faces_in(axes, color_of(1)[:3]))


def test_each_arm_that_moves_has_a_way():
    problem = two_armed()
    axes, texts = drawn(problem, solution_of(problem))
    ways = ways_in(axes)
    assert ways.keys() == {"way of bar_3", "way of BAR_3"} <= set(texts)
    np.testing.assert_allclose(
        ways["way of BAR_3"] - ways["way of bar_3"], np.tile([0.0, 3.0, 0.0], (60, 1)), atol=1e-9
    )
    still = two_armed(goal=[*FIELDS["goal"], *FIELDS["start"]])
    path = [still.start, still.ends[0]]
    assert ways_in(drawn(still, {"path": path, "length": 2.0, "clearance": 0.0})[0]).keys() == {"way of bar_3"}


def test_a_link_stands_for_the_tip_of_its_branch():
    arm = two_armed().scene.arm
    assert set(tips_of(arm)) == {"bar_3", "BAR_3"}
    assert tips_of(arm, "bar_2") == ("bar_2", "BAR_3")
    assert tips_of(arm, "BAR_3") == ("BAR_3", "bar_3")


def test_a_mesh_has_the_color_of_an_obstacle_and_not_of_the_robot(tmp_path):
    (tmp_path / "corner.obj").write_text(CORNER)
    mesh = {"id": "corner", "shape": "mesh", "file": str(tmp_path / "corner.obj")}
    problem = problem_of(obstacles=[mesh, WALL])
    axes, texts = drawn(problem, None)
    assert {"corner", "wall"} <= set(texts)
    corners = faces_in(axes, color_of(0)[:3]).reshape(-1, 3)
    np.testing.assert_allclose(
        [corners.min(axis=0), corners.max(axis=0)], [[0.2, 0.2, 0.1], [0.5, 0.5, 0.4]], atol=1e-6
    )
    for color in (START, GOAL):
        assert faces_in(axes, color)[..., 2].max() < 0.1


def test_what_is_much_larger_than_the_robot_is_cut_off_at_the_axes():
    problem = problem_of(obstacles=[FLOOR])
    axes, _ = drawn(problem, solution_of(problem))
    floor = faces_in(axes, color_of(0)[:3])
    assert len(floor)
    for number, (low, high) in enumerate((axes.get_xlim(), axes.get_ylim(), axes.get_zlim())):
        assert high - low < 4.0
        beyond = 0.2 * (high - low)
        assert low - beyond < floor[..., number].min() <= floor[..., number].max() < high + beyond


def test_lengths_look_alike_in_all_directions():
    axes, _ = drawn(problem_of(), None)
    lengths = [high - low for low, high in (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())]
    assert axes._box_aspect / lengths == pytest.approx(axes._box_aspect[0] / lengths[0])


def test_many_obstacles_are_counted_rather_than_named():
    balls = [{"id": f"ball {n}", "shape": "sphere", "radius": 0.05, "position": [0.1 * n, 0.0, 0.3]} for n in range(12)]
    _, texts = drawn(problem_of(obstacles=balls), None)
    assert "ball 6" in texts
    assert "ball 7" not in texts
    assert texts[-1] == "and 5 more obstacles"


def test_a_hull_has_few_triangles_and_the_extent_of_its_piece():
    arm = problem_of().scene.arm
    for (body, hull), root in zip(shells_of(arm), arm.piece_root, strict=True):
        assert body in arm.piece_body
        centre, radius = arm.spheres[root, :3], arm.spheres[root, 3]
        assert len(hull) <= 200
        assert np.linalg.norm(hull - centre, axis=-1).max() <= radius + 1e-9
