"""The floors that the mobile robot is measured on: they are as they say, and the same for the same number."""

import functools

import numpy as np
import pytest

from benchmarks.robot_worlds import Row, narrow_door_world, on_a_cluster, simulated, summary, three_room_world
from problems.plane import Box

FAMILIES = [three_room_world, narrow_door_world]


@functools.cache
def floor(family, number):
    """A floor, which takes seconds to make: many are drawn before one has a way."""
    return family(number)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("number", [1, 2])
def test_a_floor_has_three_rooms_and_twenty_obstacles_and_surely_a_way(family, number):
    file = floor(family, number)
    problem = file.problem()
    assert file.fields == family(number).fields
    walls, furniture = problem.obstacles[:4], problem.obstacles[4:]
    assert all(isinstance(wall, Box) for wall in walls)
    assert len(furniture) == 20
    assert problem.start[0] < walls[0].center[0] < walls[2].center[0] < problem.goal[0]
    answer = problem.oracle()
    assert answer.meaning == "optimum"
    assert problem.check(answer.solution).feasible


@pytest.mark.parametrize(("family", "least", "most"), [(three_room_world, 1.58, 2.17), (narrow_door_world, 1.05, 1.2)])
@pytest.mark.parametrize("number", [1, 2])
def test_doors_are_so_much_wider_than_the_robot(family, number, least, most):
    problem = floor(family, number).problem()
    robot = problem.robot
    wide = 2.0 * robot.radius if robot.vertices is None else np.ptp(np.array(robot.vertices)[:, 1])
    for below, above in (problem.obstacles[:2], problem.obstacles[2:4]):
        door = above.corners[:, 1].min() - below.corners[:, 1].max()
        assert least - 1e-9 <= door / wide <= most + 1e-9


def test_robots_are_discs_and_polygons_or_a_rectangle_of_85_by_60_centimetres():
    assert [floor(narrow_door_world, number).problem().robot.radius is None for number in (1, 2)] == [False, True]
    assert np.ptp(floor(three_room_world, 1).problem().robot.vertices, axis=0) == pytest.approx([0.85, 0.6])


def test_processes_and_the_simulator_solve_a_floor_alike():
    files = [three_room_world(1013)]
    (one,), (other,) = on_a_cluster(files, range(5, 6)), simulated(files, range(5, 6))
    assert one.solved
    assert one.seconds > 0.0
    assert one.ratio == other.ratio < 1.2
    assert other.seconds is None


def test_the_figures_are_of_the_floors_that_were_solved():
    rows = [Row(True, 0.5, 1600, 1.0), Row(False, 60.0, 99999, None), Row(True, 0.7, 3200, 1.2)]
    lines = summary(rows).splitlines()
    assert lines[0] == "solved: 2 of 3"
    assert lines[1].startswith("seconds: 0.600 in the median")
    assert lines[2] == "evaluations: 2,400 in the median"
    assert lines[3].startswith("length / lower bound: 1.100 in the median")
