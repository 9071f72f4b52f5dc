"""The clearance that a mobile robot keeps: by the scan, by shortened ways, by the check and by the oracle."""

import json
from itertools import pairwise

import numpy as np
import pytest
import shapely
from pydantic import ValidationError

from problems.mobile_robot import MobileRobot

WALL = {"shape": "box", "center": [4.0, 2.0], "size": [0.2, 4.0]}  # a gap of 2 m above it
BALL = {"shape": "circle", "center": [2.5, 4.5], "radius": 0.4}
FIELDS = {
    "kind": "mobile-robot",
    "start": [1.0, 1.0, 0.0],
    "goal": [7.0, 1.0, 1.0],
    "bounds": [0.0, 0.0, 8.0, 6.0],
    "obstacles": [WALL, BALL],
}
ROBOTS = [{"radius": 0.3}, {"vertices": [[-0.425, -0.3], [0.425, -0.3], [0.425, 0.3], [-0.425, 0.3]]}]


def problem_of(**fields):
    return MobileRobot.model_validate(FIELDS | fields)


@pytest.mark.parametrize("shorten", [False, True])
@pytest.mark.parametrize("robot", ROBOTS)
def test_ways_keep_the_clearance_and_the_check_measures_it(robot, shorten):
    problem = problem_of(robot=robot, clearance=0.15, shorten=shorten)
    bare = problem_of(robot=robot)
    values = np.random.default_rng(3).integers(0, 256, (6000, 2 * problem.pairs))
    genomes = problem.coding.encode(values)
    solvers = genomes[problem.evaluate(genomes) == 0.0]
    assert len(solvers) > 5
    for genome in solvers[:20]:
        verdict = problem.check(json.loads(json.dumps(problem.decode(genome))))
        assert verdict.objections == ()
        assert verdict.clearance.least >= 0.15 - 1e-6
        assert bare.check(problem.decode(genome)).clearance == verdict.clearance


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_way_that_comes_too_near_is_refused_by_the_segment_and_the_obstacle(robot):
    over = {
        "commands": [["rotate", np.pi / 2], ["move", 3.75], ["rotate", -np.pi / 2], ["move", 6.0], ["rotate", 1.0]],
        "path": [
            [1.0, 1.0, 0.0],
            [1.0, 1.0, np.pi / 2],
            [1.0, 4.75, np.pi / 2],
            [1.0, 4.75, 0.0],
            [7.0, 4.75, 0.0],
            [7.0, 4.75, 1.0],
        ],
        "length": 9.75,
    }
    fields = {"robot": robot, "obstacles": [WALL], "goal": [7.0, 4.75, 1.0]}
    verdict = problem_of(**fields).check(over)
    assert verdict.objections == ()
    assert verdict.clearance.least == pytest.approx(0.45, abs=1e-6)
    assert verdict.clearance.where["obstacle"] in (0, "bounds")
    assert problem_of(**fields, clearance=0.4).check(over).objections == ()
    (objection,) = problem_of(**fields, clearance=0.46).check(over).objections
    assert objection.endswith("nearer than the clearance, 0.46 m")


def test_who_stands_too_near_at_the_start_is_told_the_clearance():
    with pytest.raises(ValidationError, match=r"start: .* obstacles\[0\], or nearer to it than the clearance, 0.5 m"):
        problem_of(robot=ROBOTS[0], start=[3.2, 1.0, 0.0], clearance=0.5)


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_oracle_knows_when_the_clearance_closes_the_gap(robot):
    fields = {"robot": robot, "obstacles": [WALL], "start": [1.8, 1.8, 0.0], "goal": [6.2, 1.8, 1.0]}
    assert problem_of(**fields, clearance=0.6).oracle().meaning == "optimum"
    closed = problem_of(**fields, clearance=0.71).oracle()
    assert (closed.meaning, closed.fitness > 0.0) == ("lower bound", True)


def test_a_turn_keeps_the_clearance_from_walls_and_obstacles():
    square = {"vertices": [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]}
    for gap, free in ((0.1, True), (0.3, False)):
        room = {"shape": "box", "center": [5.0, 2.0 + np.sqrt(0.5) + 0.2 + 0.5], "size": [4.0, 1.0]}
        ends = {"start": [5.0, 2.0, 0.0], "goal": [5.0, 2.0, np.pi / 2]}
        problem = problem_of(robot=square, obstacles=[room], clearance=gap, **ends)
        turned = {"commands": [["rotate", np.pi / 2]], "path": [[5.0, 2.0, 0.0], [5.0, 2.0, np.pi / 2]], "length": 0.0}
        assert (problem.check(turned).objections == ()) is free
        genome = problem.coding.encode(np.zeros((1, 2 * problem.pairs), np.int64))
        assert (problem.decode(genome[0])["commands"] == [["rotate", pytest.approx(np.pi / 2)]]) is free


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_clearance_is_that_of_the_robot_at_its_poses(robot):
    """By shapely at many poses along the way; shapes and walls are the test's own."""
    solids = shapely.union_all([shapely.box(3.9, 0.0, 4.1, 4.0), shapely.Point(2.5, 4.5).buffer(0.4, quad_segs=1024)])
    walls = shapely.box(0.0, 0.0, 8.0, 6.0).exterior
    problem = problem_of(robot=robot, clearance=0.1)
    genomes = problem.coding.encode(np.random.default_rng(5).integers(0, 256, (4000, 2 * problem.pairs)))
    for genome in genomes[problem.evaluate(genomes) == 0.0][:4]:
        solution = problem.decode(genome)
        gaps = []
        for pose, following in pairwise(np.array(solution["path"])):
            for x, y, heading in np.linspace(pose, following, 200):
                body = shapely.Point(0.0, 0.0)
                if "vertices" in robot:
                    body = shapely.affinity.rotate(
                        shapely.Polygon(robot["vertices"]), heading, (0, 0), use_radians=True
                    )
                body = shapely.affinity.translate(body, x, y)
                gaps.append(min(body.distance(solids), body.distance(walls)) - robot.get("radius", 0.0))
        assert min(gaps) >= 0.1 - 1e-5
        assert problem.check(solution).clearance.least == pytest.approx(min(gaps), abs=2e-3)
