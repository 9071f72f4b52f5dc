"""The mobile-robot planner: its file, its coding, its paths, its judge, its example and its pictures."""

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from matplotlib.figure import Figure
from scipy import ndimage

from benchmarks.robot_worlds import narrow_door_world
from genetics import Recipe
from node.plan import Plan
from node.simulation import simulate
from problems import BadInput, ProblemFile, Run, load
from problems.file import parse
from problems.mobile_robot import MobileRobot
from problems.mobile_robot.oracle_shapes import grown
from problems.mobile_robot.oracle_ways import shortest_way
from problems.plane import Circle
from spy.past import best_known
from spy.result import stop_reasons

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "mobile-robot.toml"
WALL = {"shape": "box", "center": [4.0, 2.0], "size": [0.2, 4.0]}  # from the lower bound up, a gap above
HOOK = [[-0.5, -0.3], [0.5, -0.3], [0.5, 0.3], [0.2, 0.3], [0.2, 0.0], [-0.5, 0.0]]  # concave


def robot_file(**fields):
    base = {
        "kind": "mobile-robot",
        "start": [1.0, 1.0, 0.0],
        "goal": [7.0, 1.0, 1.0],
        "bounds": [0.0, 0.0, 8.0, 6.0],
        "robot": {"vertices": HOOK},
        "obstacles": [WALL],
        "shorten": False,
    }
    return parse("kind = 'mobile-robot'", "robot.toml", Path()), base | fields


def problem_of(**fields):
    file, merged = robot_file(**fields)
    return ProblemFile(file.name, merged, file.run, file.folder).problem()


def genomes_of(problem, count, seed=0):
    values = np.random.default_rng(seed).integers(0, 1 << problem.bits, (count, 2 * problem.pairs))
    return problem.coding.encode(values)


def crowded(number, **fields):
    """A floor of random obstacles, in which a start and goal are free."""
    generator = np.random.default_rng([5, number])
    while True:
        obstacles = []
        for _ in range(8):
            x, y = generator.uniform(0, 6, 2).tolist()
            size = generator.uniform(0.1, 0.5)
            obstacles.append({"shape": "circle", "center": [x, y], "radius": size})
            corners = [[x + 1, y], [x + 1 + 2 * size, y + size / 2], [x + 1 + size / 2, y + 2 * size]]
            obstacles.append({"shape": "polygon", "vertices": corners})
        poses = generator.uniform([0, 0, -4], [8, 6, 4], (2, 3)).tolist()
        try:
            return problem_of(start=poses[0], goal=poses[1], obstacles=obstacles, **fields)
        except BadInput:
            continue


def command(problem, *values):
    """A genome of given commands, as integers; the rest turn to 0 and go as little as they can."""
    row = np.zeros((1, 2 * problem.pairs), np.int64)
    row[0, : len(values)] = values
    return problem.coding.encode(row)[0]


# Commands and paths ---------------------------------------------------------------------------------------------------
def test_commands_turn_to_absolute_headings_and_move_a_share_of_the_free_length():
    problem = problem_of(obstacles=[], goal=[7.0, 5.0, 0.0], robot={"radius": 0.5}, code="binary")
    blocked = problem_of(robot={"radius": 0.5}, code="binary")
    assert problem.evaluate(command(problem)[None])[0] == 0.0
    solution = blocked.decode(command(blocked, 64, 255, 64, 127))
    assert solution["commands"][0] == ["rotate", pytest.approx(np.pi / 2)]
    assert solution["commands"][1] == ["move", pytest.approx(4.5)]
    assert solution["path"][2] == pytest.approx([1.0, 5.5, np.pi / 2])


def test_the_last_move_is_the_visible_one_and_the_robot_ends_at_the_goal():
    problem = problem_of(robot={"radius": 0.3}, code="binary")
    solution = problem.decode(command(problem, 64, 240, 0, 255))
    names = [name for name, _ in solution["commands"]]
    assert names == ["rotate", "move", "rotate", "move", "rotate", "move", "rotate"]
    assert solution["path"][-1][:2] == pytest.approx([7.0, 1.0])
    assert np.cos(solution["path"][-1][2] - 1.0) == pytest.approx(1.0)
    assert solution["length"] == pytest.approx(sum(value for name, value in solution["commands"] if name == "move"))


def test_a_rotation_goes_by_the_shorter_sense_else_by_the_other_else_the_scan_ends():
    beam = {"vertices": [[-0.1, -0.1], [1.0, -0.1], [1.0, 0.1], [-0.1, 0.1]]}
    post = {"shape": "circle", "center": [1.5, 1.9], "radius": 0.3}
    fields = {"start": [1.0, 1.3, 0.0], "robot": beam, "code": "binary", "bounds": [-2.0, -2.0, 8.0, 6.0]}
    fields["guide"] = "straight"
    free = problem_of(**fields, obstacles=[WALL])
    assert free.decode(command(free, 64))["commands"][0] == ["rotate", pytest.approx(np.pi / 2)]
    other = problem_of(**fields, obstacles=[WALL, post])
    assert other.decode(command(other, 64))["commands"][0] == ["rotate", pytest.approx(-3 * np.pi / 2)]
    caught = problem_of(**fields, obstacles=[WALL, post, post | {"center": [1.5, 0.7]}])
    solution = caught.decode(command(caught, 64))
    assert solution == {"commands": [], "path": [[1.0, 1.3, 0.0]], "length": 0.0}
    radius = np.hypot(1.0, 0.1)
    assert caught.evaluate(command(caught, 64)[None])[0] == pytest.approx(np.hypot(6.0, 0.3) + radius * 1.0)


def test_the_papers_fitness_at_the_end_of_the_scan_is_distance_and_heading():
    problem = problem_of(commands=1, code="binary", guide="straight")
    for values in ((0, 0), (32, 100), (200, 255)):
        x, y, heading = problem.decode(command(problem, *values))["path"][-1]
        off = abs(np.angle(np.exp(1j * (1.0 - heading))))
        expected = np.hypot(7.0 - x, 1.0 - y) + np.hypot(0.5, 0.3) * off
        assert problem.evaluate(command(problem, *values)[None])[0] == pytest.approx(expected)


def test_a_robot_at_its_goal_only_turns():
    solution = problem_of(goal=[1.0, 1.0, 2.0]).decode(command(problem_of()))
    assert solution["commands"] == [["rotate", pytest.approx(2.0)]]


@pytest.mark.parametrize("code", ["binary", "gray"])
def test_a_batch_is_evaluated_as_one_by_one(code):
    problem = crowded(0, code=code)
    genomes = genomes_of(problem, 300)
    alone = [problem.evaluate(genome[None])[0] for genome in genomes]
    np.testing.assert_array_equal(problem.evaluate(genomes), alone)


@pytest.mark.parametrize("robot", [{"vertices": HOOK}, {"radius": 0.3}], ids=["concave", "disc"])
@pytest.mark.parametrize("bits", [3, 8, 62])
def test_every_path_passes_the_check_but_for_its_end_and_is_solved_if_its_fitness_is_0(robot, bits):
    solved = 0
    for number in range(6):
        problem = crowded(number, robot=robot, bits=bits)
        genomes = genomes_of(problem, 12, seed=number)
        for genome, fitness in zip(genomes, problem.evaluate(genomes), strict=True):
            verdict = problem.check(json.loads(json.dumps(problem.decode(genome))))
            assert verdict.fitness == pytest.approx(fitness, abs=1e-6)
            assert verdict.feasible == (fitness == 0.0)
            assert all(objection.startswith("the path ends") for objection in verdict.objections)
            solved += verdict.feasible
    assert solved > 5


# Check ----------------------------------------------------------------------------------------------------------------
def solved_office():
    plan = Plan.of(load(EXAMPLE))
    champion = best_known(simulate(plan), "champion")
    return plan.problem, plan.problem.decode(np.frombuffer(bytes(champion.genome), np.uint8))


@pytest.fixture(scope="module")
def office():
    return solved_office()


def objections(problem, solution):
    return problem.check(solution).objections


def test_the_check_names_the_segment_and_the_obstacle(office):
    problem, solution = office
    poses = [list(problem.start), [1.2, 9.9, 0.0], [7.4, 9.9, 0.0]]
    through = {"commands": [["rotate", 1.5708], ["move", 6.2]], "path": poses, "length": 6.2}
    found = objections(problem, through)
    wall = next(number for number, each in enumerate(problem.obstacles) if getattr(each, "center", None) == (5.0, 8.8))
    assert any(text.startswith(f"segment 2 of the path hits obstacles[{wall}] by 0.1") for text in found), found
    assert solution["length"] > 15.0


def test_the_check_sees_bounds_a_turn_into_a_wall_and_a_way_through_a_circle():
    problem = problem_of(obstacles=[{"shape": "circle", "center": [1.0, 3.0], "radius": 0.5}], goal=[7.0, 1.0, 0.0])
    leaving = {"commands": [["move", 8.0]], "path": [[1, 1, 0], [9, 1, 0]], "length": 8.0}
    assert "segment 1 of the path leaves the bounds by 1.5 m" in objections(problem, leaving)
    hitting = {"commands": [["rotate", 1.5]], "path": [[1, 1, 0], [1, 1, 1.5]], "length": 0.0}
    assert not any("hits" in text for text in objections(problem, hitting))
    long = problem_of(
        robot={"vertices": [[-0.9, -0.1], [0.9, -0.1], [0.9, 0.1], [-0.9, 0.1]]},
        obstacles=[{"shape": "box", "center": [1.0, 1.7], "size": [0.4, 0.2]}],
    )
    assert any("segment 1 of the path hits obstacles[0]" in text for text in objections(long, hitting))
    driving = {
        "commands": [["rotate", np.pi / 2], ["move", 4.0]],
        "path": [[1, 1, 0], [1, 1, np.pi / 2], [1, 5, np.pi / 2]],
        "length": 4.0,
    }
    disc = problem_of(robot={"radius": 0.25}, obstacles=[{"shape": "circle", "center": [1.0, 3.0], "radius": 0.5}])
    assert "segment 2 of the path hits obstacles[0] by 0.75 m" in objections(disc, driving)


def test_the_check_bears_with_a_micrometre():
    for over, feasible in ((5e-7, True), (5e-6, False)):
        ceiling = {"shape": "box", "center": [4.0, 1.8 - over], "size": [2.0, 1.0]}
        problem = problem_of(goal=[7.0, 1.0, 0.0], obstacles=[ceiling])
        straight = {"commands": [["move", 6.0]], "path": [[1, 1, 0], [7, 1, 0]], "length": 6.0}
        assert problem.check(straight).feasible is feasible


def test_corrupted_solutions_are_rejected(office):
    problem, solution = office
    assert problem.check(solution).feasible

    def objected(change):
        broken = json.loads(json.dumps(solution))
        change(broken)
        return bool(problem.check(broken).objections)

    def stop_early(broken):
        del broken["path"][-2:], broken["commands"][-2:]

    assert objected(lambda broken: broken.update(length=broken["length"] + 0.01))
    assert objected(lambda broken: broken["path"][0].__setitem__(0, 1.3))
    assert objected(lambda broken: broken["commands"][0].__setitem__(1, 3.0))
    assert objected(lambda broken: broken["commands"][0].__setitem__(0, "move"))
    assert objected(stop_early)
    for row, column in ((1, 2), (2, 0), (3, 1)):
        assert objected(lambda broken, row=row, column=column: broken["path"][row].__setitem__(column, 5.0))


def test_a_path_that_ends_short_is_worth_its_distance(office):
    problem, solution = office
    short = {name: solution[name][:1] if name == "path" else [] for name in ("path", "commands")} | {"length": 0.0}
    verdict = problem.model_copy(update={"guide": "straight"}).check(short)
    away = np.hypot(1.2 - 7.4, 9.9 - 8.4)
    heading = abs(np.angle(np.exp(1j * (3.1416 + 1.5708))))
    assert verdict.fitness == pytest.approx(away + problem.robot.circumscribed_radius * heading)
    assert verdict.objections == (f"the path ends {away:.3g} m from the goal",)


@pytest.mark.parametrize(
    "change",
    [
        {"path": [[0, 0]]},
        {"path": []},
        {"commands": [["jump", 1.0]]},
        {"commands": "rotate"},
        {"length": -1.0},
        {"length": None},
        {"more": 1},
        {"path": [[float("nan"), 0.0, 0.0]]},
    ],
)
def test_what_is_no_solution_is_refused_in_one_line(change):
    valid = {"commands": [], "path": [[1.0, 1.0, 0.0]], "length": 0.0}
    with pytest.raises(BadInput) as error:
        problem_of().check(valid | change)
    assert len(str(error.value).splitlines()) == 1
    assert str(error.value).startswith("solution: ")


# Oracle ---------------------------------------------------------------------------------------------------------------
def agreed(problem, answer):
    """The answer's solution, which the judge accepts."""
    solution = json.loads(json.dumps(answer.solution))
    assert problem.check(solution).objections == ()
    assert solution["length"] == pytest.approx(answer.figures["shortest_length_at_most"])
    return solution


def test_where_nothing_is_in_the_way_the_shortest_way_is_straight():
    problem = problem_of(obstacles=[], robot={"radius": 0.3})
    answer = problem.oracle()
    assert (answer.meaning, answer.fitness) == ("optimum", 0.0)
    assert answer.figures == pytest.approx({"shortest_length_at_least": 6.0, "shortest_length_at_most": 6.0})
    assert len(agreed(problem, answer)["commands"]) == 3


def test_the_shortest_way_over_a_wall_is_two_tangents_and_two_arcs():
    problem = problem_of(robot={"radius": 0.3}, start=[1.0, 1.0, 0.0], goal=[7.0, 1.0, 0.0])
    away = np.hypot(2.9, 3.0)
    climb = np.arctan2(3.0, 2.9) + np.arcsin(0.3 / away)
    exact = 2 * (np.sqrt(away**2 - 0.3**2) + 0.3 * climb) + 0.2
    answer = problem.oracle()
    agreed(problem, answer)
    assert answer.figures["shortest_length_at_least"] < exact < answer.figures["shortest_length_at_most"]
    assert answer.figures["shortest_length_at_most"] - answer.figures["shortest_length_at_least"] < 2e-3


@pytest.mark.parametrize("number", range(12))
def test_the_shortest_way_is_that_of_brute_force(number):
    """Over all pairs of corners, whether they are tangent or not."""
    generator = np.random.default_rng(number)
    solids = [shapely.MultiPoint(generator.uniform(0, 4, 2) + generator.uniform(0, 1.6, (4, 2))) for _ in range(7)]
    free = shapely.box(0, 0, 5, 5).difference(shapely.union_all([each.convex_hull for each in solids]))
    start, goal = (0.0, 0.0), (5.0, 5.0)
    whole = shapely.get_parts(free)[[part.covers(shapely.Point(start)) for part in shapely.get_parts(free)]][0]
    places = np.concatenate([[start, goal], shapely.get_coordinates(whole)])
    one, other = np.triu_indices(len(places), 1)
    seen = shapely.covers(whole, shapely.linestrings(np.stack([places[one], places[other]], axis=1)))
    lengths = np.full((len(places), len(places)), np.inf)
    lengths[one[seen], other[seen]] = np.linalg.norm(places[one] - places[other], axis=1)[seen]
    lengths = np.minimum(lengths, lengths.T)
    for through in range(len(places)):
        lengths = np.minimum(lengths, lengths[:, through, None] + lengths[through])
    way = shortest_way(free, start, goal)
    if np.isinf(lengths[0, 1]):
        assert way is None
    else:
        assert np.linalg.norm(np.diff(way, axis=0), axis=1).sum() == pytest.approx(lengths[0, 1])


@pytest.mark.parametrize("number", range(5))
def test_grown_obstacles_enclose_the_true_ones_or_are_enclosed(number):
    generator = np.random.default_rng(number)
    radius = float(generator.uniform(0.1, 1.0))
    bearings = np.sort(generator.uniform(0, 2 * np.pi, 9))
    corners = generator.uniform(0.5, 1.0, (9, 1)) * np.column_stack([np.cos(bearings), np.sin(bearings)])
    star, disc = shapely.Polygon(corners), shapely.Point(1.0, 2.0)
    for fields, core, extent in (
        ({"shape": "polygon", "vertices": corners.tolist()}, star, radius),
        ({"shape": "circle", "center": [1.0, 2.0], "radius": 0.7}, disc, radius + 0.7),
    ):
        (obstacle,) = problem_of(start=[5, 5, 0], goal=[7, 5, 0], robot={"radius": 0.1}, obstacles=[fields]).obstacles
        larger, smaller = (grown(obstacle, radius, surely) for surely in (True, False))
        assert larger.exterior.distance(core) >= extent - 1e-12
        assert shapely.distance(shapely.points(smaller.exterior.coords), core).max() <= extent
        assert larger.area / smaller.area < 1.01


def test_who_cannot_turn_where_it_stands_has_no_way_to_its_other_heading():
    lane = [WALL | {"center": [4.0, y], "size": [8.0, 2.0]} for y in (1.7, 4.3)]
    answer = problem_of(robot=BEAM, obstacles=lane, start=[4.0, 3.0, 0.0], goal=[4.0, 3.0, np.pi]).oracle()
    assert answer.method == "120 slices of the headings: the goal is out of reach"
    most = np.arcsin(0.6 / np.hypot(1.8, 0.3)) - np.arctan2(0.3, 1.8)  # that it turns in a lane of 0.6 m
    exact = np.hypot(0.9, 0.15) * (np.pi - most)
    assert 0.9 * exact < answer.fitness < exact


@pytest.mark.parametrize("robot", [{"vertices": HOOK}, {"radius": 0.3}], ids=["concave", "disc"])
def test_the_oracle_never_denies_a_way_and_none_is_shorter_than_it_says(robot):
    told = 0
    for number in range(6):
        problem = crowded(number, robot=robot)
        answer = problem.oracle()
        genomes = genomes_of(problem, 200)
        fitness = problem.evaluate(genomes)
        assert answer.fitness <= fitness.min()
        if answer.solution is not None:
            agreed(problem, answer)
        for genome in genomes[fitness == 0.0]:
            assert problem.decode(genome)["length"] >= answer.figures["shortest_length_at_least"] - 1e-9
        told += answer.meaning == "optimum" or answer.fitness > 0.0
    assert told > 3


@pytest.mark.parametrize("robot", [{"vertices": HOOK}, {"radius": 0.3}], ids=["concave", "disc"])
def test_behind_a_closed_wall_the_oracle_says_how_near_the_robot_gets(robot):
    closed = WALL | {"center": [4.0, 3.0], "size": [0.2, 6.0]}
    problem = problem_of(robot=robot, obstacles=[closed])
    answer = problem.oracle()
    assert (answer.meaning, answer.solution) == ("lower bound", None)
    assert answer.method.endswith("the goal is out of reach")
    assert 3.1 < answer.fitness < 3.7
    assert problem.evaluate(genomes_of(problem, 500)).min() >= answer.fitness


BEAM = {"vertices": [[-0.9, -0.15], [0.9, -0.15], [0.9, 0.15], [-0.9, 0.15]]}


def door(width):
    walls = [WALL | {"center": [4.0, side * (3.0 + width / 2) + 3.0], "size": [0.2, 6.0]} for side in (-1, 1)]
    return problem_of(robot=BEAM, obstacles=walls, start=[1.5, 3.0, 1.5708], goal=[6.5, 3.0, 1.5708])


def test_a_beam_gets_through_a_door_lengthwise():
    answer = door(0.4).oracle()
    assert (answer.meaning, answer.fitness) == ("optimum", 0.0)
    assert answer.method.startswith("turns and drives")
    assert answer.figures == pytest.approx({"shortest_length_at_least": 5.0, "shortest_length_at_most": 5.0})
    agreed(door(0.4), answer)
    assert simulate(Plan(door(0.4).for_recipe("tuned", 1), Run()))[0].champion.fitness == 0.0


def test_a_beam_does_not_get_around_a_narrow_corner():
    """A ladder gets around a corner of corridors a and b wide if it is no longer than (a^⅔ + b^⅔)^1.5."""
    slit = [WALL | {"center": [4.0, y], "size": [2.0, 2.8]} for y in (1.4, 4.6)]
    behind = WALL | {"center": [5.7, 3.5], "size": [0.2, 5.0]}
    fields = {"robot": BEAM, "obstacles": [*slit, behind], "start": [1.5, 3.0, 1.5708], "goal": [7.0, 3.0, 1.5708]}
    answer = problem_of(**fields).oracle()
    assert answer.method == "120 slices of the headings: the goal is out of reach"
    assert 3.0 < answer.fitness <= problem_of(**fields).evaluate(genomes_of(problem_of(**fields), 2000)).min()
    short = {"vertices": [[-0.3, -0.15], [0.3, -0.15], [0.3, 0.15], [-0.3, 0.15]]}
    assert problem_of(**fields | {"robot": short}).oracle().meaning == "optimum"


def niche(width, **fields):
    """The beam is to stand across in a niche that it can only be slid into, or lengthwise, where it backs out."""
    walls = [WALL | {"center": [4.0 + side * (2.0 + width / 2), 1.0], "size": [4.0, 2.0]} for side in (-1, 1)]
    return problem_of(robot=BEAM, obstacles=walls, start=[2.0, 4.0, 0.0], **fields)


def test_a_way_that_only_sliding_would_make_is_not_called_one():
    answer = niche(1.82, goal=[4.0, 0.5, 0.0]).oracle()
    assert (answer.meaning, answer.fitness, answer.solution) == ("lower bound", 0.0, None)
    assert answer.method.endswith("cannot tell whether the robot gets through")
    assert "shortest_length_at_most" not in answer.figures


@pytest.mark.parametrize("heading", [-np.pi / 2, np.pi / 2])
def test_whoever_only_drives_ahead_enters_a_niche_by_its_front(heading):
    """It cannot turn in the niche, and does not drive backwards into it."""
    problem = niche(0.4, goal=[4.0, 1.2, heading])
    answer = problem.oracle()
    assert (answer.solution is not None) == (heading < 0.0)
    if answer.solution is not None:
        solution = agreed(problem, answer)
        assert solution["commands"][-2][0] == "move"
        assert solution["length"] < 1.01 * (2.0 + 2.8)


def test_whoever_stands_in_a_niche_leaves_it_ahead():
    for heading, leaves in ((np.pi / 2, True), (-np.pi / 2, False)):
        problem = niche(0.4, goal=[6.0, 4.0, 0.0]).model_copy(update={"start": (4.0, 1.2, heading)})
        assert (problem.oracle().solution is not None) == leaves


def test_ways_through_gaps_that_the_enclosing_disc_does_not_fit_through_are_proven():
    answers = [(problem, problem.oracle()) for problem in (narrow_door_world(number).problem() for number in (2, 6))]
    for problem, answer in answers:
        agreed(problem, answer)
    assert any(answer.method.startswith("turns and drives") for _, answer in answers)


@pytest.mark.parametrize("robot", [{"vertices": HOOK}, {"radius": 0.3}], ids=["concave", "disc"])
def test_who_starts_at_the_goal_only_turns(robot):
    problem = problem_of(robot=robot, goal=[1.0, 1.0, 2.0])
    answer = problem.oracle()
    assert (answer.meaning, answer.fitness) == ("optimum", 0.0)
    assert agreed(problem, answer)["commands"] == [["rotate", pytest.approx(2.0)]]


# Problem files --------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"start": [4.0, 2.0, 0.0]}, "start: expected a place where the robot stands free, found"),
        ({"start": [0.1, 1.0, 0.0]}, "start: .* outside the bounds"),
        ({"goal": [4.1, 1.0, 1.0]}, r"goal: .* in obstacles\[0\]"),
        ({"goal": [9.0, 1.0, 1.0]}, "goal: .* outside the bounds"),
        ({"bounds": [8.0, 0.0, 0.0, 6.0]}, "bounds: expected x0 < x1"),
        ({"robot": {}}, "robot: expected either vertices or radius, found neither"),
        ({"robot": {"vertices": HOOK, "radius": 0.3}}, "robot: expected either vertices or radius, found both"),
        ({"robot": {"vertices": [[0, 0], [1, 1], [1, 0], [0, 1]]}}, "robot.vertices: expected a simple polygon"),
        ({"robot": {"vertices": [[0, 0], [1, 0]]}}, "robot.vertices: expected at least 3 vertices, found 2"),
        (
            {"robot": {"vertices": [[0, 0], [1, 0], [1, 1e-7], [0, 1e-7]]}},
            "robot.vertices: expected a polygon at least",
        ),
        ({"robot": {"radius": 0.0}}, "robot.radius: "),
        ({"bits": 63}, "bits: "),
        ({"bits": 0}, "bits: "),
        ({"commands": 0}, "commands: "),
        ({"start": [float("nan"), 1.0, 0.0]}, "start"),
        ({"goal": [7.0, float("inf"), 0.0]}, "goal"),
        ({"code": "grey"}, "code: "),
        ({"goals": [1, 2, 3]}, "goals: unknown field"),
        ({"obstacles": [{"shape": "box"}]}, "obstacles"),
    ],
)
def test_bad_files_are_refused_in_one_line_that_names_the_field(fields, expected):
    with pytest.raises(BadInput, match=expected) as error:
        problem_of(**fields)
    assert len(str(error.value).splitlines()) == 1
    assert str(error.value).startswith("robot.toml: ")


def test_the_robot_may_touch_where_it_starts():
    assert problem_of(start=[3.4, 1.0, 0.0], goal=[7.5, 0.3, 0.0]).check(
        {"commands": [], "path": [[3.4, 1.0, 0.0]], "length": 0.0}
    )


def test_the_paper_codes_in_binary_and_the_tuned_recipe_in_gray_unless_the_file_chooses():
    file, fields = robot_file()
    problem = MobileRobot.model_validate(fields)
    assert problem.for_recipe("paper", 1).coding.gray is False
    assert problem.for_recipe("tuned", 1).coding.gray is True
    assert MobileRobot.model_validate(fields | {"code": "binary"}).for_recipe("tuned", 1).coding.gray is False
    assert file.kind == "mobile-robot"


def test_recipes():
    problem = problem_of()
    assert problem.recipe("paper", 1) == Recipe("one-point", 1 / 128, "offspring")
    assert problem.recipe("tuned", 1) == Recipe("one-point", 12 / 128, "elitist")
    assert problem.recipe("tuned", 20) == Recipe("uniform", 16 / 128, "elitist")


def test_reading_a_file_loads_no_compiled_code():
    code = f"import sys; from problems import load; load({str(EXAMPLE)!r}); print('numba' in sys.modules)"
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=EXAMPLE.parents[1]
    )
    assert ran.stdout.strip() == "False"


# The example ----------------------------------------------------------------------------------------------------------
def test_the_office_is_solved_and_the_path_is_free(office):
    problem, solution = office
    verdict = problem.check(solution)
    assert (verdict.fitness, verdict.objections) == (0.0, ())
    assert all(len(pose) == 3 for pose in solution["path"])


@pytest.mark.parametrize(("topology", "seeds", "least"), [("torus 4x4", 10, 9), ("torus 8x16", 3, 3)])
def test_the_office_is_solved_from_nearly_any_seed(topology, seeds, least):
    file = load(EXAMPLE).with_run(topology=topology)
    runs = (Plan.of(file.with_run(seed=seed)) for seed in range(1, seeds + 1))
    assert sum(best_known(simulate(plan), "champion").fitness == 0.0 for plan in runs) >= least


CELL = 0.1  # m


def _free_cells(problem, radius):
    """Cells in whose middle a disc stands free; (columns, rows)."""
    x0, y0, x1, y1 = problem.bounds
    x, y = np.meshgrid(np.arange(x0 + CELL / 2, x1, CELL), np.arange(y0 + CELL / 2, y1, CELL), indexing="ij")
    solids = [
        shapely.Point(each.center).buffer(each.radius) if isinstance(each, Circle) else each.polygon
        for each in problem.obstacles
    ]
    clearance = shapely.distance(shapely.points(x, y), shapely.union_all(solids))
    return np.minimum(clearance, np.minimum(np.minimum(x - x0, x1 - x), np.minimum(y - y0, y1 - y))) >= radius


def _reachable_monotonically(free, start):
    """Cells that a path from ``start`` reaches whose column never decreases, by flooding column after column."""
    reached = np.zeros_like(free)
    reached[start] = True
    for column in range(start[0], len(free)):
        if column > start[0]:
            reached[column] = ndimage.binary_dilation(reached[column - 1], iterations=1) & free[column]
        reached[column] = ndimage.binary_propagation(reached[column], mask=free[column])
    return reached


def test_no_path_of_the_office_is_monotone_in_x_or_in_y_but_there_are_paths():
    """A disc inside the robot, smaller by a cell's diagonal, gets no farther than the robot could at best."""
    problem = load(EXAMPLE).problem()
    small = 0.3 - CELL
    start, goal = (tuple(int(value / CELL) for value in pose[:2]) for pose in (problem.start, problem.goal))
    free = _free_cells(problem, small)
    assert free[start]
    assert free[goal]
    for grid, first, last in (
        (free, start, goal),
        (free[::-1], (len(free) - 1 - start[0], start[1]), (len(free) - 1 - goal[0], goal[1])),
        (free.T, start[::-1], goal[::-1]),
        (free.T[::-1], (free.shape[1] - 1 - start[1], start[0]), (free.shape[1] - 1 - goal[1], goal[0])),
    ):
        assert not _reachable_monotonically(grid, first)[last]
    regions, _ = ndimage.label(_free_cells(problem, problem.robot.circumscribed_radius))
    assert regions[start] == regions[goal] > 0


def test_an_unsolvable_floor_ends_as_stalled_with_the_best_found():
    closed = WALL | {"center": [4.0, 3.0], "size": [0.2, 6.0]}
    plan = Plan(problem_of(robot={"radius": 0.3}, obstacles=[closed], guide="straight"), Run(stall=30))
    reports = simulate(plan)
    assert stop_reasons(reports, "lockstep") == ("stall",)
    champion = best_known(reports, "champion")
    assert plan.problem.oracle().fitness <= champion.fitness < 4.0
    (objection,) = plan.problem.check(plan.problem.decode(np.frombuffer(champion.genome, np.uint8))).objections
    assert objection.startswith("the path ends")


def test_the_template_is_solved():
    plan = Plan.of(parse(MobileRobot.template, "template.toml", Path()))
    champion = best_known(simulate(plan), "champion")
    assert champion.fitness == 0.0


# Pictures -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("robot", [{"vertices": HOOK}, {"radius": 0.3}], ids=["polygon", "disc"])
def test_a_picture_shows_the_whole_floor_and_the_path(robot, tmp_path):
    problem = problem_of(robot=robot)
    genomes = genomes_of(problem, 16)
    solution = problem.decode(genomes[0])
    figure = Figure()
    problem.draw(figure, solution, {0: genomes, 7: genomes[:4]})
    figure.savefig(tmp_path / "floor.png")
    (axes,) = figure.axes
    line = axes.lines[2]  # after the ends of two generations
    np.testing.assert_allclose(np.column_stack(line.get_data()), np.array(solution["path"])[:, :2])
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    assert max(left, low) < 0.0
    assert right > 8.0
    assert high > 6.0
    assert all(name in [text.get_text() for text in axes.texts] for name in ("start", "goal"))


def test_consecutive_rows_of_a_path_differ_by_one_command(office):
    _, solution = office
    for (name, value), (pose, following) in zip(solution["commands"], pairwise(solution["path"]), strict=True):
        step = np.subtract(following, pose)
        if name == "rotate":
            np.testing.assert_allclose(step, [0.0, 0.0, value], atol=1e-9)
        else:
            expected = [value * np.cos(pose[2]), value * np.sin(pose[2]), 0.0]
            np.testing.assert_allclose(step, expected, atol=1e-9)
