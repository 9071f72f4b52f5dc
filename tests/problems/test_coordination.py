"""The coordination planner: its file, its codings and operators, its oracle, its arms, its judge and its pictures."""

import json
import subprocess
import sys
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from genetics import Keys, Recipe
from node.plan import Plan
from node.simulation import simulate
from problems import BadInput, ProblemFile, Run, load
from problems.coordination import Coordination, arms, checker
from problems.coordination.arms import Robot
from problems.coordination.diagram import RandomDiagram, blocks_of, is_passable, move_times
from problems.coordination.oracle import least_time
from spy.past import best_known
from spy.result import stop_reasons

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
CODINGS = ("variable", "fixed", "binary")
SIDES = (30, 20)
BLOCKS = [[5, 3, 12, 8], [14, 10, 20, 15], [24, 2, 26, 12]]
TIMES = [[0.1, 0.2], [0.15, 0.3]]


def file_of(**fields):
    base = {"kind": "coordination", "diagram": {"cells": SIDES, "times": TIMES, "obstacles": BLOCKS}}
    return ProblemFile("robots.toml", json.loads(json.dumps(base | fields)), Run(), Path())


@cache
def problem_of(coding="variable", points=8):
    return file_of(coding=coding, points=points).problem()


def keys(seed=1, generation=3):
    return Keys(np.array([5]), np.uint64(seed), generation)


def sequences(problem, count, seed=1):
    return problem.coding.random(keys(seed), count)[0]


def found_by(problem, run):
    """The best fitness of a run, and its solution."""
    best = best_known(simulate(Plan(problem, run)), "champion")
    return best.fitness, problem.decode(np.frombuffer(best.genome, np.uint8))


def is_increasing(items):
    return bool((np.diff(items, axis=0) >= 0).all())


# The file -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"diagram": None}, "expected one of diagram, random, robots, found none"),
        ({"random": {"seed": 1}}, "expected one of diagram, random, robots, found diagram and random"),
        ({"coding": "gray"}, "coding: expected 'variable', 'fixed' or 'binary', found"),
        ({"codings": "fixed"}, "did you mean 'coding'?"),
        ({"points": 0}, "points: expected greater than or equal to 1"),
        ({"diagram": {"cells": [4, 4], "obstacles": [[0, 0, 1, 1]]}}, "not to collide at the start, found cell [0, 0]"),
        ({"diagram": {"cells": [4, 4], "obstacles": [[3, 3, 3, 3]]}}, "not to collide at the end, found cell [3, 3]"),
        ({"diagram": {"cells": [4, 4], "obstacles": [[2, 1, 4, 1]]}}, "obstacles[0]: expected i0 <= i1 < 4"),
        ({"diagram": {"cells": [4]}}, "diagram.cells"),
        ({"diagram": {"cells": [4, 4], "times": [[-1.0, 0.0], [0.1, 0.0]]}}, "diagram.times[0][0]"),
        ({"diagram": None, "random": {"seed": 1, "cells": [30, 32]}}, "expected multiples of 4 from 32 on"),
        ({"diagram": None, "robots": [{"path": [[0.0]]}, {"path": [[0.0]]}]}, "path: expected at least 2"),
        ({"diagram": None, "robots": [{"path": [[0.0], [1.0]]}] * 2}, "d: expected 1 numbers, as in the path, found 5"),
        ({"diagram": None, "robots": [{"path": [[0.0] * 5] * 2}]}, "robots: expected at least 2 items"),
        ({"diagram": None, "robots": [{}, {}]}, "expected a path, or a result"),
    ],
)
def test_a_bad_file_gives_one_line_that_says_what_is_wrong(fields, said):
    with pytest.raises(BadInput) as error:
        file_of(**fields).problem()
    assert str(error.value).startswith("robots.toml: ")
    assert said.lower() in str(error.value).lower()


def test_a_recipe_that_is_not_for_the_coding_is_refused():
    with pytest.raises(BadInput, match="'mutation' is a probability"):
        ProblemFile("x", file_of().fields, Run(mutation="one-bit"), Path()).problem()


def test_reading_a_file_loads_no_compiled_code():
    code = f"import sys; from problems import load; load({str(EXAMPLES / 'coordination.toml')!r})"
    ran = subprocess.run(
        [sys.executable, "-c", code + "; print('numba' in sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
        cwd=EXAMPLES.parent,
    )
    assert ran.stdout.strip() == "False"


# Diagrams -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("layout", ["mirrored", "scattered"])
def test_random_diagrams_are_passable_and_the_same_for_the_same_seed(layout):
    masks = [RandomDiagram(seed=seed, layout=layout).mask() for seed in (1, 1, 2, 3, 4, 5)]
    np.testing.assert_array_equal(masks[0], masks[1])
    assert not np.array_equal(masks[1], masks[2])
    assert all(mask.shape == (180, 180) and is_passable(mask) and mask.any() for mask in masks)


def test_a_mirrored_diagram_has_sixteen_regions_alike():
    mask = RandomDiagram(seed=3).mask()
    quarter = mask[:45, :45]
    for i, j in np.ndindex(4, 4):
        part = mask[45 * i : 45 * i + 45, 45 * j : 45 * j + 45]
        np.testing.assert_array_equal(part, quarter[:: 1 - 2 * (i % 2), :: 1 - 2 * (j % 2)])


@given(st.integers(0, 1000), st.floats(0.0, 1.0))
def test_blocks_cover_exactly_the_obstacles(seed, share):
    mask = np.random.default_rng(seed).random((9, 7)) < share
    covered = np.zeros((9, 7), int)
    for i0, j0, i1, j1 in blocks_of(mask):
        covered[i0 : i1 + 1, j0 : j1 + 1] += 1
    np.testing.assert_array_equal(covered, mask)


def test_a_move_gains_speed_cruises_and_loses_speed():
    np.testing.assert_allclose(move_times(5, (0.1, 0.2)), [0.0, 2 * np.sqrt(0.02), 0.4, 0.5, 0.6])
    np.testing.assert_allclose(move_times(3, (0.1, 0.0)), [0.0, 0.1, 0.2])
    np.testing.assert_array_equal(move_times(3, (0.0, 0.0)), 0.0)


# Fitness --------------------------------------------------------------------------------------------------------------
def worth(problem, points):
    return problem.evaluate(problem.coding.encode(np.array(points))[None])[0]


def test_a_rectangle_takes_the_slower_robots_time_and_both_ends_of_it_belong_to_it():
    problem = problem_of()
    first, second = move_times(30, TIMES[0]), move_times(20, TIMES[1])
    free = [[13, 2], [23, 9], [23, 16]]
    expected = max(first[13], second[2]) + max(first[10], second[7]) + second[7] + max(first[6], second[3])
    assert worth(problem, free) == pytest.approx(expected)
    assert worth(problem, [[13, 2], [13, 2], *free[1:]]) == pytest.approx(expected)
    offset = 50 * max(first[-1], second[-1])
    assert worth(problem, [[13, 3], [23, 9], [23, 16]]) == pytest.approx(offset + 8)  # row 3 of the first block
    assert worth(problem, [[0, 8], [29, 8]]) == pytest.approx(offset + 8 + 3)


def sequences_of(width, height, count):
    cell = st.tuples(st.integers(0, width - 1), st.integers(0, height - 1))
    return st.lists(cell, min_size=1, max_size=count)


@given(sequences_of(*SIDES, 8))
def test_what_is_not_increasing_is_repaired_where_it_is_read(points):
    """From the last to the first, a conflicting coordinate takes the next one's value."""
    problem = problem_of()
    repaired = np.minimum.accumulate(np.array(points)[::-1], axis=0)[::-1]
    assert worth(problem, points) == worth(problem, repaired)
    solution = problem.decode(problem.coding.encode(np.array(points)))
    assert is_increasing(np.array(solution["points"]).reshape(-1, 2))
    assert problem.check(solution).fitness == pytest.approx(worth(problem, points))


def test_bits_are_scaled_to_cells_and_repaired():
    problem = problem_of("binary", 3)
    genome = problem.coding.encode(np.array([[255, 0, 128, 255, 200, 100]]))[0]
    assert problem.decode(genome)["points"] == [[15, 0], [15, 7], [23, 7]]


def test_a_start_that_is_the_end_takes_no_time():
    for coding in CODINGS:
        problem = file_of(coding=coding, diagram={"cells": [1, 1]}).problem()
        assert found_by(problem, Run(generations=2)) == (0.0, {"time": 0.0, "points": []})
        assert problem.check({"time": 0.0, "points": []}).feasible
        assert problem.oracle().fitness == 0.0


# Operators ------------------------------------------------------------------------------------------------------------
def offspring_of(problem, crossover, mutation, seed, count=40):
    couples = sequences(problem, 2 * count, seed).reshape(1, count, 2, -1)
    return couples[0], problem.coding.recombine(couples, Recipe(crossover, mutation), keys(seed))[0]


@settings(max_examples=30)
@given(st.sampled_from(["variable", "fixed"]), st.integers(1, 20), st.integers(0, 2**64 - 1))
def test_first_individuals_increase_and_have_the_lengths_they_may_have(coding, points, seed):
    problem = problem_of(coding, points)
    for genome in sequences(problem, 50, seed):
        items = problem.coding.items(genome)
        assert problem.coding.alphabet.admits(genome)
        assert is_increasing(items)
        assert 1 <= len(items) <= points
        assert coding == "variable" or len(items) == points


def test_of_first_lengths_the_probability_is_proportional_to_the_length():
    problem = problem_of("variable", 4)
    lengths = [len(problem.coding.items(genome)) for genome in sequences(problem, 20_000)]
    shares = np.bincount(lengths, minlength=5)[1:] / len(lengths)
    np.testing.assert_allclose(shares, [0.1, 0.2, 0.3, 0.4], atol=0.012)


@settings(max_examples=60)
@given(
    st.sampled_from(["variable", "fixed"]),
    st.integers(1, 9),
    st.sampled_from(["sp", "sp-tuned"]),
    st.floats(0.0, 1.0),
    st.integers(0, 2**64 - 1),
)
def test_offspring_increase_whatever_the_parents(coding, points, crossover, mutation, seed):
    problem = problem_of(coding, points)
    _, offspring = offspring_of(problem, crossover, mutation, seed)
    for _ in range(3):  # generations, in which variable individuals may grow
        for genome in offspring:
            assert problem.coding.alphabet.admits(genome)
            assert is_increasing(problem.coding.items(genome))
        couples = offspring.reshape(1, -1, 2, offspring.shape[1]).copy()
        offspring = problem.coding.recombine(couples, Recipe(crossover, mutation), keys(seed))[0]


def crossed(first, second):
    """All children of two parents by the paper's crossover (figure 1)."""
    children = []
    for cut in range(len(first)):
        beyond = np.flatnonzero((second > first[cut]).all(axis=1))
        children.append(np.vstack([first[: cut + 1], second[beyond[0] :]]) if len(beyond) else first)
    return children


def is_slight_mutant(parent, child):
    """Whether it is the parent with one point shifted by at most 10, repaired."""
    if len(parent) != len(child):
        return False
    for place in range(len(parent)):
        rest = child[place + 1 :], parent[place + 1 :]
        repaired = np.minimum(parent[:place], child[place])
        if np.array_equal(*rest) and np.array_equal(child[:place], repaired):
            shift = np.abs(child[place] - parent[place])
            following = parent[place + 1] if place + 1 < len(parent) else np.array(SIDES) - 1
            if ((shift <= 10) | (child[place] == following)).all():
                return True
    return False


def test_without_mutation_a_child_is_a_mutant_of_one_parent_or_one_with_the_end_of_the_other():
    problem = problem_of("variable", 8)
    couples, offspring = offspring_of(problem, "sp", 0.0, 4, count=300)
    items = problem.coding.items
    mutants = 0
    for child, genome in enumerate(offspring):
        first, second = (items(couples[child // 2, which]) for which in (child % 2, 1 - child % 2))
        its = items(genome)
        is_crossed = any(np.array_equal(its, other) for other in crossed(first, second))
        mutants += not is_crossed
        if not is_crossed and len(its) == len(first):
            difference = np.abs(its - first)
            assert is_slight_mutant(first, its) or (difference.any(axis=1).sum() >= 1)
        elif not is_crossed:
            assert len(its) == len(first) + 1
    assert 0.35 < mutants / len(offspring) < 0.55  # half of them, but for those whose mutation changed nothing


def test_fixed_children_keep_their_length():
    problem = problem_of("fixed", 8)
    _, offspring = offspring_of(problem, "sp", 1.0, 4)
    assert all(len(problem.coding.items(genome)) == 8 for genome in offspring)


def test_individuals_that_are_full_take_no_more_points():
    problem = problem_of("variable", 1)
    most = problem.coding.most
    full = problem.coding.encode(np.column_stack([np.arange(0, 4 * most, 4), np.arange(0, 4 * most, 4)]))
    couples = np.tile(full, (1, 200, 2, 1))
    offspring = problem.coding.recombine(couples, Recipe("sp", 1.0), keys())[0]
    assert all(problem.coding.alphabet.admits(genome) for genome in offspring)


# The oracle -----------------------------------------------------------------------------------------------------------
def brute_force(blocked, times_1, times_2, most):
    """The least time by trying every sequence of at most ``most`` points."""
    last = (blocked.shape[0] - 1, blocked.shape[1] - 1)

    def seconds(i, j, k, to):
        return np.inf if blocked[i : k + 1, j : to + 1].any() else max(times_1[k - i], times_2[to - j])

    @cache
    def best(i, j, left):
        found = seconds(i, j, *last)
        if left:
            for k in range(i, last[0] + 1):
                for to in range(j, last[1] + 1):
                    if (k, to) != (i, j) and not blocked[i : k + 1, j : to + 1].any():
                        found = min(found, seconds(i, j, k, to) + best(k, to, left - 1))
        return found

    return best(0, 0, most)


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.floats(0.0, 0.5), st.integers(0, 4), st.tuples(st.integers(1, 6), st.integers(1, 6)))
def test_the_oracle_agrees_with_trying_all_sequences(seed, share, most, sides):
    generator = np.random.default_rng(seed)
    blocked = generator.random(sides) < share
    blocked[0, 0] = blocked[-1, -1] = False
    times = [move_times(side, tuple(generator.uniform(0.0, 1.0, 2))) for side in sides]
    for limit, tried in ((most, most), (None, sum(sides))):
        expected = brute_force(blocked, *times, tried)
        fitness, points = least_time(blocked, *times, limit)
        assert fitness == pytest.approx(expected)
        assert np.isfinite(fitness) == (points is not None)
        if points is None:
            continue
        corners = [(0, 0), *points, (sides[0] - 1, sides[1] - 1)]
        total = sum(max(times[0][k - i], times[1][to - j]) for (i, j), (k, to) in pairwise(corners))
        assert total == pytest.approx(fitness)
        assert limit is None or len(points) <= limit
        assert not any(blocked[i : k + 1, j : to + 1].any() for (i, j), (k, to) in pairwise(corners))


def test_any_number_of_points_is_possible_if_there_is_a_way_at_all():
    generator = np.random.default_rng(1)
    for _ in range(200):
        blocked = generator.random((7, 7)) < 0.4
        blocked[0, 0] = blocked[-1, -1] = False
        times = move_times(7, (0.1, 0.2))
        assert np.isfinite(least_time(blocked, times, times, None)[0]) == is_passable(blocked)


@pytest.mark.parametrize("coding", CODINGS)
def test_the_oracles_solution_passes_the_check_and_nobody_is_faster(coding):
    problem = problem_of(coding)
    answer = problem.oracle()
    verdict = problem.check(json.loads(json.dumps(answer.solution)))
    assert verdict.feasible
    assert verdict.fitness == pytest.approx(answer.fitness)
    assert answer.figures["time of the slower path alone"] <= answer.fitness
    assert found_by(problem, Run(generations=100))[0] >= answer.fitness - 1e-9


def test_a_diagram_without_a_way_has_no_solution_and_ends_as_stalled_with_the_best_found():
    problem = file_of(diagram={"cells": [20, 20], "obstacles": [[10, 0, 10, 19]]}).problem()
    assert problem.oracle().fitness == np.inf
    plan = Plan(problem, Run())
    reports = simulate(plan)
    assert stop_reasons(reports, "lockstep") == ("stall",)
    fitness, solution = found_by(problem, Run())
    assert fitness == problem.offset + 1  # a rectangle that crosses the wall along one row
    verdict = problem.check(solution)
    assert not verdict.feasible
    assert verdict.fitness == fitness


def test_a_diagram_too_large_for_the_oracle_is_refused():
    with pytest.raises(BadInput, match="expected at most 262144 cells"):
        file_of(diagram={"cells": [600, 600]}).problem().oracle()


# Checking -------------------------------------------------------------------------------------------------------------
def test_the_judge_objects_to_whatever_is_wrong():
    problem = problem_of()
    solution = problem.oracle().solution
    assert problem.check(solution).feasible
    for points, time, said in (
        (solution["points"], solution["time"] - 0.1, "s, not"),
        ([[13, 5]], 5.0, "obstacle cells"),
        ([[13, 2], [12, 9]], 5.0, "does not increase"),
        ([[99, 99]], 5.0, "does not increase"),
    ):
        verdict = problem.check({"time": time, "points": points})
        assert any(said in objection for objection in verdict.objections)


# Arms -----------------------------------------------------------------------------------------------------------------
@cache
def arms_problem():
    pytest.importorskip("fcl")
    fields = load(EXAMPLES / "coordination-arms.toml").fields
    robots = [robot | {"cells": 60, "path": robot["path"][:3]} for robot in fields["robots"]]
    return ProblemFile("arms", Coordination.derive_fields(fields | {"robots": robots}), Run(), Path()).problem()


def test_a_file_of_robots_is_read_with_their_diagram():
    pytest.importorskip("fcl")
    file = load(EXAMPLES / "coordination-arms.toml")
    problem = file.problem()
    assert problem.collisions is not None
    assert problem.blocked.any()
    again = Coordination.model_validate({name: value for name, value in file.fields.items() if name != "collisions"})
    np.testing.assert_array_equal(again.blocked, problem.blocked)


def test_when_a_robot_goes_the_other_way_the_diagram_is_made_anew():
    fields = arms_problem().model_dump(mode="json", exclude_unset=True, by_alias=True)
    before = ProblemFile("arms", fields, Run(), Path())
    first, second = before.fields["robots"]
    robots = [first, second | {"path": second["path"][::-1]}]
    after = before.changed({"robots": robots}, {})
    fresh = Coordination.derive_fields({"kind": "coordination", "robots": robots})
    assert after.fields["collisions"] == fresh["collisions"] != before.fields["collisions"]
    unmoved = before.changed({"bits": 9}, {})
    assert unmoved.fields["collisions"] == before.fields["collisions"]


def test_without_robots_there_is_no_diagram_of_theirs():
    robots = arms_problem().model_dump(mode="json", exclude_unset=True, by_alias=True)
    fields = Coordination.derive_fields(robots | {"robots": None, "random": {"seed": 1}})
    assert not {"collisions", "collisions_of"} & fields.keys()


def test_a_file_may_not_have_robots_and_a_diagram():
    pytest.importorskip("fcl")
    file = load(EXAMPLES / "coordination-arms.toml")
    with pytest.raises(BadInput, match="found diagram and robots"):
        file.changed({"diagram": {"cells": [2, 2]}}, {})


def test_a_robot_moves_evenly_and_as_fast_as_its_joints_allow():
    robot = Robot(
        path=[[0.0, 0.0], [1.0, 0.5], [1.0, 0.0]], d=[0, 0], a=[1, 1], alpha=[0, 0], speeds=[1.0, 0.25], cells=5
    )
    length = np.hypot(1.0, 0.5) + 0.5
    assert arms.Motion(robot).length == pytest.approx(length)
    assert arms.Motion(robot).speed(np.array(robot.speeds)) == pytest.approx(0.25)  # along the last stretch
    where = arms.places(robot, np.arange(5))
    np.testing.assert_allclose(where[[0, -1]], [[0.0, 0.0], [1.0, 0.0]])
    along = np.linalg.norm(np.diff(where, axis=0), axis=1)
    assert along.max() <= length / 4 + 1e-12


def test_the_two_ways_to_place_links_agree():
    generator = np.random.default_rng(5)
    robot = Robot(path=generator.uniform(-3, 3, (4, 5)).tolist(), base=(0.1, -0.2, 0.3, 0.7), cells=9)
    ends = arms.origins(robot, arms.places(robot, np.arange(17) / 2))
    links = checker._Arm(robot).halves
    moving = np.flatnonzero(robot.lengths > 0)
    np.testing.assert_allclose(links[:, :, 0], ends[:, moving], atol=1e-12)
    np.testing.assert_allclose(links[:, :, 1], ends[:, moving + 1], atol=1e-12)


@given(st.integers(0, 10**6))
def test_the_distance_of_segments_is_the_least_of_all_their_points(seed):
    segments = np.random.default_rng(seed).uniform(-1, 1, (2, 2, 3))
    share = np.linspace(0, 1, 101)[:, None]
    one, other = (segment[0] + share * (segment[1] - segment[0]) for segment in segments)
    least = np.linalg.norm(one[:, None] - other[None], axis=-1).min()
    found = checker._distances(segments[:1], segments[1:])[0]
    assert found <= least + 1e-12
    assert found >= least - 0.04


def test_a_cell_is_free_only_if_the_arms_are_apart_everywhere_in_it_and_most_obstacles_are_needed():
    problem = arms_problem()
    first, second = (checker._Arm(robot).halves for robot in problem.robots)
    thickness = sum(robot.radius for robot in problem.robots)
    others = second.swapaxes(0, 1)[None]
    gaps = np.array([checker._distances(one[:, None, None], others).min(axis=(0, 1)) for one in first])
    hit = gaps < thickness
    for i, j in np.ndindex(problem.blocked.shape):
        around = hit[max(0, 2 * i - 1) : 2 * i + 2, max(0, 2 * j - 1) : 2 * j + 2]
        assert problem.blocked[i, j] or not around.any()
    assert hit[::2, ::2].sum() > 0.4 * problem.blocked.sum()


def test_the_judge_moves_the_arms():
    problem = arms_problem()
    solution = problem.oracle().solution
    assert problem.check(solution).feasible
    empty = Coordination.model_validate(
        problem.model_dump() | {"collisions": problem.world.model_dump() | {"obstacles": []}}
    )
    direct = {"time": float(max(times[-1] for times in empty.move_times)), "points": []}
    assert any("the arms overlap" in objection for objection in empty.check(direct).objections)


def test_a_path_may_come_from_the_result_of_another_planner(tmp_path):
    pytest.importorskip("fcl")
    planar = {"d": [0.0, 0.0], "a": [0.5, 0.4], "alpha": [0.0, 0.0], "speeds": [1.0, 1.0], "cells": 10}
    path = [[0.0, 0.0], [1.0, 0.0], [1.0, -1.0]]
    (tmp_path / "one.json").write_text(json.dumps({"kind": "arm-path", "solution": {"path": path}}))
    (tmp_path / "two.json").write_text(json.dumps({"path": path}))
    text = 'kind = "coordination"\n'
    for name, x in (("one.json", 0.0), ("two.json", 0.9)):
        fields = [f"{field} = {value}" for field, value in planar.items()]
        text += "\n".join(["[[robots]]", f'result = "{name}"', f"base = [{x}, 0.0, 0.0, 1.0]", *fields, ""])
    (tmp_path / "robots.toml").write_text(text)
    problem = load(tmp_path / "robots.toml").problem()
    assert problem.robots[0].path == problem.robots[1].path == path
    assert problem.robots[0].result is None
    (tmp_path / "two.json").write_text("{}")
    with pytest.raises(BadInput, match=r"robots.toml: robots\[1\].result: expected an arm-path result with a path"):
        load(tmp_path / "robots.toml")
    (tmp_path / "two.json").unlink()
    with pytest.raises(BadInput, match=r"robots\[1\].result: expected an arm-path result as JSON"):
        load(tmp_path / "robots.toml")


# Runs and pictures ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("coding", CODINGS)
@pytest.mark.parametrize("recipe", ["paper", "tuned"])
@pytest.mark.parametrize(("topology", "deme"), [("torus 4x4", 1), ("torus 1x1", 40)])
def test_every_coding_finds_a_way_by_every_recipe(coding, recipe, topology, deme):
    file = file_of(coding=coding, points=6).with_run(recipe=recipe, topology=topology, deme=deme, generations=150)
    fitness, solution = found_by(file.problem(), file.run)
    verdict = file.problem().check(solution)
    assert verdict.feasible
    assert verdict.fitness == pytest.approx(fitness)
    assert fitness < 2.0 * file.problem().oracle().fitness


def test_the_paper_recipe_is_the_papers():
    assert problem_of().recipe("paper", 100) == Recipe("sp", 0.5, "elitist", renewal=1.0)
    assert problem_of("binary").recipe("paper", 100) == Recipe("one-point", 1 / 128, "elitist", renewal=1.0)


def test_the_picture_shows_the_rectangles_and_the_arms(tmp_path):
    problem = arms_problem()
    solution = problem.oracle().solution
    figure = Figure()
    problem.draw(figure, solution, {0: sequences(problem, 9), 7: sequences(problem, 4, 2)})
    figure.savefig(tmp_path / "arms.png")
    assert len(figure.axes) == 4
    assert len(figure.axes[0].patches) == 2 * (len(solution["points"]) + 1)
    assert f"{solution['time']:.2f} s" in figure.axes[0].get_title()
