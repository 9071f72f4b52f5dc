"""Ways that have been found are shortened, and what is left of them is as free as it was."""

import json

import numpy as np
import pytest
from floors import things
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from problems.mobile_robot import MobileRobot

WALL = {"shape": "box", "center": [4.0, 2.0], "size": [0.2, 4.0]}  # a gap above it
FIELDS = {
    "kind": "mobile-robot",
    "start": [1.0, 1.0, 0.0],
    "goal": [7.0, 1.0, 1.0],
    "bounds": [0.0, 0.0, 8.0, 6.0],
    "robot": {"radius": 0.3},
    "obstacles": [WALL],
}
ROBOTS = [
    {"radius": 0.3},
    {"vertices": [[-0.425, -0.3], [0.425, -0.3], [0.425, 0.3], [-0.425, 0.3]]},
    {"vertices": [[-0.5, -0.3], [0.5, -0.3], [0.5, 0.3], [0.2, 0.3], [0.2, 0.0], [-0.5, 0.0]]},
]


def both(**fields):
    return [MobileRobot.model_validate(FIELDS | fields | {"shorten": shorten}) for shorten in (False, True)]


def solvers(problem, count, seed=0):
    values = np.random.default_rng(seed).integers(0, 1 << problem.bits, (count, 2 * problem.pairs))
    genomes = problem.coding.encode(values)
    return genomes[problem.evaluate(genomes) == 0.0]


def test_a_way_over_a_wall_becomes_nearly_the_shortest():
    found, short = both()
    least = short.oracle().figures["shortest_length_at_least"]
    lengths = [(found.decode(each)["length"], short.decode(each)["length"]) for each in solvers(short, 300)]
    assert len(lengths) > 20
    assert np.median([length for length, _ in lengths]) > 1.3 * least
    assert np.median([length for _, length in lengths]) < 1.05 * least


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(ROBOTS),
    st.integers(0, 1 << 30),
    things(2.0, 6.0, most=6),
)
def test_a_shortened_way_is_free_as_shapely_sees_it_and_no_longer(robot, seed, obstacles):
    try:
        found, short = both(robot=robot, obstacles=[WALL, *obstacles])
    except ValidationError:  # the robot would stand in something
        return
    for genome in solvers(short, 60, seed)[:3]:
        way = json.loads(json.dumps(short.decode(genome)))
        assert short.check(way).objections == ()
        assert way["length"] <= found.decode(genome)["length"] * 1.05


def test_what_does_not_arrive_is_left_as_it_is():
    found, short = both(obstacles=[WALL | {"center": [4.0, 3.0], "size": [0.2, 6.0]}])
    values = np.random.default_rng(1).integers(0, 256, (5, 2 * short.pairs))
    for genome in short.coding.encode(values):
        assert short.decode(genome) == found.decode(genome)


@pytest.mark.parametrize("robot", ROBOTS)
def test_who_is_at_the_goal_only_turns(robot):
    _, short = both(robot=robot, obstacles=[], goal=[1.0, 1.0, 2.0])
    (genome, *_) = solvers(short, 1)
    assert short.decode(genome)["commands"] == [["rotate", pytest.approx(2.0)]]


def test_the_recipe_chooses_unless_the_file_does():
    problem = MobileRobot.model_validate(FIELDS)
    assert problem.for_recipe("tuned", 1).shorten is True
    assert problem.for_recipe("paper", 1).shorten is False
    assert MobileRobot.model_validate(FIELDS | {"shorten": False}).for_recipe("tuned", 1).shorten is False
