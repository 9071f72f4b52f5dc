"""The arm-path planner: its file, its slices, its scan, its paths, its judge, its oracle and its coding."""

import json
from collections import deque
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from genetics import Keys, Recipe
from node.plan import Plan
from node.simulation import simulate
from problems import BadInput, ProblemFile, load
from problems.arm_ik import ArmIk
from problems.arm_path import ArmPath
from problems.arm_path.coding import FINER_AT, CoarseToFine
from problems.arm_path.oracle import Grid, fewest_moves, fill, move_counts, shortest
from problems.file import parse
from problems.run import Run
from spy.past import best_known
from spy.result import states_of

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "arm-path.toml"
TURN = 2 * np.pi
WALLS = [  # the second link can pass only if it is folded back
    {"shape": "box", "center": [1.3, 0.0], "size": [0.5, 0.2]},
    {"shape": "circle", "center": [-1.2, 0.3], "radius": 0.25},
    {"shape": "polygon", "vertices": [[-0.3, -1.0], [0.3, -1.0], [0.1, -1.6], [0.0, -1.1], [-0.1, -1.6]]},
]


def fields_of(**fields):
    plain = {
        "kind": "arm-path",
        "start": [0.6, 0.3],
        "goal": [5.3, -0.3],
        "arm": {"links": [1.0, 0.7], "radius": 0.02},
        "obstacles": WALLS,
    }
    return plain | fields


def problem_of(**fields):
    return ArmPath.model_validate(fields_of(**fields))


def tuned(**fields):
    return problem_of(**fields).for_recipe("tuned", 1)


def random_world(generator, links, radius, limits=None):
    """An arm that stands free among a few obstacles."""
    while True:
        obstacles = []
        for _ in range(generator.integers(2, 7)):
            center = generator.uniform(-1.5, 1.5, 2).tolist()
            if generator.random() < 0.5:
                obstacles.append({"shape": "circle", "center": center, "radius": float(generator.uniform(0.1, 0.3))})
            else:
                size = generator.uniform(0.1, 0.7, 2).tolist()
                angle = float(generator.uniform(0.0, 3.0))
                obstacles.append({"shape": "box", "center": center, "size": size, "angle": angle})
        arm = {"links": generator.uniform(0.3, 1.0, links).tolist(), "radius": radius, "limits": limits}
        ends = generator.uniform(0.0, TURN, (2, links)) if limits is None else generator.uniform(*limits[0], (2, links))
        fields = {"arm": arm, "obstacles": obstacles, "start": ends[0].tolist(), "goal": ends[1].tolist()}
        try:
            return problem_of(**fields, bits=int(generator.integers(4, 9)), rounds=int(generator.integers(1, 6)))
        except ValueError:
            continue


def random_genomes(problem, count, seed=1):
    return problem.coding.random(Keys(np.arange(1), np.uint64(seed), 0), count)[0]


def genome_of(problem, *angles):
    """Moves to the coded angles nearest to these; the rest of the moves stay at the last two."""
    codes = np.rint(np.array(angles) / TURN * problem.levels).astype(int) % problem.levels
    moves = problem.coding.parameters
    links = len(problem.arm.links)
    rest = [codes[len(codes) - links + (number % links)] for number in range(moves - len(codes))]
    return problem.coding.encode(np.array([[*codes, *rest]]))[0]


# File -----------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"start": [0.6]}, "start: expected one angle for each of 2 links, found 1"),
        ({"goal": [0.6, 0.1, 0.2]}, "goal: expected one angle for each of 2 links, found 3"),
        ({"start": [0.0, 0.0]}, "start: expected a free configuration, found [0.0, 0.0]: the arm is in obstacles[0]"),
        ({"goal": [0.0, 0.0]}, "goal: expected a free configuration"),
        ({"arm": {"links": [1.0]}}, "arm.links: expected 2 to 6 links, found 1"),
        ({"arm": {"links": [1.0] * 7}}, "arm.links: expected 2 to 6 links, found 7"),
        ({"arm": {"links": [1.0, 0.7], "limits": [[0, 1], [0, 1]]}}, "joint 1 is beyond its limits [0, 1]"),
        ({"bits": 13}, "bits: expected less than or equal to 12"),
        ({"rounds": 0}, "rounds: expected greater than or equal to 1"),
        ({"goals": [0.0]}, "goals: unknown field"),
        ({"obstacles": [{"shape": "circle", "center": [0, 0], "radius": 0.1}]}, "arm.base: expected a place clear of"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_in_one_line(change, complaint):
    with pytest.raises(BadInput) as refused:
        ProblemFile("x.toml", fields_of(**change), Run(), Path()).problem()
    assert str(refused.value).startswith("x.toml: ")
    assert complaint in str(refused.value)
    assert "\n" not in str(refused.value)


def test_an_arm_that_touches_itself_cannot_start():
    arm = {"links": [1.0, 0.5, 0.8], "radius": 0.02}
    folded = {"start": [0.0, 2.6, 2.6], "goal": [0.5, 0.5, 0.5], "arm": arm, "obstacles": []}
    with pytest.raises(ValueError, match="the arm touches itself"):
        problem_of(**folded)
    assert problem_of(**folded, self_collision=False)


def test_recipes_fill_in_what_the_file_leaves_open():
    paper, best = problem_of().for_recipe("paper", 1), tuned()
    assert (paper.code, paper.coarse, paper.scan) == ("binary", 8, "from-start")
    assert (best.code, best.coarse, best.scan) == ("binary", 4, "from-both-ends")
    assert not isinstance(paper.coding, CoarseToFine)
    assert isinstance(best.coding, CoarseToFine)
    assert paper.coding.length == 2 * 24 * 8
    chosen = problem_of(scan="from-start", coarse=6).for_recipe("tuned", 1)
    assert (chosen.scan, chosen.coding.coarse) == ("from-start", 6)
    assert not isinstance(problem_of(code="gray").for_recipe("tuned", 1).coding, CoarseToFine)


# Slices ---------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("links", [2, 3, 5])
@pytest.mark.parametrize("radius", [0.0, 0.03, 0.1])
def test_legal_ranges_are_where_sampled_configurations_are_free(links, radius):
    generator = np.random.default_rng([links, int(100 * radius)])
    for _ in range(6):
        problem = random_world(generator, links, radius)
        sampled = ArmIk.model_validate(
            {
                "kind": "arm-ik",
                "target": [0, 0],
                "arm": problem.arm.model_dump(exclude_unset=True),
                "obstacles": problem.obstacles,
            }
        )
        for joint in range(links):
            angles = generator.uniform(0.0, TURN, 1500)
            configurations = np.tile(problem.start, (len(angles), 1))
            configurations[:, joint] = angles
            free = np.isfinite(sampled.distances(configurations))
            assert [problem.is_legal(each, joint, 0.0) for each in configurations] == free.tolist()


def test_a_turn_is_legal_if_everything_on_the_way_is():
    generator = np.random.default_rng(3)
    for _ in range(10):
        problem = random_world(generator, 2, 0.03)
        sampled = ArmIk.model_validate(
            {
                "kind": "arm-ik",
                "target": [0, 0],
                "arm": problem.arm.model_dump(exclude_unset=True),
                "obstacles": problem.obstacles,
            }
        )
        start = np.array(problem.start)
        for joint, turn in ((0, 1.7), (1, -2.5), (0, -6.0), (1, 6.2)):
            way = np.tile(start, (4001, 1))
            way[:, joint] += np.linspace(0.0, turn, len(way))
            assert problem.is_legal(start, joint, turn) == bool(np.isfinite(sampled.distances(way)).all())


def test_contact_at_exactly_the_limit_is_free():
    touching = {"shape": "circle", "center": [0.5, 0.25], "radius": 0.23}  # the first link has a radius of 0.02
    problem = problem_of(obstacles=[touching], start=[0.0, 0.0], goal=[0.0, 1.0])
    assert problem.is_legal(np.zeros(2), 0, -1.0)
    assert not problem.is_legal(np.zeros(2), 0, 0.01)
    assert problem.is_legal(np.zeros(2), 1, 1.0)


# Scan -----------------------------------------------------------------------------------------------------------------
def test_a_start_at_the_goal_is_solved_at_once():
    for goal in ([0.6, 0.3], [0.6 + TURN, 0.3 - TURN]):
        problem = tuned(goal=goal)
        genomes = random_genomes(problem, 3)
        assert (problem.evaluate(genomes) == 0.0).all()
        solution = problem.decode(genomes[0])
        assert solution == {"path": [[0.6, 0.3]], "cspace_evaluated": 0.0, "slices": [[], []]}
        assert problem.check(solution).feasible


def test_a_free_goal_is_reached_by_one_move_of_each_joint():
    problem = problem_of(obstacles=[], start=[0.1, 0.2], goal=[-1.0, 6.0]).for_recipe("paper", 1)
    solution = problem.decode(random_genomes(problem, 1)[0])
    np.testing.assert_allclose(solution["path"], [[0.1, 0.2], [-1.0, 0.2], [-1.0, 6.0 - TURN]])


def test_the_longer_sense_is_taken_where_the_shorter_is_blocked_but_not_beyond_limits():
    wall = [{"shape": "box", "center": [1.3, 0.0], "size": [1.0, 0.1]}]
    free = problem_of(obstacles=wall, start=[0.5, 0.0], goal=[-0.5, 0.0])
    assert free.decode(random_genomes(free, 1)[0])["path"] == [[0.5, 0.0], [pytest.approx(TURN - 0.5), 0.0]]
    arm = {"links": [1.0, 0.7], "radius": 0.02, "limits": [[-3.0, 3.0], [-0.2, 0.2]]}
    limited = problem_of(obstacles=wall, start=[0.5, 0.0], goal=[-0.5, 0.0], arm=arm).for_recipe("paper", 1)
    fitness = limited.evaluate(random_genomes(limited, 200))
    assert fitness.min() > 0.0


def test_the_papers_scan_stops_at_the_first_blocked_move_and_the_tuned_one_goes_on():
    arm = {"links": [1.0, 0.7], "radius": 0.02}
    wall = [{"shape": "box", "center": [1.3, 0.0], "size": [0.5, 0.2]}]
    fields = {"obstacles": wall, "start": [1.0, 0.0], "goal": [-0.9, 0.0], "arm": arm, "scan": "from-start"}
    spikes = [{"shape": "box", "center": [-1.5, 0.0], "size": [0.9, 0.1]}]
    problem = problem_of(**fields | {"obstacles": wall + spikes}).for_recipe("paper", 1)
    blocked = genome_of(problem, -0.4, 0.0)
    assert problem.evaluate(blocked[None])[0] == pytest.approx(1.9)
    assert len(problem.decode(blocked)["path"]) == 1
    both = problem.model_copy(update={"scan": "from-both-ends"}).for_cell()
    folding = genome_of(both, -0.4, np.pi - 0.3, -0.9, np.pi - 0.3)
    assert both.evaluate(folding[None])[0] == 0.0
    assert problem.evaluate(folding[None])[0] > 0.0


@pytest.mark.parametrize("recipe", ["paper", "tuned"])
@pytest.mark.parametrize("links", [2, 3, 4])
def test_every_decoded_path_keeps_to_the_rules_and_is_worth_its_fitness(recipe, links):
    generator = np.random.default_rng(links)
    limits = [[-3.0, 2.5]] * links
    for number in range(6):
        problem = random_world(generator, links, [0.0, 0.03][number % 2], limits if number % 3 == 0 else None)
        problem = problem.model_copy(update={"stretch": number % 2 == 0}).for_recipe(recipe, 1)
        genomes = random_genomes(problem, 6, number)
        for genome, fitness in zip(genomes, problem.evaluate(genomes), strict=True):
            solution = json.loads(json.dumps(problem.decode(genome)))
            assert all(np.count_nonzero(np.subtract(*rows)) == 1 for rows in pairwise(solution["path"]))
            verdict = problem.check(solution)
            assert verdict.fitness == pytest.approx(fitness, abs=1e-6)
            assert all(text.startswith("the path ends") for text in verdict.objections), verdict.objections
            assert verdict.feasible == (fitness == 0.0)


def test_what_is_kept_never_shows_in_a_fitness():
    for links in (2, 4):
        problem = random_world(np.random.default_rng(links), links, 0.02).for_recipe("tuned", 1)
        genomes = random_genomes(problem, 300)
        expected = problem.evaluate(genomes)
        assert problem.evaluate(genomes[::-1]).tobytes() == expected[::-1].tobytes()
        fresh = [problem.for_cell().evaluate(genome[None])[0] for genome in genomes]
        assert np.array(fresh).tobytes() == expected.tobytes()


# Stretching -----------------------------------------------------------------------------------------------------------
def test_stretched_paths_are_legal_and_never_longer():
    generator = np.random.default_rng(5)
    shorter = 0
    examples = [load(EXAMPLE).problem(), load(EXAMPLE.with_name("arm-path-four-links.toml")).problem()]
    for example in [*examples, *(random_world(generator, links, 0.02) for links in (2, 3, 4))]:
        plain = example.model_copy(update={"stretch": False}).for_recipe("tuned", 1)
        stretching = plain.model_copy(update={"stretch": True}).for_cell()
        for genome in random_genomes(plain, 10):
            before, after = (np.array(each.decode(genome)["path"]) for each in (plain, stretching))
            np.testing.assert_array_equal(before[0], after[0])
            np.testing.assert_allclose(before[-1], after[-1], atol=1e-9)
            lengths = [np.abs(np.diff(path, axis=0)).sum() for path in (before, after)]
            assert lengths[1] <= lengths[0] + 1e-9
            assert len(after) <= len(before)
            shorter += len(after) < len(before)
    assert shorter > 10


# What was evaluated ---------------------------------------------------------------------------------------------------
def test_the_share_evaluated_is_the_union_over_cells_of_two_joints():
    problem = tuned()
    cells = [problem.for_cell() for _ in range(3)]
    for number, cell in enumerate(cells[:2]):
        cell.evaluate(random_genomes(problem, 4, number))
    reports = {number: cell.report() for number, cell in enumerate(cells)}
    assert all(len(report) == 65 for report in reports.values())
    shares = [problem.merge({}, {number: report}, 0)["cspace_evaluated"] for number, report in reports.items()]
    whole = problem.merge({"path": [problem.start]}, reports, 0)
    assert shares[2] == 0.0
    assert max(shares) < whole["cspace_evaluated"] < sum(shares)
    assert whole["path"] == [problem.start]
    assert not [text for text in problem.check(whole).objections if "slices" in text]
    lying = whole | {"cspace_evaluated": whole["cspace_evaluated"] + 0.01}
    assert any("slices evaluate" in text for text in problem.check(lying).objections)


def test_of_more_joints_the_finders_share_counts():
    problem = tuned(start=[0.6, 0.3, 0.1], goal=[5.3, -0.3, 0.2], arm={"links": [0.8, 0.5, 0.4]})
    cells = [problem.for_cell() for _ in range(2)]
    for number, cell in enumerate(cells):
        cell.evaluate(random_genomes(problem, 5 * (number + 1), number))
    reports = {number: cell.report() for number, cell in enumerate(cells)}
    slices, counted = np.frombuffer(reports[1], np.int64)
    whole = problem.merge({"path": []}, reports, 1)
    assert whole == {"path": [], "slices": slices, "cspace_evaluated": counted / 256**3}
    assert problem.merge({"path": []}, {}, 1) == {"path": []}


def test_what_was_evaluated_is_the_same_whoever_runs_the_cells():
    for name in ("arm-path.toml", "arm-path-four-links.toml"):
        problem = load(EXAMPLE.with_name(name)).problem()
        run = Run(topology="torus 2x2", target=-1.0, generations=1)
        reports = simulate(Plan(problem, run))
        assert states_of(reports).keys() == {0, 1, 2, 3}
        assert len(set(states_of(reports).values())) > 1
        assert reports == simulate(Plan(problem.for_cell(), run))


# Check ----------------------------------------------------------------------------------------------------------------
def test_the_check_names_the_move_and_the_obstacle():
    problem = problem_of()
    nothing = {"cspace_evaluated": 0.0, "slices": [[], []]}
    through = nothing | {"path": [[0.6, 0.3], [0.6, -0.3], [5.3 - TURN, -0.3]]}
    found = problem.check(through).objections
    assert "move 2 hits obstacles[0]" in found
    assert not any(text.startswith("the path ends") for text in found)
    both = nothing | {"path": [[0.6, 0.3], [5.3, -0.3]]}
    assert "move 1 turns 2 joints, not one" in problem.check(both).objections
    elsewhere = nothing | {"path": [[0.7, 0.3]]}
    verdict = problem.check(elsewhere)
    assert verdict.objections[0].startswith("the path starts at")
    assert verdict.fitness == pytest.approx(np.hypot(5.3 - TURN - 0.7, 0.6))


def test_the_check_sees_what_happens_between_samples():
    thin = [{"shape": "box", "center": [1.5, 0.0], "size": [0.1, 1e-4]}]
    problem = problem_of(obstacles=thin, start=[0.5, 0.0], goal=[-0.5, 0.0], arm={"links": [1.0, 0.7]})
    swept = {"path": [[0.5, 0.0], [-0.5, 0.0]], "cspace_evaluated": 0.0, "slices": [[], []]}
    assert problem.check(swept).objections == ("move 1 hits obstacles[0]",)


def test_the_check_sees_links_that_touch_on_the_way():
    arm = {"links": [1.0, 0.5, 0.8], "radius": 0.02}
    problem = problem_of(start=[0.0, 2.6, 0.0], goal=[0.0, 2.6, 3.4], arm=arm, obstacles=[])
    through = {"path": [[0.0, 2.6, 0.0], [0.0, 2.6, 3.4]], "cspace_evaluated": 0.0, "slices": 0}
    assert problem.check(through).objections == ("move 1 makes the arm touch itself",)
    other_way = through | {"path": [[0.0, 2.6, 0.0], [0.0, 2.6, 3.4 - TURN]]}
    assert problem.check(other_way).feasible
    bare = problem.model_copy(update={"arm": problem.arm.model_copy(update={"radius": 0.0})})
    assert bare.check(through).objections == ("move 1 makes the arm touch itself",)
    assert bare.check(other_way).feasible


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"path": []}, "path: expected at least 1 item"),
        ({"path": [[0.0]]}, "path: expected 2 angles in each row, found 1"),
        ({"slices": 3}, "slices: expected two lists of codes for 2 links"),
        ({"slices": [[256], []]}, "slices: expected codes below 256, found 256"),
        ({"cspace_evaluated": 1.5}, "cspace_evaluated: expected less than or equal to 1"),
        ({"more": 1}, "more: unknown field"),
    ],
)
def test_what_is_no_solution_at_all_is_refused(change, complaint):
    solution = {"path": [[0.6, 0.3]], "cspace_evaluated": 0.0, "slices": [[], []]} | change
    with pytest.raises(BadInput) as refused:
        problem_of().check(solution)
    assert str(refused.value).startswith("solution: ")
    assert complaint in str(refused.value)


# Oracle ---------------------------------------------------------------------------------------------------------------
def brute_force(grid):
    """The fewest moves to the goal by 0-1 breadth-first search, cell by cell, or None."""
    levels = len(grid.surely_free)
    if not grid.surely_free[grid.start]:
        return None
    cost, queue = {(grid.start, -1): 0}, deque([(grid.start, -1)])
    while queue:
        cell, moving = queue.popleft()
        for joint in (0, 1):
            for step in (-1, 1):
                beside = list(cell)
                beside[joint] += step
                if grid.is_torus:
                    beside[joint] %= levels
                elif not 0 <= beside[joint] < levels:
                    continue
                beside = tuple(beside)
                if not grid.surely_free[beside]:
                    continue
                dearer = cost[cell, moving] + (joint != moving)
                if dearer < cost.get((beside, joint), 10**9):
                    cost[beside, joint] = dearer
                    (queue.append if joint != moving else queue.appendleft)((beside, joint))
    found = [moves for (cell, _), moves in cost.items() if cell == grid.goal]
    return min(found, default=None)


@settings(max_examples=200)
@given(st.integers(0, 10**6), st.booleans(), st.floats(0.1, 0.5))
def test_the_fewest_moves_are_those_of_a_zero_one_search(seed, is_torus, blocked):
    generator = np.random.default_rng(seed)
    free = generator.random((9, 9)) > blocked
    grid = Grid(free, free, tuple(generator.integers(0, 9, 2)), tuple(generator.integers(0, 9, 2)), is_torus)
    corners = fewest_moves(grid)
    expected = brute_force(grid)
    assert (len(corners) - 1 if corners else None) == expected
    if corners:
        assert (corners[0], corners[-1]) == (grid.start, grid.goal)
        assert all(np.count_nonzero(np.subtract(*pair)) == 1 for pair in pairwise(corners))
        counts = move_counts(grid)[:, *grid.goal]
        assert min(counts[counts >= 0]) == expected


def test_thick_and_thin_cells_enclose_the_free_ones():
    generator = np.random.default_rng(2)
    for number in range(4):
        problem = random_world(generator, 2, [0.0, 0.05][number % 2])
        grid = fill(problem)
        computed = np.zeros((2, problem.levels + 2), np.uint8)
        computed[0, : problem.levels] = 1
        free = problem.cells_in(computed)
        assert (grid.surely_free <= free).all()
        assert (free <= grid.maybe_free).all()


def test_the_oracles_paths_are_accepted_and_no_shorter_than_the_shortest():
    generator = np.random.default_rng(4)
    reached = 0
    for number in range(12):
        limits = [[-3.0, 3.0]] * 2 if number % 3 == 0 else None
        problem = random_world(generator, 2, 0.02, limits)
        answer = problem.oracle()
        if answer.solution is None:
            assert answer.meaning == "lower bound"
            continue
        reached += 1
        verdict = problem.check(json.loads(json.dumps(answer.solution)))
        assert verdict.feasible, verdict
        assert answer.figures["fewest_moves_at_most"] == len(answer.solution["path"]) - 1
        turned = np.abs(np.diff(answer.solution["path"], axis=0)).sum()
        steps = problem.joint_ranges[1] / problem.steps
        assert turned >= answer.figures["shortest_rad_at_most"] - 2 * steps.sum()
    assert reached >= 4


def test_the_shortest_way_is_the_sum_of_turns_where_nothing_stands():
    problem = problem_of(obstacles=[], start=[0.0, 0.0], goal=[TURN / 4, TURN / 2])
    assert shortest(problem, fill(problem)) == pytest.approx(TURN * 3 / 4)
    assert problem.oracle().figures["fewest_moves_at_most"] == 2


def test_a_goal_in_a_closed_room_is_surely_out_of_reach_and_ends_as_stalled():
    problem = problem_of(
        obstacles=[
            {"shape": "box", "center": [0.0, 1.5], "size": [0.1, 1.2]},
            {"shape": "box", "center": [0.0, -1.5], "size": [0.1, 1.2]},
        ],
        arm={"links": [1.0, 0.7], "radius": 0.02},
        start=[0.0, 0.0],
        goal=[np.pi, 0.0],
    )
    answer = problem.oracle()
    assert (answer.meaning, answer.fitness, answer.solution) == ("lower bound", np.inf, None)
    file = ProblemFile("x", problem.model_dump(exclude_unset=True, mode="json"), Run(stall=10), Path())
    from benchmarks.planners.runs import run

    outcome = run(file, stall=10)
    assert (outcome.status, outcome.feasible) == ("stalled", False)
    assert 0.0 < outcome.fitness < np.pi


def test_the_oracle_is_for_two_links():
    problem = problem_of(start=[0.6, 0.3, 0.1], goal=[5.3, -0.3, 0.2], arm={"links": [0.8, 0.5, 0.4]})
    with pytest.raises(BadInput, match="the oracle of arm-path is for 2 links"):
        problem.oracle()


# Coding ---------------------------------------------------------------------------------------------------------------
@given(st.integers(0, 2**32), st.integers(1, 200), st.sampled_from(["one-point", "uniform"]), st.floats(0.0, 1.0))
@settings(max_examples=60)
def test_numbers_grow_finer_and_the_operator_agrees(seed, generation, crossover, rate):
    coding = CoarseToFine(parameters=5, bits=8, coarse=3)
    keys = Keys(np.arange(2), np.uint64(seed), generation)
    demes = coding.random(keys, 6)
    assert not (coding.integers(demes.reshape(12, -1)) % 32).any()
    couples = demes.reshape(2, 3, 2, -1).copy()
    recipe = Recipe(crossover, rate)
    offspring = coding.recombine(couples, recipe, keys)
    leading = 8 if generation >= FINER_AT[-1] else 3 + coding.stage(generation)
    assert not (coding.integers(offspring.reshape(12, -1)) % 2 ** (8 - leading)).any()
    operator, alone = coding.variation(recipe), np.empty_like(offspring[0])
    for row in (0, 1):
        operator.function(couples[row], alone, keys.seed, keys.cells[row], generation, operator.table)
        np.testing.assert_array_equal(alone, offspring[row])


# Example --------------------------------------------------------------------------------------------------------------
def test_the_example_needs_several_moves_and_little_of_configuration_space():
    plan = Plan.of(load(EXAMPLE))
    assert plan.problem.oracle().figures["fewest_moves_at_most"] >= 4
    reports = simulate(plan)
    champion = best_known(reports, "champion")
    solution = plan.problem.merge(
        plan.problem.decode(np.frombuffer(bytearray(champion.genome), np.uint8)), states_of(reports), champion.cell
    )
    assert champion.fitness == 0.0
    assert plan.problem.check(solution).feasible
    assert 0.0 < solution["cspace_evaluated"] < 0.2


def test_the_template_is_solved_in_words():
    problem = parse(ArmPath.template, "template", Path()).problem()
    solved = next(genome for genome in random_genomes(problem, 500) if problem.evaluate(genome[None])[0] == 0.0)
    words = problem.describe(problem.decode(solved))
    assert "of configuration space evaluated" in words
    assert "joint 1 by" in words
