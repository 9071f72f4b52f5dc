"""The terrain planner: its file, its paths, its operators, its judge, its oracle, the paper's figures, replanning."""

import json
import os
from itertools import pairwise
from math import sqrt
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from benchmarks.terrain_worlds import terrain_world, with_obstacles_on
from genetics import Keys, Recipe
from node.plan import Plan
from node.simulation import simulate
from problems import BadInput, Run, load
from problems.file import parse
from problems.terrain import Terrain, movingai
from problems.terrain.replanning import led_on
from problems.terrain.solution import EIGHTH
from spy.past import best_known

ROOT = Path(__file__).resolve().parents[2]
MOVINGAI = Path(os.environ.get("MOVINGAI", ROOT.parent / "shared" / "data" / "movingai"))

ROOMS = [  # figure 1: two rooms beside each other, their doors far apart
    "................",
    "................",
    "................",
    "#.############.#",
    *["#......##......#"] * 11,
    "######.##.######",
]
WALL = [  # two gaps in a wall
    *["................"] * 8,
    "######.##.######",
    *["................"] * 7,
]


def terrain(**fields):
    base = {"kind": "terrain", "start": (0, 0), "goal": (3, 3), "map": ["...."] * 4}
    return Terrain.model_validate(base | fields)


def solved(problem, **run):
    """The best solution and its fitness."""
    plan = Plan(problem.for_recipe("tuned", 1), Run(**run))
    best = best_known(simulate(plan), "champion")
    return plan.problem.decode(np.frombuffer(best.genome, np.uint8)), best.fitness


def genome(problem, *blocks):
    """Of a heading and (turn, length) blocks."""
    bits = problem.coding.bits
    return problem.coding.encode([blocks[0], *((turn << bits) | length for turn, length in blocks[1:])])


def fitness(problem, *blocks):
    return problem.evaluate(genome(problem, *blocks)[None])[0]


def with_patch(rows, top, left, bottom, right, character):
    patched = [list(row) for row in rows]
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            patched[row][column] = character if patched[row][column] == "." else patched[row][column]
    return ["".join(row) for row in patched]


# Blocks and paths (§3.1) ----------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("rows", "columns", "bits"), [(1, 2, 1), (2, 2, 1), (16, 9, 4), (9, 17, 5), (3, 256, 8)])
def test_a_block_has_2_and_log2_n_bits(rows, columns, bits):
    problem = terrain(map=["." * columns] * rows, goal=(0, 1))
    assert problem.coding.genes == ((0, (4 << bits) - 1),)


def test_turns_are_relative_and_the_first_block_only_sets_the_heading():
    problem = terrain(map=["......"] * 6, start=(3, 2), goal=(0, 0))
    path = problem.decode(genome(problem, 0, (0b00, 1), (0b01, 1), (0b01, 1), (0b11, 1), (0b10, 2)))["path"]
    assert path == [[3, 2], [3, 3], [2, 4], [1, 4], [0, 4], [-1, 5], [-2, 6]]
    for heading, step in enumerate([(0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0), (1, 1)]):
        solution = problem.decode(genome(problem, heading + 8, (0, 1)))
        assert solution["path"] == [[3, 2], [3 + step[0], 2 + step[1]]]
        assert solution["moves"] == [[heading * EIGHTH, 1]]


def test_a_block_of_no_length_turns_on_the_spot():
    problem = terrain(goal=(0, 3), start=(3, 0))
    solution = problem.decode(genome(problem, 0, (0, 3), (1, 0), (1, 3)))
    assert solution["moves"] == [[0.0, 3], [2 * EIGHTH, 3]]
    assert fitness(problem, 0, (0, 3), (1, 0), (1, 3)) == solution["cost"] == 6.0


def test_the_path_is_cut_where_it_first_reaches_the_goal():
    problem = terrain(goal=(0, 2))
    assert problem.decode(genome(problem, 0, (0, 3), (1, 3)))["path"] == [[0, 0], [0, 1], [0, 2]]
    assert fitness(problem, 0, (0, 3), (1, 3)) == 2.0


def test_start_is_goal():
    problem = terrain(start=(2, 1), goal=(2, 1))
    solution, cost = solved(problem, stall=3)
    assert (solution, cost) == ({"path": [[2, 1]], "cost": 0.0, "moves": []}, 0.0)
    assert problem.check(solution).feasible
    assert problem.oracle().fitness == 0.0


# Fitness (§3.4) -------------------------------------------------------------------------------------------------------
def test_a_clear_path_costs_distance_times_the_difficulty_of_the_cell_entered():
    problem = terrain(map=["dm..", ".e..", "....", "...."], terrain={"d": "difficult", "m": "moderate", "e": "easy"})
    expected = sqrt(2) * 1.25 + sqrt(2) * 2
    assert fitness(problem, 7, (0, 3)) == pytest.approx(expected)
    expected = (1.25 + 1.5 + 2.0) / 3 + 2 + 3 * 1.0
    assert fitness(problem, 0, (0, 3), (2, 0), (2, 3)) == pytest.approx(expected)


@pytest.mark.parametrize(("rank", "cost"), [("centroid", 4.75 / 3), ("pessimistic", 2.0), ("optimistic", 1.25)])
def test_triangles_are_ranked(rank, cost):
    problem = terrain(map=[".m"], goal=(0, 1), terrain={"m": "moderate"}, rank=rank)
    assert fitness(problem, 0, (0, 1)) == pytest.approx(cost)
    assert problem.oracle().fitness == pytest.approx(cost)


def test_what_is_not_clear_or_not_at_the_goal_is_worse_than_anything_clear():
    problem = terrain(map=["....", ".##.", "....", "...d"], terrain={"d": "difficult"})
    dearest = sqrt(2) * 16 * 3.0
    assert fitness(problem, 7, (0, 3)) == pytest.approx(dearest * 2)
    assert fitness(problem, 0, (0, 2)) == pytest.approx(dearest + np.hypot(3, 1))
    assert fitness(problem, 2, (0, 2)) == pytest.approx(dearest * 3 + np.hypot(5, 3))


def test_a_cut_corner_is_a_cell_that_cannot_be_entered():
    rows = [".#", ".."]
    assert fitness(terrain(map=rows, goal=(1, 1)), 7, (0, 1)) == pytest.approx(sqrt(2))
    assert fitness(terrain(map=rows, goal=(1, 1), corner_cutting=False), 7, (0, 1)) == pytest.approx(sqrt(2) * 4 * 2)


def test_difficulty_by_heading():
    hill = {"uphill": "N", "up": (3.0, 3.0, 3.0), "across": (2.0, 2.0, 2.0), "down": (1.0, 1.0, 1.0)}
    fields = {"map": ["hhh"] * 3, "terrain": {"h": "hill"}, "difficulty": {"hill": hill}, "start": (1, 1)}
    expected = [2.0, 3 * sqrt(2), 3.0, 3 * sqrt(2), 2.0, sqrt(2), 1.0, sqrt(2)]
    for heading, step in enumerate([(0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0), (1, 1)]):
        problem = terrain(goal=(1 + step[0], 1 + step[1]), **fields)
        assert fitness(problem, heading, (0, 1)) == pytest.approx(expected[heading])
        solution = problem.decode(genome(problem, heading, (0, 1)))
        assert problem.check(solution).fitness == pytest.approx(expected[heading])


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.8, 1.5, 1.6, 2.2, 3.0])
def test_a_robot_keeps_its_radius_away_from_obstacles(radius):
    generator = np.random.default_rng(3)
    blocked = generator.random((20, 14)) < 0.03
    blocked[0, 0] = blocked[19, 13] = False
    rows = ["".join(".#"[cell] for cell in row) for row in blocked.astype(int)]
    expected = blocked.copy()
    for row, column in np.ndindex(blocked.shape):
        for other_row, other_column in np.argwhere(blocked):
            gap = np.hypot(max(abs(row - other_row) - 0.5, 0), max(abs(column - other_column) - 0.5, 0))
            expected[row, column] |= gap < radius
    free = [tuple(int(each) for each in place) for place in np.argwhere(~expected)]
    problem = terrain(map=rows, start=free[0], goal=free[-1], robot_radius=radius)
    np.testing.assert_array_equal(problem.impassable, expected)
    np.testing.assert_array_equal(problem.coding.world[2] < 0, expected)


# The judge ------------------------------------------------------------------------------------------------------------
worlds = st.builds(terrain_world, st.integers(0, 50), st.sampled_from([8, 16, 23]))


@settings(max_examples=40)
@given(problem=worlds, founders=st.sampled_from(["random", "lines"]), seed=st.integers(0, 2**64 - 1))
def test_fitness_and_check_agree_on_any_path(problem, founders, seed):
    problem = problem.model_copy(update={"founders": founders})
    genomes = problem.coding.random(Keys(np.arange(2), np.uint64(seed), 0), 4).reshape(8, -1)
    for each, value in zip(genomes, problem.evaluate(genomes), strict=True):
        solution = json.loads(json.dumps(problem.decode(each)))
        verdict = problem.check(solution)
        assert verdict.fitness == pytest.approx(value, rel=1e-9)
        assert verdict.feasible == (value == solution["cost"])


def test_a_wrong_solution_is_objected_to():
    problem = terrain(map=["....", ".#..", "....", "...."], corner_cutting=False)
    right = problem.oracle().solution
    assert problem.check(right).feasible
    path = [[0, 0], [1, 1], [2, 2], [3, 3]]
    wrong = {
        "is impassable": {"path": path},
        "cuts a corner": {"path": [[0, 0], [0, 1], [1, 2], [2, 3], [3, 3]]},
        "is off the map": {"path": [[0, 0], [-1, 0], [0, 1]]},
        "no neighbouring cell": {"path": [[0, 0], [0, 2], [3, 3]]},
        "starts at": {"path": right["path"][1:]},
        "cells from the goal": {"path": right["path"][:-1]},
        "costs": {"cost": right["cost"] + 0.01},
        "no multiple": {"moves": [[0.1, 3], *right["moves"][1:]]},
        "not go where": {"moves": right["moves"][:-1]},
    }
    for words, change in wrong.items():
        assert any(words in each for each in problem.check(right | change).objections), words
    with pytest.raises(BadInput, match=r"solution: path.*1000000000"):
        problem.check(right | {"path": [[0, 0], [10**400, 1]]})


# The oracle -----------------------------------------------------------------------------------------------------------
def brute_force(problem):
    """Over all simple paths, by the judge's word."""
    best = np.inf

    def go_on(path):
        nonlocal best
        if path[-1] == list(problem.goal):
            best = min(best, problem.check({"path": path, "cost": 0.0, "moves": []}).fitness)
            return
        for row in range(path[-1][0] - 1, path[-1][0] + 2):
            for column in range(path[-1][1] - 1, path[-1][1] + 2):
                inside = 0 <= row < len(problem.map) and 0 <= column < len(problem.map[0])
                if inside and problem.map[row][column] != "#" and [row, column] not in path:
                    go_on([*path, [row, column]])

    go_on([list(problem.start)])
    return best


@pytest.mark.parametrize("number", range(12))
def test_the_oracle_agrees_with_brute_force(number):
    generator = np.random.default_rng(number)
    hill = {"uphill": "SE", "up": (2.0, 2.0, 5.0), "across": (1.5, 1.5, 2.0), "down": (0.5, 1.0, 1.0)}
    rows = generator.choice(list(".#mh"), (3, 4), p=[0.3, 0.25, 0.25, 0.2])
    rows[0, 0] = rows[2, 3] = "."
    problem = terrain(
        map=["".join(row) for row in rows],
        goal=(2, 3),
        terrain={"m": "moderate", "h": "hill"},
        difficulty={"hill": hill},
        corner_cutting=number % 2 == 0,
        rank=["centroid", "pessimistic", "optimistic"][number % 3],
    )
    answer, best = problem.oracle(), brute_force(problem)
    if answer.fitness == np.inf:
        assert best > checkers_penalty(problem)
        return
    assert answer.fitness == pytest.approx(best)
    verdict = problem.check(json.loads(json.dumps(answer.solution)))
    assert (verdict.objections, verdict.fitness) == ((), pytest.approx(best))


def checkers_penalty(problem):
    return sqrt(2) * max(len(problem.map), len(problem.map[0])) ** 2


@pytest.mark.skipif(not MOVINGAI.is_dir(), reason="the MovingAI maps are not here")
@pytest.mark.parametrize("name", ["Denver_0_256", "maze-32-32-4", "random-32-32-20", "room-32-32-4"])
def test_the_oracle_finds_the_optima_of_the_movingai_scenarios(name):
    rows = movingai.read(MOVINGAI / f"{name}.map")
    lines = (MOVINGAI / f"{name}.map.scen").read_text().splitlines()[1:]
    for line in lines[:: max(1, len(lines) // 60)]:
        *_, column, row, goal_column, goal_row, optimum = line.split()
        problem = terrain(
            map=rows, start=(int(row), int(column)), goal=(int(goal_row), int(goal_column)), corner_cutting=False
        )
        answer = problem.oracle()
        assert answer.fitness == pytest.approx(float(optimum), abs=1e-6)
        assert problem.check(answer.solution).feasible


# Operators ------------------------------------------------------------------------------------------------------------
def couples_of(problem, seed, founders):
    coding = problem.model_copy(update={"founders": founders}).coding
    return coding, coding.random(Keys(np.arange(3), np.uint64(seed), 0), 8).reshape(3, 4, 2, -1)


@settings(max_examples=40)
@given(
    problem=worlds,
    founders=st.sampled_from(["random", "lines"]),
    crossover=st.sampled_from(["one-point", "merge"]),
    mutation=st.floats(0, 1),
    seed=st.integers(0, 2**64 - 1),
)
def test_offspring_are_sound(problem, founders, crossover, mutation, seed):
    coding, couples = couples_of(problem, seed, founders)
    offspring = coding.recombine(couples, Recipe(crossover, mutation), Keys(np.arange(3), np.uint64(seed), 1))
    assert all(coding.alphabet.admits(each) for each in couples.reshape(24, -1))
    assert all(coding.alphabet.admits(each) for each in offspring.reshape(24, -1))


@settings(max_examples=40)
@given(problem=worlds, mutation=st.floats(0, 1), seed=st.integers(0, 2**64 - 1))
def test_merged_offspring_are_as_good_as_both_parents(problem, mutation, seed):
    coding, couples = couples_of(problem, seed, "lines")
    offspring = coding.recombine(couples, Recipe("merge", mutation), Keys(np.arange(3), np.uint64(seed), 1))
    parents = problem.evaluate(couples.reshape(24, -1)).reshape(12, 2).min(axis=1)
    children = problem.evaluate(offspring.reshape(24, -1)).reshape(12, 2)
    assert np.all(children <= parents[:, None] + 1e-3)


@settings(max_examples=40)
@given(problem=worlds, seed=st.integers(0, 2**64 - 1))
def test_one_point_crossover_cuts_both_parents_at_the_same_bit(problem, seed):
    coding, couples = couples_of(problem, seed, "random")
    offspring = coding.recombine(couples, Recipe("one-point", 0.0), Keys(np.arange(3), np.uint64(seed), 1))
    for couple, children in zip(couples.reshape(12, 2, -1), offspring.reshape(12, 2, -1), strict=True):
        parents = [bits_of(coding, each) for each in couple]
        cuts = []
        for child, (head, tail) in zip(children, (parents, parents[::-1]), strict=True):
            bits = bits_of(coding, child)
            shorter = min(map(len, parents))
            cuts.append(
                {cut for cut in range(1, shorter) if bits == head[:cut] + tail[cut:]} | ({0} if bits == head else set())
            )
        assert cuts[0] & cuts[1]


def bits_of(coding, each):
    return "".join(f"{gene:0{2 + coding.bits}b}" for (gene,) in coding.items(each))


def test_four_fifths_of_couples_are_crossed_and_a_fiftieth_of_bits_change():
    coding, couples = couples_of(terrain_world(1, 16), 4, "random")
    many = np.tile(couples[:1, :1], (1, 4000, 1, 1))
    keys = Keys(np.array([3]), np.uint64(9), 5)
    crossed = coding.recombine(many, Recipe("one-point", 0.0), keys)[0, ::2]
    assert np.mean(np.any(crossed != couples[0, 0, 0], axis=1)) == pytest.approx(0.8, abs=0.05)
    twins = np.repeat(many[:, :, :1], 2, axis=2)
    changed = coding.recombine(twins, Recipe("one-point", 0.02), keys)[0]
    bits = coding.items(couples[0, 0, 0]).size * (2 + coding.bits)
    flips = np.unpackbits(changed ^ couples[0, 0, 0]).sum() / len(changed) / bits
    assert flips == pytest.approx(0.02, rel=0.1)


def test_the_first_population_holds_one_straight_line():
    problem = terrain(map=["." * 16] * 16, start=(14, 1), goal=(4, 15))
    for founders in ("random", "lines"):
        coding = problem.model_copy(update={"founders": founders}).coding
        first = coding.random(Keys(np.arange(4), np.uint64(1), 0), 10)[0, 0]
        path = np.array(problem.decode(first)["path"])
        assert problem.evaluate(first[None])[0] == pytest.approx(10 * sqrt(2) + 4)
        rows, columns = (path - path[0]).T
        off = np.abs(-10 * columns - 14 * rows) / np.hypot(10, 14)
        assert off.max() <= 0.5


@pytest.mark.parametrize("number", range(6))
def test_every_optimum_can_be_expressed(number):
    """Turns on the spot make any path of steps a sequence of blocks."""
    problem = terrain_world(number, 16)
    answer = problem.oracle()
    blocks, heading = [], None
    for towards, cells in ((round(angle / EIGHTH), cells) for angle, cells in answer.solution["moves"]):
        if heading is None:
            blocks.append(towards)
            turn = 0
        else:
            turn = (towards - heading + 4) % 8 - 4
        side = 1 if turn > 0 else 2
        blocks += [(side, 0)] * (abs(turn) - 1) + [(side if turn else 0, cells)]
        heading = towards
    assert fitness(problem, *blocks) == pytest.approx(answer.fitness)


# The paper's figures --------------------------------------------------------------------------------------------------
def test_figure_1_two_rooms_whose_path_is_monotone_in_neither_direction():
    problem = terrain(map=ROOMS, start=(13, 5), goal=(13, 10))
    solution, cost = solved(problem)
    assert cost == pytest.approx(problem.oracle().fitness)
    steps = np.diff(solution["path"], axis=0)
    assert all(np.any(steps[:, axis] > 0) and np.any(steps[:, axis] < 0) for axis in (0, 1))


def test_figures_7_to_10_difficulty_moves_the_path_when_it_must():
    fields = {"start": (14, 4), "goal": (2, 6), "terrain": {"m": "moderate", "d": "difficult"}}
    maps = {
        "clear": WALL,
        "moderate": with_patch(WALL, 7, 4, 9, 8, "m"),
        "difficult": with_patch(WALL, 7, 4, 9, 8, "d"),
        "larger moderate": with_patch(WALL, 4, 3, 13, 7, "m"),
    }
    problems = {name: terrain(map=rows, **fields) for name, rows in maps.items()}
    gaps = {}
    for name, problem in problems.items():
        solution, cost = solved(problem)
        assert cost == pytest.approx(problem.oracle().fitness), name
        (gaps[name],) = (column for row, column in solution["path"] if row == 8)
    assert gaps == {"clear": 6, "moderate": 6, "difficult": 9, "larger moderate": 9}
    clear = problems["clear"]
    unchanged = problems["moderate"].oracle().solution
    assert clear.check(unchanged).fitness == pytest.approx(clear.oracle().fitness), "it is still a shortest path"


# Runs -----------------------------------------------------------------------------------------------------------------
def test_what_cannot_be_reached_stalls_with_the_best_found():
    problem = terrain(map=["...#.."] * 6, start=(0, 0), goal=(5, 5))
    assert problem.oracle().fitness == np.inf
    solution, cost = solved(problem, stall=5)
    assert cost == pytest.approx(sqrt(2) * 36 * 2), "one step into the wall"
    assert not problem.check(solution).feasible


@pytest.mark.parametrize("recipe", ["tuned", "paper"])
def test_both_recipes_find_their_way_over_open_ground(recipe):
    problem = terrain(map=["." * 16] * 16, start=(14, 1), goal=(4, 15))
    plan = Plan(problem.for_recipe(recipe, 40), Run(recipe=recipe, topology="torus 1x1", deme=40, generations=20))
    assert best_known(simulate(plan), "champion").fitness == pytest.approx(10 * sqrt(2) + 4)


@pytest.mark.parametrize("blocks", [1, 2, 5])
def test_few_blocks_are_enough_for_no_long_path_but_hurt_nothing(blocks):
    problem = terrain_world(1, 16).model_copy(update={"blocks": blocks})
    solution, _ = solved(problem, stall=5)
    assert len(solution["moves"]) < blocks


def test_maps_of_one_row_and_of_one_cell():
    assert solved(terrain(map=["......"], goal=(0, 5)), stall=3)[1] == 5.0
    assert solved(terrain(map=["."], goal=(0, 0)), stall=3)[1] == 0.0


def test_a_living_population_is_led_on_in_a_changed_world():
    old = terrain_world(4, 32).for_recipe("tuned", 1)
    plan = Plan(old, Run(stall=30))
    reports = simulate(plan)
    path = old.decode(np.frombuffer(best_known(reports, "champion").genome, np.uint8))["path"]
    new = Terrain.model_validate(with_obstacles_on(old, path, np.random.default_rng(1)))
    demes = np.stack([np.frombuffer(report.deme, np.uint8) for report in reports])[:, None]
    led = led_on(old, new, demes)
    assert led.shape == demes.shape
    assert all(new.coding.alphabet.admits(each[0]) for each in led)
    for each in led:
        walked = new.decode(each[0])["path"]
        assert walked[0] == list(new.start)
        assert walked[-1] == list(new.goal)
    changed = Plan(new, Run(stall=30))
    best = best_known(simulate(changed, demes=led), "champion")
    assert best.fitness <= 1.05 * new.oracle().fitness
    unchanged = led_on(old, old, demes)
    np.testing.assert_allclose(old.evaluate(unchanged[:, 0]), old.evaluate(demes[:, 0]), rtol=1e-9)


# The file -------------------------------------------------------------------------------------------------------------
BASE = 'kind = "terrain"\nstart = [0, 0]\ngoal = [1, 1]\n'


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('map = ["..", "."]', "map: expected rows of the same length, 1 to 1024, found 1 characters in row 1"),
        ("map = []", "map: expected at least 1 item"),
        ('map = ["."]', "goal: expected a cell of the map, 1 rows of 1, found [1, 1]"),
        ('map = ["..", ".#"]', "goal: expected a cell where the robot stands free, found [1, 1], which is '#'"),
        ('map = ["#.", ".."]', "start: expected a cell where the robot stands free, found [0, 0], which is '#'"),
        ('map = ["..", ".."]\nterrain.x = "mud"', "terrain.x: expected one of clear, easy, moderate, difficult, im"),
        ('map = ["..", ".."]\nterrain.xy = "easy"', "terrain: expected one character for each terrain, found 'xy'"),
        ('map = ["..", ".."]\ndifficulty.mud = [3, 2, 1]', "expected a triangle [a, b, c] with a <= b <= c, found [3"),
        ('map = ["..", ".."]\ndifficulty.mud = [0, 2, 1]', "expected greater than or equal to 0.001"),
        ('map = ["..", ".."]\nrank = "mean"', "rank: expected 'centroid', 'pessimistic' or 'optimistic', found"),
        ('map = ["..", ".."]\nrobot_radius = -1', "robot_radius: expected greater than or equal to 0, found -1"),
        ("file = 3", "file: expected the name of a map, found 3"),
        ('file = "none.map"', "file: expected a map, found no such file as "),
        ('file = "a\\u0000b"', "file: expected the name of a map, found "),
        ('file = "x.map"\nmap = [".."]', "map: expected either map or file, found both"),
        ("colour = 3", "colour: unknown field"),
    ],
)
def test_bad_input_gives_one_clear_line(tmp_path, text, expected):
    path = tmp_path / "bad.toml"
    path.write_text(BASE + text)
    with pytest.raises(BadInput) as error:
        load(path)
    assert expected in str(error.value)
    assert str(error.value).startswith(str(path))
    assert len(str(error.value).splitlines()) == 1


MAP = "type octile\nheight 2\nwidth 3\nmap\n.@.\nGST\n"


def test_a_movingai_map_takes_the_place_of_its_name(tmp_path):
    (tmp_path / "x.map").write_text(MAP)
    path = tmp_path / "problem.toml"
    path.write_text('kind = "terrain"\nstart = [0, 0]\ngoal = [1, 1]\nfile = "x.map"\n')
    file = load(path)
    assert file.fields["map"] == [".@.", "GST"]
    assert "file" not in file.fields
    assert file.problem().impassable.tolist() == [[False, True, False], [False, False, True]]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (MAP.replace("octile", "tile"), "expected lines 'type octile', 'height ..', 'width ..', 'map', found"),
        ("", "expected lines 'type octile'"),
        (MAP.replace("height 2", "height 3"), "expected height 3 and width 3 as x.map says, found 2 rows of 3 char"),
        (MAP.replace("GST", "GS"), "found 2 rows of 2 or 3 characters"),
        (MAP.replace("GST", "GSÄ"), "expected a map in ASCII"),
    ],
)
def test_a_bad_map_gives_one_clear_line(tmp_path, text, expected):
    (tmp_path / "x.map").write_text(text, encoding="utf-8")
    (tmp_path / "problem.toml").write_text(BASE + 'file = "x.map"\n')
    with pytest.raises(BadInput, match=r"^\S+problem.toml: file: ") as error:
        load(tmp_path / "problem.toml")
    assert expected in str(error.value)


def test_a_file_alone_is_no_map():
    with pytest.raises(BadInput, match=r"problem.toml: file: expected map, the rows themselves, .* found 'x.map'"):
        parse(BASE + 'file = "x.map"', "problem.toml", Path()).problem()


# Pictures -------------------------------------------------------------------------------------------------------------
def test_the_picture_shows_start_destination_path_and_difficulties():
    problem = parse(Terrain.template, "template", Path()).problem()
    figure = Figure()
    problem.draw(figure, problem.oracle().solution, {})
    world, membership = figure.axes
    assert [text.get_text() for text in world.texts] == ["S", "D"]
    named = {text.get_text() for text in membership.get_legend().get_texts()}
    assert named == {"clear", "easy", "moderate", "difficult"}
    drawn = world.lines[-1].get_xydata()[:, ::-1].tolist()
    assert drawn == problem.oracle().solution["path"]
    assert all(max(abs(a - b) for a, b in zip(*pair, strict=True)) == 1 for pair in pairwise(drawn))
