"""What guides the search for a mobile robot's way: distances around obstacles, commands by the floor, more of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from node.plan import Plan
from node.simulation import simulate
from problems import BadInput, ProblemFile, Run
from problems.mobile_robot import MobileRobot, guide_kernels
from problems.mobile_robot.arrays import floor_arrays
from problems.mobile_robot.guide_check import distance_around
from spy.past import best_known

BOX = {"vertices": [[-0.4, -0.3], [0.4, -0.3], [0.4, 0.3], [-0.4, 0.3]]}
# A pocket that opens to the west; the goal is behind its bottom.
POCKET = [
    {"shape": "box", "center": [5.0, 3.0], "size": [0.2, 4.2]},
    {"shape": "box", "center": [3.5, 5.0], "size": [3.0, 0.2]},
    {"shape": "box", "center": [3.5, 1.0], "size": [3.0, 0.2]},
]
FIELDS = {
    "kind": "mobile-robot",
    "start": [2.5, 3.0, 0.0],
    "goal": [7.0, 3.0, 0.0],
    "bounds": [0.0, 0.0, 8.0, 7.0],
    "robot": BOX,
    "obstacles": POCKET,
}


DISCS = [{"radius": 0.4}, {"radius": 0.05}]


def problem_of(**fields):
    return MobileRobot.model_validate(FIELDS | fields)


def distance(problem, x, y):
    """As `evaluate` has it: a disc whose start is there and that makes the least of moves, or stays."""
    grid, floor = problem.grid, floor_arrays(problem.bounds, problem.obstacles)
    distances = guide_kernels.distances(grid, problem.sources, floor)
    column, row = int((x - grid.west) // grid.spacing), int((y - grid.south) // grid.spacing)
    column, row = np.clip(column, 0, grid.columns - 2), np.clip(row, 0, grid.rows - 2)
    return min(
        distances[i, j] + np.hypot(grid.west + i * grid.spacing - x, grid.south + j * grid.spacing - y)
        for i in (column, column + 1)
        for j in (row, row + 1)
    )


# Distances ------------------------------------------------------------------------------------------------------------
def test_in_an_empty_hall_the_way_is_straight_but_for_the_grid():
    hall = problem_of(obstacles=[])
    for x, y in ((1.0, 1.0), (2.5, 6.0), (6.5, 3.3)):
        straight = np.hypot(7.0 - x, 3.0 - y)
        assert straight <= distance(hall, x, y) < 1.09 * straight + hall.grid.spacing


def test_the_way_leads_around_and_grows_towards_the_bottom_of_a_pocket():
    floor = problem_of()
    depths = [distance(floor, x, 3.0) for x in (1.2, 2.0, 3.0, 4.0, 4.5)]
    assert depths == sorted(depths)
    assert depths[-1] > 3.5 + 2 * 2.0 + 3.0  # out of the pocket, along its side, and back to the goal's height


def test_ways_avoid_gaps_that_the_robot_does_not_fit_through():
    wall = [
        {"shape": "box", "center": [4.0, y], "size": [0.2, size]} for y, size in ((1.25, 2.5), (4.6, 3.2))
    ]  # a gap of 0.5 m at the straight line, and one of 0.8 m above
    through, around = (distance(problem_of(obstacles=wall, robot={"radius": r}), 1.0, 2.75) for r in (0.2, 0.3))
    assert through < 6.6
    assert 8.0 < around < 12.0


coordinates = st.integers(0, 40).map(lambda tenths: tenths / 5.0)  # many on the grid's lines, many the same
sizes = st.integers(1, 10).map(lambda tenths: tenths / 5.0)
shapes = st.one_of(
    st.builds(lambda x, y, r: {"shape": "circle", "center": [x, y], "radius": r}, coordinates, coordinates, sizes),
    st.builds(
        lambda x, y, a, b, t: {"shape": "box", "center": [x, y], "size": [a, b], "angle": t},
        coordinates,
        coordinates,
        sizes,
        sizes,
        st.sampled_from([0.0, 0.5, 1.5707963267948966]),
    ),
    st.builds(
        lambda x, y, a, b: {"shape": "polygon", "vertices": [[x, y], [x + a, y], [x + a / 4, y + b / 4], [x, y + b]]},
        coordinates,
        coordinates,
        sizes,
        sizes,
    ),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(shapes, max_size=8), st.sampled_from([BOX, *DISCS]), coordinates, coordinates)
def test_the_check_finds_the_same_way_and_none_is_shorter_than_the_straight_one(obstacles, robot, x, y):
    try:
        floor = problem_of(obstacles=obstacles, robot=robot)
    except ValidationError:  # somebody stands in something
        return
    found = distance(floor, x, y)
    assert distance_around(floor, (x, y)) == pytest.approx(found, rel=1e-9)
    assert found >= np.hypot(7.0 - x, 3.0 - y) - 1e-9


# Fitness --------------------------------------------------------------------------------------------------------------
def genomes_of(problem, count, seed=0):
    values = np.random.default_rng(seed).integers(0, 1 << problem.bits, (count, 2 * problem.pairs))
    return problem.coding.encode(values)


@pytest.mark.parametrize("robot", [BOX, {"radius": 0.3}], ids=["polygon", "disc"])
def test_the_fitness_is_0_if_and_only_if_the_goal_is_seen(robot):
    """Nobody who ends in the pocket sees the goal, and whoever is told to have seen it gets there."""
    floor = problem_of(robot=robot)
    genomes = genomes_of(floor, 400)
    fitness = floor.evaluate(genomes)
    ends = [floor.decode(genome)["path"][-1] for genome in genomes]
    arrived = np.array([np.hypot(x - 7.0, y - 3.0) < 1e-6 for x, y, _ in ends])
    assert 5 < arrived.sum() < 395
    np.testing.assert_array_equal(fitness == 0.0, arrived)


def test_of_a_scan_that_sees_nothing_the_nearest_place_counts_and_ends_the_path():
    floor = problem_of()
    for genome in genomes_of(floor, 50, seed=1):
        (fitness,) = floor.evaluate(genome[None])
        if fitness == 0.0:
            continue
        path = floor.decode(genome)["path"]
        worth = [distance_around(floor, pose[:2]) + 0.5 * abs(np.angle(np.exp(1j * (0.0 - pose[2])))) for pose in path]
        assert fitness == pytest.approx(worth[-1])
        assert worth[-1] == pytest.approx(min(worth))


def test_doors_far_from_the_straight_line_are_found_from_every_seed_by_the_way_around():
    def wall(x, low, high):
        return {"shape": "box", "center": [x, (low + high) / 2], "size": [0.2, high - low]}

    doors = [wall(3.0, 0.0, 6.0), wall(3.0, 6.7, 7.0), wall(5.0, 0.0, 0.3), wall(5.0, 1.0, 7.0)]  # 0.1 m wider than it
    ends = {"start": [1.0, 3.5, 0.0], "goal": [7.0, 3.5, 0.0], "obstacles": doors, "commands": 12}
    solved = {}
    for guide in ("around", "straight"):
        floor = problem_of(**ends, guide=guide).for_recipe("tuned", 1)
        runs = [simulate(Plan(floor, Run(seed=seed, generations=60))) for seed in range(1, 9)]
        solved[guide] = sum(best_known(reports, "champion").fitness == 0.0 for reports in runs)
    assert solved["around"] == 8
    assert solved["straight"] < 6


def test_the_recipe_chooses_the_guide_unless_the_file_does():
    assert problem_of().for_recipe("tuned", 1).guide == "around"
    assert problem_of().for_recipe("paper", 1).guide == "straight"
    assert problem_of(guide="straight").for_recipe("tuned", 1).guide == "straight"
    assert problem_of(guide="around", code="gray").for_recipe("paper", 1).guide == "around"


# Commands -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("obstacles", "commands"), [(0, 8), (3, 9), (20, 18), (200, 24)])
def test_the_floor_chooses_the_number_of_commands(obstacles, commands):
    fields = FIELDS | {"obstacles": [{"shape": "circle", "center": [1.0, 6.0], "radius": 0.1}] * obstacles}
    assert MobileRobot.derive_fields(fields)["commands"] == commands
    assert MobileRobot.model_validate(fields).pairs == commands
    assert MobileRobot.derive_fields(fields | {"commands": 5})["commands"] == 5


def test_an_update_of_the_obstacles_keeps_the_number_of_commands(tmp_path):
    file = ProblemFile("floor", MobileRobot.derive_fields(FIELDS), Run(), tmp_path)
    moved = file.changed({"obstacles": [*POCKET, *POCKET, *POCKET, *POCKET]}, {})
    assert moved.problem().pairs == file.problem().pairs == 9


def test_what_is_wrong_with_obstacles_is_said_by_the_check_of_the_file(tmp_path):
    file = ProblemFile("floor", MobileRobot.derive_fields(FIELDS | {"obstacles": 7}), Run(), tmp_path)
    with pytest.raises(BadInput, match="floor: obstacles"):
        file.problem()


def test_each_attempt_has_half_as_many_commands_again_and_the_paper_makes_none():
    floor, commands = problem_of().for_recipe("tuned", 1), []
    for attempt in range(1, 8):
        changed = floor.next_attempt(attempt)
        floor = MobileRobot.model_validate(FIELDS | changed)
        commands.append(floor.pairs)
    assert commands == [13, 19, 28, 42, 63, 64, 64]
    assert problem_of(commands=100).next_attempt(1) == {"commands": 100}
    assert problem_of().for_recipe("paper", 1).next_attempt(1) is None
