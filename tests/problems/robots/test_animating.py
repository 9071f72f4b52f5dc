"""Animations of robots: bodies at modest detail, at the places that the kinematics says."""

import numpy as np
import pytest
from jointed_robots import FIELDS, WALL, problem_of

from problems.animation import Body, coarsened, sharp_edges
from problems.guard import animated
from problems.robots.chain import frames_of
from problems.robots.shapes import box, sphere

PATH = {"path": [FIELDS["start"], [0.0, -1.0, 0.3], FIELDS["goal"]], "length": 3.0, "clearance": 0.0}


@pytest.fixture(scope="module")
def problem():
    return problem_of()


def test_a_path_goes_from_start_to_goal_over_time(problem):
    found = animated(problem, PATH)
    assert found.along_name == "time / s"
    assert (np.diff(found.along) > 0.0).all()
    assert found.curves[[0, -1]] == pytest.approx(np.array([FIELDS["start"], FIELDS["goal"]]))
    assert found.frames == pytest.approx(frames_of(problem.scene.arm, found.curves))
    assert [ghost.name for ghost in found.ghosts] == ["start", "goal"]
    assert found.ghosts[1].frames == pytest.approx(found.frames[-1])
    assert [line.shape for line in found.lines] == [(len(found.along), 3)]
    assert {(each.name, each.role) for each in found.bodies} >= {("bar_1", "robot"), (WALL["id"], "obstacle")}


def test_without_a_solution_the_robot_stands_at_the_start(problem):
    found = animated(problem, None)
    assert found.curves == pytest.approx(np.array([FIELDS["start"]]))
    assert found.lines == ()
    low, high = found.box(0.1)
    assert (low < high).all()


def test_a_box_has_twelve_edges_and_a_sphere_is_coarsened():
    body = Body.of_soup("box", "obstacle", 0, box((1.0, 2.0, 3.0)))
    assert (len(body.vertices), len(body.triangles), len(body.edges)) == (8, 12, 12)
    ball = Body.of_soup("ball", "obstacle", 0, sphere(1.0))
    assert len(sharp_edges(ball.vertices, ball.triangles)) == 0
    vertices, triangles = coarsened(ball.vertices, ball.triangles, 100)
    assert 0 < len(triangles) <= 100
    assert triangles.max() < len(vertices)
