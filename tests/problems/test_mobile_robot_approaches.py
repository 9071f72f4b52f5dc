"""How a robot enters a goal in which it cannot turn: by approaches that the check accepts, and scans that see them."""

import json

import numpy as np
import pytest
from floors import things
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from benchmarks.robot_worlds import three_room_world
from node.plan import Plan
from node.simulation import simulate
from problems import Run
from problems.mobile_robot import MobileRobot
from problems.mobile_robot.approach_kernels import LONGEST
from problems.mobile_robot.guide_check import distance_around
from spy.past import best_known

BOX = {"vertices": [[-0.425, -0.3], [0.425, -0.3], [0.425, 0.3], [-0.425, 0.3]]}
HOOK = {"vertices": [[-0.5, -0.3], [0.5, -0.3], [0.5, 0.3], [0.2, 0.3], [0.2, 0.0], [-0.5, 0.0]]}


def wall(x0, y0, x1, y1):
    return {"shape": "box", "center": [(x0 + x1) / 2, (y0 + y1) / 2], "size": [x1 - x0, y1 - y0]}


# A bay that opens to the north, 0.8 m wide and 2 m deep.
BAY = [wall(0.0, 0.0, 3.6, 2.0), wall(4.4, 0.0, 8.0, 2.0)]
FIELDS = {
    "kind": "mobile-robot",
    "start": [1.0, 5.0, 0.0],
    "goal": [4.0, 0.8, -np.pi / 2],
    "bounds": [0.0, 0.0, 8.0, 6.0],
    "robot": BOX,
    "obstacles": BAY,
}


def problem_of(**fields):
    return MobileRobot.model_validate(FIELDS | fields)


def followed(problem, number):
    """The solution of a robot that starts at an approach."""
    path, commands, length = [problem.approaches[number, :3].tolist()], [], 0.0
    while number >= 0:
        turn, number = problem.approaches[number, 3], int(problem.approaches[number, 4])
        target = problem.goal if number < 0 else problem.approaches[number]
        x, y, heading = path[-1]
        drive = float(np.hypot(target[0] - x, target[1] - y))
        path += [[float(target[0]), float(target[1]), heading], [float(target[0]), float(target[1]), heading + turn]]
        commands += [["move", drive], ["rotate", float(turn)]]
        length += drive
    return {"commands": commands, "path": path, "length": length}


def leads_to_the_goal(problem, number):
    solution = json.loads(json.dumps(followed(problem, number)))
    start = tuple(problem.approaches[number, :3].tolist())
    assert problem.model_copy(update={"start": start}).check(solution).objections == ()
    assert solution["length"] == pytest.approx(problem.approaches[number, 5])
    assert len(solution["commands"]) <= 2 * LONGEST


def genomes_of(problem, count, seed=0):
    values = np.random.default_rng(seed).integers(0, 1 << problem.bits, (count, 2 * problem.pairs))
    return problem.coding.encode(values)


# Approaches -----------------------------------------------------------------------------------------------------------
def test_a_bay_is_entered_from_its_mouth_ahead():
    problem = problem_of()
    looked_for = problem.approaches[problem.approaches[:, 6] > 0.0]
    assert len(looked_for) > 0
    assert looked_for[:, 1].min() > 2.0
    for number in range(len(problem.approaches)):
        leads_to_the_goal(problem, number)


def test_no_approach_leads_to_a_goal_that_is_stood_in_backwards():
    """The robot would have to drive backwards into the bay, or to turn in it."""
    problem = problem_of(goal=[4.0, 0.8, np.pi / 2])
    assert len(problem.approaches) > 0
    assert problem.approaches[:, 1].max() < 2.0


@pytest.mark.parametrize(
    "fields",
    [{"goal": [6.0, 4.0, 0.0]}, {"robot": {"radius": 0.3}}, {"guide": "straight"}],
    ids=["room to turn", "disc", "the paper's guide"],
)
def test_who_needs_no_approach_has_none(fields):
    problem = problem_of(**fields)
    assert problem.approaches.shape == (0, 7)
    np.testing.assert_array_equal(problem.sources, [[*problem.goal[:2], 0.0]])


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from([BOX, HOOK]),
    st.floats(1.0, 7.0),
    st.floats(1.0, 5.0),
    st.floats(-3.0, 3.0),
    things(0.0, 8.0, most=16),
)
def test_each_approach_leads_to_the_goal_as_the_check_sees_it(robot, x, y, heading, obstacles):
    try:
        problem = problem_of(robot=robot, start=[x, y, heading], goal=[x, y, heading], obstacles=obstacles)
    except ValidationError:  # the robot would stand in something
        return
    for number in range(0, len(problem.approaches), 7):
        leads_to_the_goal(problem, number)


# Scans ----------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("shorten", [False, True])
def test_a_scan_that_sees_an_approach_ends_at_the_goal_and_only_then_its_fitness_is_0(shorten):
    problem = problem_of(shorten=shorten, start=[1.0, 3.0, 0.0], obstacles=[*BAY, wall(2.2, 2.0, 2.4, 4.2)])
    genomes = genomes_of(problem, 300)
    fitness = problem.evaluate(genomes)
    assert 20 < (fitness == 0.0).sum() < 300
    longer = 0
    for genome, worth in zip(genomes[:120], fitness[:120], strict=True):
        solution = json.loads(json.dumps(problem.decode(genome)))
        verdict = problem.check(solution)
        assert verdict.fitness == pytest.approx(worth, abs=1e-6)
        assert verdict.feasible == (worth == 0.0)
        longer += verdict.feasible
    assert longer > 5


def test_a_bay_is_found_by_more_scans_than_see_into_it():
    around, straight = (
        (problem_of(guide=guide).evaluate(genomes_of(problem_of(), 500)) == 0.0).sum()
        for guide in ("around", "straight")
    )
    assert around > 5 * straight


def test_the_way_around_ends_at_the_approaches():
    problem = problem_of()
    x, y, length = problem.sources[0]
    assert distance_around(problem, (x, y)) <= length + problem.grid.spacing * 1.5
    assert distance_around(problem, (x, y)) > 0.0


def test_a_rotation_that_is_blocked_both_ways_is_left_out_by_the_guide_around_and_ends_the_papers_scan():
    lane = [wall(0.0, 0.0, 8.0, 2.6), wall(0.0, 3.4, 6.0, 6.0)]  # the robot cannot turn in it
    fields = {"start": [1.0, 3.0, 0.0], "goal": [7.0, 5.0, np.pi / 2], "obstacles": lane, "code": "binary"}
    values = np.zeros((1, 2 * 8), np.int64)
    values[0, :2] = 64, 127  # face north; then go half of the way ahead
    lengths = {}
    for guide in ("around", "straight"):
        problem = problem_of(**fields, guide=guide, commands=8, shorten=False)
        solution = problem.decode(problem.coding.encode(values)[0])
        lengths[guide] = solution["length"]
        assert all(not text.startswith("segment") for text in problem.check(solution).objections)
        if guide == "around":
            assert solution["commands"][:2] == [["rotate", 0.0], ["move", pytest.approx((8.0 - 1.425) / 2)]]
    assert lengths["straight"] == 0.0
    assert lengths["around"] > 3.0


def test_three_rooms_whose_goal_is_tight_are_solved_by_the_defaults():
    file = three_room_world(1003)  # of the floors from 1001 to 1012 the only one whose goal is tight
    assert len(file.problem().approaches)
    problem = file.problem().for_recipe("tuned", 1)
    champion = best_known(simulate(Plan(problem, Run(seed=1))), "champion")
    assert champion.fitness == 0.0
    assert problem.check(problem.decode(np.frombuffer(champion.genome, np.uint8))).feasible
