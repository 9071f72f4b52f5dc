"""The arm-ik planner: its file, its coding, its evaluation, its judge, its oracle and its pictures."""

import itertools
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

import supernode
from genetics import Recipe
from node.plan import Plan
from node.simulation import simulate
from problems import BadInput, ProblemFile, Run, load
from problems.arm_ik import ArmIk, checker
from problems.arm_ik.oracle import enumerate_best, solve_locally
from problems.arm_ik.reach import missed_by, reach_of
from problems.file import parse

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def arm_ik(*links, **fields):
    arm = {"links": links or [1.0, 0.8]} | fields.pop("arm", {})
    return ArmIk.model_validate({"kind": "arm-ik", "target": [0.9, 0.7], "arm": arm} | fields)


def template_problem(**fields):
    file = parse(ArmIk.template, "template.toml", Path())
    return ArmIk.model_validate(file.fields | fields)


def genomes_of(problem, count, seed=0):
    values = np.random.default_rng(seed).integers(0, 1 << problem.bits, (count, len(problem.arm.links)))
    return problem.coding.encode(values)


# Coding ---------------------------------------------------------------------------------------------------------------
def test_a_full_circle_has_no_double_and_limits_are_both_reached():
    circle = arm_ik(1.0, bits=2)
    np.testing.assert_allclose(circle.configurations(np.arange(4)[:, None])[:, 0] / np.pi, [0, 0.5, 1, 1.5])
    limited = arm_ik(1.0, bits=2, arm={"limits": [[-1.5, 1.5]]})
    np.testing.assert_allclose(limited.configurations(np.arange(4)[:, None])[:, 0], [-1.5, -0.5, 0.5, 1.5])


@given(st.integers(1, 62), st.sampled_from(["binary", "gray"]), st.data())
@settings(max_examples=60)
def test_codes_come_back_as_angles(bits, code, data):
    problem = arm_ik(1.0, 0.8, 0.6, bits=bits, code=code)
    values = data.draw(st.lists(st.integers(0, (1 << bits) - 1), min_size=3, max_size=3))
    solution = problem.decode(problem.coding.encode(np.array([values]))[0])
    expected = [2 * np.pi * value / 2**bits for value in values]
    np.testing.assert_allclose(solution["configuration"], expected, rtol=1e-15)


def test_the_paper_codes_in_binary_and_the_tuned_recipe_in_gray_unless_the_file_chooses():
    problem = arm_ik()
    assert problem.for_recipe("paper", 1).coding.gray is False
    assert problem.for_recipe("tuned", 1).coding.gray is True
    assert arm_ik(code="gray").for_recipe("paper", 1).coding.gray is True
    _ = problem.coding
    assert problem.for_recipe("paper", 1).coding.gray is False, "a coding asked for before must not stick"


def test_recipes():
    problem = arm_ik()
    assert problem.recipe("paper", 100) == Recipe("one-point", "one-bit", "offspring")
    assert problem.recipe("paper", 1) == Recipe("one-point", 1 / 16, "offspring")
    assert problem.recipe("tuned", 1) == Recipe("uniform", 0.15, "elitist")
    assert problem.recipe("tuned", 20) == Recipe("uniform", 0.25, "elitist")


# Evaluation -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["arm-ik.toml", "arm-ik-6.toml"])
def test_a_batch_is_evaluated_as_one_by_one(name):
    problem = load(EXAMPLES / name).problem()
    genomes = genomes_of(problem, 300)
    together = problem.evaluate(genomes)
    alone = [problem.evaluate(genome[None])[0] for genome in genomes]
    np.testing.assert_array_equal(together, alone)
    assert 0 < np.isinf(together).sum() < 300


def test_genomes_may_be_read_only():
    problem = arm_ik()
    genome = np.frombuffer(b"\x12\x34", np.uint8)
    assert problem.evaluate(genome[None])[0] == pytest.approx(problem.decode(genome)["distance"])


@given(st.data(), st.integers(1, 12), st.booleans())
@settings(max_examples=100)
def test_some_code_is_within_its_step_of_any_reachable_point(data, bits, limited):
    links = data.draw(st.lists(st.floats(0.1, 2.0), min_size=1, max_size=4))
    limits = {"limits": [[-2.0, 1.0]] * len(links)} if limited else {}
    problem = arm_ik(*links, bits=bits, self_collision=False, arm=limits)
    lowest, ranges = problem.joint_ranges
    shares = np.array(data.draw(st.lists(st.floats(0, 1), min_size=len(links), max_size=len(links))))
    nearest = np.rint(shares * problem.steps).astype(np.int64)
    nearest = np.minimum(nearest, (1 << bits) - 1) if limited else nearest % (1 << bits)
    reached = problem.arm.base + tip(links, lowest + shares * ranges)
    aimed = problem.model_copy(update={"target": tuple(reached)})
    assert aimed.distances(problem.configurations(nearest[None]))[0] <= aimed.code_step * (1 + 1e-9)


@pytest.mark.parametrize("limits", [{}, {"limits": [[-2.0, 1.0], [-0.5, 0.5]]}])
def test_the_default_target_is_the_codes_step_or_a_millimetre_and_says_which(limits):
    coarse = arm_ik(1.0, 0.8, bits=8, arm=limits)
    assert coarse.solved_at == coarse.code_step > 1e-3
    needed = int(re.search(r"m from the target, the code's step: .*; (\d+) bits allow 1 mm", coarse.solved_when)[1])
    for bits, of_the_code in ((needed - 1, True), (needed, False), (30, False)):
        problem = arm_ik(1.0, 0.8, bits=bits, arm=limits)
        assert (problem.code_step > 1e-3) == of_the_code
        assert problem.solved_at == (problem.code_step if of_the_code else 1e-3)
        assert problem.solved_when.startswith("m from the target" if of_the_code else "1 mm from the target")


def test_a_code_whose_step_is_half_of_the_reach_makes_no_target():
    assert arm_ik(1.0, 0.8, bits=4).solved_at == pytest.approx(2.6 * np.pi / 16)
    crude = arm_ik(1.0, 0.8, bits=3)
    assert crude.solved_at is None
    assert crude.solved_when == (
        "the code's step is too coarse for one: half a step of 3 bits in each joint moves the stretched arm's tip by "
        "1.02 m, 57% of its reach"
    )


def tip(links, angles):
    headings = np.cumsum(angles)
    return np.array([links @ np.cos(headings), links @ np.sin(headings)])


def test_a_solution_in_words():
    words = arm_ik().describe({"configuration": [0.5, 1.0], "tip": [1.0, 2.0], "distance": 0.25})
    assert words == "tip at (1.0000, 2.0000) m, 0.25 m from the target\njoints at 0.5000, 1.0000 rad"


# Judge ----------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["arm-ik.toml", "arm-ik-6.toml"])
def test_the_judge_agrees_with_the_evaluation(name):
    problem = load(EXAMPLES / name).problem()
    genomes = genomes_of(problem, 300, seed=1)
    for genome, fitness in zip(genomes, problem.evaluate(genomes), strict=True):
        verdict = problem.check(problem.decode(genome))
        assert verdict.fitness == pytest.approx(fitness, abs=1e-12)
        assert verdict.feasible == np.isfinite(fitness)


def test_the_judge_agrees_for_bare_links():
    problem = template_problem(arm={"links": [1.0, 0.8, 0.5], "radius": 0.0})
    genomes = genomes_of(problem, 500, seed=2)
    verdicts = [problem.check(problem.decode(genome)).fitness for genome in genomes]
    fitness = problem.evaluate(genomes)
    np.testing.assert_allclose(verdicts, fitness, atol=1e-12)
    assert 0 < np.isinf(fitness).sum() < 500


def lattice_world(generator):
    """Whole numbers and eighths of a turn, so that shapes often just touch."""
    links = generator.choice([1.0, 2.0, 3.0, np.sqrt(2)], generator.integers(1, 5)).tolist()
    radius = float(generator.choice([0.0, 0.0, 0.25, 0.5, 1.0]))
    centers = generator.integers(-4, 5, (3, 2)).tolist()
    corners = generator.integers(-4, 5, (3, 2)).tolist()
    obstacles = [
        {"shape": "circle", "center": centers[0], "radius": float(generator.choice([0.5, 1.0, np.sqrt(2)]))},
        {"shape": "box", "center": centers[1], "size": generator.integers(1, 4, 2).tolist(), "angle": np.pi / 4},
        {"shape": "box", "center": centers[2], "size": generator.integers(1, 4, 2).tolist()},
        {"shape": "polygon", "vertices": corners},
    ]
    try:
        return arm_ik(*links, arm={"radius": radius}, obstacles=obstacles)
    except ValueError:  # the base stands in an obstacle, or the corners are in a line
        return lattice_world(generator)


def test_the_judge_agrees_with_the_evaluation_on_what_only_touches():
    generator = np.random.default_rng(8)
    hit = 0
    for _ in range(150):
        problem = lattice_world(generator)
        eighths = generator.integers(0, 8, (20, len(problem.arm.links)))
        genomes = problem.coding.encode(eighths << (problem.bits - 3))
        for genome, fitness in zip(genomes, problem.evaluate(genomes), strict=True):
            verdict = problem.check(problem.decode(genome))
            assert np.isinf(fitness) == np.isinf(verdict.fitness), (problem, problem.decode(genome), verdict)
            hit += np.isinf(fitness)
    assert 500 < hit < 2500


def test_the_judge_lets_contact_pass():
    table = {"shape": "box", "center": [0, -0.6], "size": [9, 1]}  # its upper side on y = -0.1
    lying = {"configuration": [0.0, 0.0], "tip": [1.8, 0.0], "distance": 0.0}
    problem = arm_ik(target=[1.8, 0.0], obstacles=[table], arm={"radius": 0.1})
    assert problem.distances(np.zeros((1, 2)))[0] == 0
    assert problem.check(lying).feasible
    thicker = arm_ik(target=[1.8, 0.0], obstacles=[table], arm={"radius": 0.1, "base": [0, -1e-10]})
    assert thicker.check(lying).feasible


FAULTS = {
    "tip": ({"tip": [0.5, 1.0]}, "the tip is at"),
    "distance": ({"distance": 0.0}, "distance to the target is"),
    "collision": ({"configuration": [2.6, 0.0]}, "link 1 is in obstacles[1]"),
    "limits": ({"configuration": [1.8162332528565992 - 2 * np.pi, 4.565126824747668]}, "outside its limits"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_the_judge_rejects_a_corrupted_solution(fault):
    fields = load(EXAMPLES / "arm-ik.toml").fields
    limits = {"limits": [[0, 6.3], [0, 6.3]]}
    problem = ArmIk.model_validate(fields | {"arm": fields["arm"] | limits})
    sound = {"configuration": [1.8162332528565992, 4.565126824747668], "tip": [0.5531676014344937, 1.048444965458192]}
    sound["distance"] = float(np.hypot(sound["tip"][0] - 0.55, sound["tip"][1] - 1.05))
    assert problem.check(sound).feasible
    change, expected = FAULTS[fault]
    verdict = problem.check(sound | change)
    assert not verdict.feasible
    assert any(expected in objection for objection in verdict.objections)
    assert np.isinf(verdict.fitness) == (fault == "collision")


def test_the_judge_rejects_links_that_cross():
    problem = arm_ik(1.0, 1.0, 1.0)
    angles = [0, 3 * np.pi / 4, 3 * np.pi / 4]
    x, y = tip(np.ones(3), angles)
    solution = {"configuration": angles, "tip": [x, y], "distance": float(np.hypot(x - 0.9, y - 0.7))}
    assert problem.check(solution).objections == ("links 1 and 3 touch",)
    assert problem.model_copy(update={"self_collision": False}).check(solution).feasible


@pytest.mark.parametrize(
    ("solution", "complaint"),
    [
        ({}, "configuration: expected this field, found nothing"),
        ({"configuration": [0.0], "tip": [0, 0], "distance": 0}, "configuration: expected 2 angles, found 1"),
        ({"configuration": [0.0, "a"], "tip": [0, 0], "distance": 0}, "configuration[1]: expected a valid number"),
        ({"configuration": [0, float("nan")], "tip": [0, 0], "distance": 0}, "expected a finite number"),
        ({"configuration": [0, 0], "tip": [0], "distance": 0}, "tip: expected 2 values, found 1: [0]"),
        ({"configuration": [0, 0], "tip": [0, 0], "distance": -1}, "distance: expected greater than or equal to 0"),
        ({"genome": "00"}, "expected"),
    ],
)
def test_what_is_no_solution_at_all_is_refused(solution, complaint):
    with pytest.raises(BadInput) as refused:
        arm_ik().check(solution)
    assert str(refused.value).startswith("solution: ")
    assert complaint in str(refused.value)
    assert "\n" not in str(refused.value)


# Oracle ---------------------------------------------------------------------------------------------------------------
def test_enumeration_equals_brute_force_by_the_judge():
    problem = template_problem(bits=5)
    best = np.inf
    for codes in itertools.product(range(32), repeat=2):
        angles = [2 * np.pi * code / 32 for code in codes]
        x, y = tip(np.array(problem.arm.links), angles)
        distance = float(np.hypot(x - problem.target[0], y - problem.target[1]))
        best = min(best, problem.check({"configuration": angles, "tip": [x, y], "distance": distance}).fitness)
    fitness, configuration = enumerate_best(problem)
    assert fitness == pytest.approx(best, abs=1e-12)
    assert problem.distances(configuration[None])[0] == pytest.approx(fitness, abs=1e-12)


@pytest.mark.parametrize(("links", "bits"), [([1.0], 10), ([1.0, 0.8], 7), ([1.0, 0.8, 0.5], 4), ([0.9] * 4, 3)])
@pytest.mark.parametrize("limited", [False, True])
def test_enumeration_finds_the_best_that_evaluation_knows(links, bits, limited):
    limits = {"limits": [[-2.0, 2.5]] * len(links)} if limited else {}
    problem = template_problem(arm={"links": links, "radius": 0.04} | limits, bits=bits)
    everything = itertools.product(range(1 << bits), repeat=len(links))
    best = problem.distances(problem.configurations(np.array(list(everything)))).min()
    assert enumerate_best(problem)[0] == pytest.approx(best, abs=1e-12)


def test_enumeration_is_of_few_bits():
    with pytest.raises(BadInput, match="enumeration: expected at most 22 bits in all, found 24"):
        enumerate_best(arm_ik(bits=12))


def test_the_oracle_of_few_codes_enumerates_them():
    problem = template_problem()
    answer = problem.oracle()
    assert (answer.meaning, answer.method) == ("optimum", "enumeration of all 65536 coded configurations")
    verdict = problem.check(json.loads(json.dumps(answer.solution)))
    assert verdict.feasible
    assert verdict.fitness == pytest.approx(answer.fitness, abs=1e-12)


def test_the_oracle_knows_when_no_code_is_free():
    cage = [{"shape": "circle", "center": [0.3 * np.cos(a), 0.3 * np.sin(a)], "radius": 0.2} for a in range(7)]
    answer = arm_ik(obstacles=cage, bits=4).oracle()
    assert (answer.meaning, answer.fitness, answer.solution) == ("optimum", np.inf, None)


def test_the_oracle_of_many_codes_hits_the_target():
    problem = load(EXAMPLES / "arm-ik-6.toml").problem()
    answer = problem.oracle()
    assert (answer.meaning, answer.figures) == ("optimum", {"lower_bound": 0.0})
    assert answer.fitness < 1e-6
    verdict = problem.check(json.loads(json.dumps(answer.solution)))
    assert verdict.feasible
    assert verdict.fitness == pytest.approx(answer.fitness, abs=1e-9)


def test_the_oracle_of_many_codes_stretches_for_what_is_out_of_reach():
    answer = arm_ik(1.0, 0.7, 0.5, target=[2.0, 2.0]).oracle()
    assert answer.meaning == "optimum"
    assert answer.fitness == pytest.approx(np.hypot(2, 2) - 2.2, abs=1e-6)
    assert answer.figures["lower_bound"] == pytest.approx(np.hypot(2, 2) - 2.2)


def test_the_oracle_of_many_codes_gives_bounds_where_obstacles_are_in_the_way():
    post = {"shape": "circle", "center": [0.9, 0.7], "radius": 0.3}
    problem = arm_ik(1.0, 0.7, 0.5, obstacles=[post], arm={"radius": 0.05})
    answer = problem.oracle()
    assert (answer.meaning, answer.figures) == ("upper bound", {"lower_bound": 0.0})
    assert answer.fitness == pytest.approx(0.35, abs=1e-3), "the tip touches the post"
    assert problem.check(json.loads(json.dumps(answer.solution))).feasible


def test_the_oracle_of_many_codes_says_so_if_it_finds_nothing_free():
    cage = [{"shape": "circle", "center": [0.3 * np.cos(a), 0.3 * np.sin(a)], "radius": 0.2} for a in range(7)]
    answer = arm_ik(1.0, 0.7, 0.5, obstacles=cage, target=[3.0, 0.0]).oracle()
    assert (answer.meaning, answer.solution) == ("lower bound", None)
    assert answer.fitness == pytest.approx(0.8)


@pytest.mark.parametrize("limited", [False, True])
def test_the_local_solver_is_as_good_as_enumeration(limited):
    """Codes are some of all configurations; where it is worse it is stuck in a local minimum."""
    limits = {"limits": [[-2.0, 2.5]] * 3} if limited else {}
    for target in ([1.2, 0.9], [-0.6, 1.4], [0.3, -0.2], [-1.7, -0.9]):
        problem = template_problem(target=target, arm={"links": [1.0, 0.7, 0.5], "radius": 0.04} | limits, bits=5)
        configuration = solve_locally(problem)
        assert problem.distances(configuration[None])[0] <= enumerate_best(problem)[0] + 1e-9


def test_reach_in_closed_form():
    assert missed_by(arm_ik(1.0, 0.5, target=[2.0, 0.0])) == pytest.approx(0.5)
    assert missed_by(arm_ik(1.0, 0.5, target=[0.1, 0.0])) == pytest.approx(0.4)
    assert missed_by(arm_ik(1.0, 0.5, 0.7, target=[0.1, 0.0])) == 0
    problem = arm_ik(1.0, 0.5, target=[0.1, 0.0], bits=10)
    assert 0 <= enumerate_best(problem)[0] - missed_by(problem) < problem.solved_at


@pytest.mark.parametrize("links", [[1.0], [1.0, 0.8], [0.3, 1.4], [1.0, 0.4, 0.3], [0.2, 0.5, 1.6, 0.1]])
@pytest.mark.parametrize("limits", [None, [-2.0, 0.5], [2.5, 4.0], [0.3, 1.2], [-7.0, -3.0], [1.0, 8.0]])
def test_no_tip_leaves_the_reach(links, limits):
    limited = {} if limits is None else {"limits": [[0.0, 6.0]] * (len(links) - 1) + [limits]}
    problem = arm_ik(*links, arm={"base": [0.5, -1.0]} | limited)
    lowest, ranges = problem.joint_ranges
    samples = lowest + ranges * np.random.default_rng(1).random((4000, len(links)))
    away = [abs(checker.joints_of(problem.arm, sample)[-1] - complex(0.5, -1.0)) for sample in samples]
    nearest, farthest = reach_of(problem.arm)
    assert nearest - 1e-12 <= min(away), (nearest, min(away))
    assert max(away) <= farthest + 1e-12, (farthest, max(away))
    if len(links) == 2:
        assert (min(away), max(away)) == pytest.approx((nearest, farthest), abs=5e-3), "both are reached"


UNREACHABLE = [
    ([3.0, 0.0], {}, "expected a point at most 1.8 m from arm.base [0.0, 0.0], the reach of links [1.0, 0.8], found"),
    ([0.1, 0.0], {}, "expected a point at least 0.2 m from arm.base"),
    ([0.6, 0.0], {"limits": [[-3.0, 3.0], [-2.0, 2.0]]}, "expected a point at least 0.986998 m"),
    ([1.801, 0.0], {}, None),  # as near as a target of 1 mm asks
    ([1.8011, 0.0], {}, "expected a point at most 1.8 m"),
    ([0.6, 0.0], {"limits": [[-3.0, 3.0], [-2.6, 2.6]]}, None),
]


@pytest.mark.parametrize(("target", "arm", "complaint"), UNREACHABLE)
def test_a_target_out_of_reach_is_refused(target, arm, complaint):
    fields = arm_ik(target=target, arm=arm, bits=14).model_dump(mode="json", exclude_unset=True)
    file = ProblemFile("arm.toml", fields, Run(), Path())
    if complaint is None:
        return file.refuse_unreachable()
    with pytest.raises(BadInput, match=re.escape(f"arm.toml: target: {complaint}")):
        file.refuse_unreachable()
    file.with_run(target=-1.0).refuse_unreachable()
    return None


def test_the_target_that_the_refusal_names_is_reached():
    problem = arm_ik(target=[3.0, 0.0])
    named = float(re.search(r"target to (\S+) ", problem.unreachable)[1])
    assert problem.solved_at + 1.2 <= named <= problem.solved_at + 1.201
    assert supernode.simulate(problem, target=named).solved
    with pytest.raises(BadInput, match="target: expected a point at most"):
        supernode.simulate(problem)


def test_a_code_too_coarse_for_a_target_is_not_refused():
    assert arm_ik(target=[3.0, 0.0], bits=1).unreachable is None


# Files ----------------------------------------------------------------------------------------------------------------
HEAD = 'kind = "arm-ik"\ntarget = [1, 1]\n'
BAD_FILES = [
    ('kind = "arm-ik"\n[arm]\nlinks = [1]', "target: expected this field, found nothing"),
    (HEAD, "arm: expected this field, found nothing"),
    (HEAD + "[arm]\nlinks = []", "arm.links: expected at least 1 item, found []"),
    (HEAD + "[arm]\nlinks = [1, 0]", "arm.links[1]: expected greater than 0, found 0"),
    (HEAD + "[arm]\nlinks = [1, -2]", "arm.links[1]: expected greater than 0, found -2"),
    (HEAD + "[arm]\nlinks = [1, nan]", "arm.links[1]: expected a finite number, found NaN"),
    (HEAD + "[arm]\nlinks = [1, inf]", "arm.links[1]: expected a finite number, found Infinity"),
    (HEAD + '[arm]\nlinks = [1, "2"]', 'arm.links[1]: expected a valid number, found "2"'),
    (HEAD + "[arm]\nlinks = [1]\nradius = -1", "arm.radius: expected greater than or equal to 0, found -1"),
    (HEAD + "[arm]\nlinks = [1, 1]\nlimits = [[0, 1]]", "for each of 2 links, found 1"),
    (HEAD + "[arm]\nlinks = [1]\nlimits = [[1, 0]]", "arm.limits: expected lowest < highest for joint 1, found [1"),
    (HEAD + "[arm]\nlinks = [1]\nlimits = [[0, nan]]", "arm.limits[0][1]: expected a finite number, found NaN"),
    (HEAD + "[arm]\nlinks = [1]\nlength = 3", "arm.length: unknown field"),
    (HEAD + "speed = 3\n[arm]\nlinks = [1]", "speed: unknown field, expected one of kind, unit, code"),
    (HEAD + "bits = 0\n[arm]\nlinks = [1]", "bits: expected greater than or equal to 1, found 0"),
    (HEAD + "bits = 63\n[arm]\nlinks = [1]", "bits: expected less than or equal to 62, found 63"),
    (HEAD + "bits = 8.5\n[arm]\nlinks = [1]", "bits: expected a valid integer, found 8.5"),
    (HEAD + 'code = "grey"\n[arm]\nlinks = [1]', "code: expected 'binary' or 'gray', found \"grey\""),
    ('kind = "arm-ik"\ntarget = [1, nan]\n[arm]\nlinks = [1]', "target[1]: expected a finite number, found NaN"),
    ('kind = "arm-ik"\ntarget = [1, inf]\n[arm]\nlinks = [1]', "target[1]: expected a finite number, found Infinity"),
    ('kind = "arm-ik"\ntarget = [1]\n[arm]\nlinks = [1]', "target: expected 2 values, found 1: [1]"),
    (
        HEAD + '[arm]\nlinks = [1]\n[[obstacles]]\nshape = "circle"\ncenter = [0.1, 0]\nradius = 0.2',
        "arm.base: expected a place clear of the obstacles by the arm's radius 0, found [0.0, 0.0] in obstacles[0]",
    ),
    (
        HEAD + '[arm]\nlinks = [1]\nradius = 0.1\n[[obstacles]]\nshape = "box"\ncenter = [0.55, 0]\nsize = [1, 1]',
        "arm.base: expected a place clear of the obstacles by the arm's radius 0.1, found [0.0, 0.0] in obstacles[0]",
    ),
    (HEAD + "[arm]\nlinks = [1, 0.1, 1]\nradius = 0.1", "arm.links: expected inner links at least as long as twice"),
    (HEAD + '[arm]\nlinks = [1]\n[[obstacles]]\nshape = "polygon"\nvertices = []', "at least 3 vertices, found 0"),
    (HEAD + '[arm]\nlinks = [1]\n[[obstacles]]\nshape = "blob"', "obstacles[0].shape: expected one of 'circle',"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "complaint"), BAD_FILES)
def test_a_bad_file_gives_one_clear_line(tmp_path, text, complaint):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(BadInput) as refused:
        load(path)
    message = str(refused.value)
    assert message.startswith(f"{path}: ")
    assert complaint in message
    assert "found" in message or "unknown field, expected" in message
    assert "\n" not in message


def test_a_base_in_contact_with_an_obstacle_is_fine():
    floor = {"shape": "box", "center": [0, -1.1], "size": [4, 2]}
    assert arm_ik(obstacles=[floor], arm={"radius": 0.1})
    assert arm_ik(obstacles=[floor | {"center": [0, -1.0]}])


def test_every_field_says_what_it_is_and_in_which_unit():
    schema = ArmIk.model_json_schema()
    for table in (schema, schema["$defs"]["Arm"]):
        for name, field in table["properties"].items():
            assert field["description"], name
            assert "unit" in field or name == "kind", name


def test_reading_a_file_compiles_no_kernel_of_this_planner():
    program = (
        "import sys; from problems import load; load(sys.argv[1]).problem(); "
        "sys.exit('problems.arm_ik.kernels' in sys.modules or 'matplotlib' in sys.modules)"
    )
    root = Path(__file__).resolve().parents[2]
    subprocess.run([sys.executable, "-c", program, EXAMPLES / "arm-ik.toml"], cwd=root, check=True)


# Runs -----------------------------------------------------------------------------------------------------------------
def solve(file, seed):
    plan = Plan.of(file.with_run(seed=seed))
    champion = simulate(plan)[0].champion
    assert champion is not None
    return plan.problem, np.frombuffer(champion.genome, np.uint8), champion.fitness


@pytest.mark.parametrize("name", ["arm-ik.toml", "arm-ik-6.toml", "the template"])
def test_examples_are_solved_whatever_the_seed(name):
    file = parse(ArmIk.template, name, Path()) if name == "the template" else load(EXAMPLES / name)
    assert file.run.deme == 1
    assert file.run.topology == "torus 4x4"
    for seed in range(1, 21):
        problem, genome, fitness = solve(file, seed)
        assert fitness <= problem.solved_at
        verdict = problem.check(problem.decode(genome))
        assert verdict.feasible
        assert verdict.fitness == pytest.approx(fitness, abs=1e-12)


@pytest.mark.parametrize("name", ["arm-ik.toml", "arm-ik-6.toml"])
@pytest.mark.parametrize("solved", [True, False])
def test_pictures(name, solved, tmp_path):
    problem = load(EXAMPLES / name).problem()
    populations = {0: genomes_of(problem, 64), 9: genomes_of(problem, 64, seed=5)}
    figure = Figure()
    problem.draw(figure, problem.decode(populations[9][0]) if solved else None, populations if solved else {})
    assert len(figure.axes) == (2 if len(problem.arm.links) == 2 else 1)
    figure.savefig(tmp_path / "picture.png")
    if solved and len(problem.arm.links) == 2:
        labels = [text.get_text() for text in figure.legends[0].get_texts()]
        assert labels == ["exact solution", "generation 0", "generation 9", "found"]
