"""Known functions: their values, files, codings, judge and recipes."""

import itertools
import json
import time
from pathlib import Path

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from genetics import BitString, Keys, RealVector
from node.plan import Plan
from node.simulation import simulate
from problems import BadInput, load
from problems.file import parse
from problems.function import Function, kernels
from problems.function.graph import Graph

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "rastrigin.toml"
REAL = ["rastrigin", "sphere", "ackley", "rosenbrock"]
GRAPH = {"vertices": 30, "parts": 3, "seed": 5}
EVERY = [
    *({"name": name, "dimension": 4, "bits": bits} for name in REAL for bits in (0, 7)),
    {"name": "onemax", "dimension": 21},
    {"name": "trap", "dimension": 20},
    {"name": "graph-partition", "graph": GRAPH},
]


def function(**fields):
    return Function.model_validate({"kind": "function"} | fields)


def genomes_of(problem, count, seed=3):
    return problem.coding.random(Keys(np.arange(count), seed, 0), 1)[:, 0]


def label(fields):
    return fields["name"] + (" coded" if fields.get("bits") else "")


@pytest.mark.parametrize("fields", EVERY, ids=label)
def test_every_function_has_a_compiled_fitness_even_if_it_is_to_cost_time(fields):
    problem = function(**fields)
    genomes = genomes_of(problem, 200)
    assert problem.fitness_kernel.fitness(genomes).tobytes() == problem.evaluate(genomes).tobytes()
    costly = function(**fields, cost_us=0.5)
    assert costly.fitness_kernel.fitness(genomes).tobytes() == problem.evaluate(genomes).tobytes()
    assert costly.evaluate(genomes).tobytes() == problem.evaluate(genomes).tobytes()


# Values ---------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("name", "x", "expected"),
    [
        ("sphere", [1, 2, 3], 14),
        ("rastrigin", [0, 0, 0], 0),
        ("rastrigin", [1, 0, -2], 5),
        ("rastrigin", [0.5, 0, 0], 20.25),
        ("ackley", [0, 0, 0], 0),
        ("ackley", [1, 1, 1], 20 - 20 * np.exp(-0.2)),
        ("rosenbrock", [1, 1, 1], 0),
        ("rosenbrock", [0, 0, 0], 2),
        ("rosenbrock", [-1, 2, 0], 100 + 4 + 1600 + 1),
    ],
)
def test_values_of_the_literature(name, x, expected):
    genome = np.array([x], float).view(np.uint8)
    assert function(name=name, dimension=3).evaluate(genome)[0] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("bits", "expected"), [("11111" * 2, 0), ("1111111110", 5), ("00000" * 2, 2), ("0101011111", 3)]
)
def test_a_trap_leads_away_from_its_optimum(bits, expected):
    problem = function(name="trap", dimension=10)
    genome = problem.coding.encode(np.array([[int(bit) for bit in bits]]))
    assert problem.evaluate(genome)[0] == expected


def test_onemax_counts_zeros():
    problem = function(name="onemax", dimension=12)
    genome = problem.coding.encode(np.array([[1, 0, 1] * 4]))
    assert problem.evaluate(genome)[0] == 4


@pytest.mark.parametrize("length", [*range(1, 18), 63, 64, 65])
def test_onemax_counts_the_zeros_of_any_number_of_bits(length):
    problem = function(name="onemax", dimension=length)
    bits = np.random.default_rng(length).integers(0, 2, (50, length))
    bits[0], bits[1] = 0, 1
    assert problem.evaluate(problem.coding.encode(bits)).tolist() == (length - bits.sum(axis=1)).tolist()


@pytest.mark.parametrize("fields", EVERY, ids=label)
def test_the_judge_agrees_with_the_evaluation(fields):
    problem = function(**fields)
    genomes = genomes_of(problem, 200)
    together = problem.evaluate(genomes)
    for genome, fitness in zip(genomes, together, strict=True):
        assert problem.evaluate(genome[None])[0] == fitness
        verdict = problem.check(problem.decode(genome))
        assert verdict.objections == ()
        assert verdict.fitness == pytest.approx(fitness, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("dimension", [1, 7, 8, 10, 33])
def test_rastrigin_is_exact_arithmetic_whatever_lies_beside_a_genome(dimension):
    points = np.random.default_rng(dimension).uniform(-5.12, 5.12, (100, dimension))
    points[:4] = np.array([[0.5], [-5.12], [1e-9], [-3.0]])
    problem = function(name="rastrigin", dimension=dimension)
    together = problem.evaluate(points.view(np.uint8))
    in_python = [sum((x * x + 10.0 * kernels._wave.py_func(x) for x in point), 0.0) for point in points]
    assert together.tolist() == in_python, "no machine may fuse, reorder or approximate"
    long = points.astype(np.longdouble)
    sines = np.sin(np.longdouble("3.14159265358979323846264338327950288") * (long - np.rint(long)))
    np.testing.assert_allclose(together, np.sum(long**2 + 20 * sines**2, axis=1).astype(float), rtol=1e-14)
    room = np.empty(points.size + 8)
    for shift in range(8):  # to any place within the widest registers
        shifted = room[shift : shift + points.size].reshape(points.shape)
        shifted[...] = points
        np.testing.assert_array_equal(problem.evaluate(shifted.view(np.uint8)), together)
        np.testing.assert_array_equal(problem.evaluate(points[shift:50].view(np.uint8)), together[shift:50])


def test_coded_rastrigin_is_by_the_cosine_of_the_library():
    problem = function(name="rastrigin", dimension=4, bits=9)
    genomes = genomes_of(problem, 50)
    wave = numba.njit(lambda x: x * x + 10.0 * (1.0 - np.cos(2.0 * np.pi * x)))
    expected = [sum(map(wave, point.tolist()), 0.0) for point in problem.points(genomes)]
    assert problem.evaluate(genomes).tolist() == expected


@given(st.integers(1, 62), st.sampled_from(["binary", "gray"]), st.data())
@settings(max_examples=50)
def test_coded_numbers_reach_both_bounds_in_even_steps(bits, code, data):
    problem = function(name="ackley", dimension=1, bits=bits, code=code)
    value = data.draw(st.integers(0, (1 << bits) - 1))
    ends = problem.points(problem.coding.encode(np.array([[0], [(1 << bits) - 1], [value]])))[:, 0]
    assert ends[0] == -32.768
    assert ends[1] == pytest.approx(32.768)
    assert ends[2] == pytest.approx(-32.768 + 65.536 * value / ((1 << bits) - 1), abs=1e-9)


@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("bits", [1, 2, 7, 30, 62])
def test_coded_numbers_can_be_solved(name, bits):
    problem = function(name=name, dimension=3, bits=bits)
    best = 1.0 if name == "rosenbrock" else 0.0
    low, high = problem.bounds
    nearest = round((best - low) / (high - low) * ((1 << bits) - 1))
    fitness = problem.evaluate(problem.coding.encode(np.full((1, 3), nearest)))[0]
    assert fitness <= problem.solved_at <= fitness + 2e-9
    if bits == 2 and name != "rosenbrock":
        every = problem.coding.encode(np.indices((4, 4, 4)).reshape(3, -1).T)
        assert fitness == pytest.approx(problem.evaluate(every).min())


def test_targets():
    assert function(name="sphere").solved_at == 1e-2
    assert function(name="trap").solved_at == 0
    assert function(name="graph-partition", graph=GRAPH).solved_at == 0


def test_codings():
    assert function(name="sphere", dimension=3).coding == RealVector(3, -5.12, 5.12)
    assert function(name="sphere", dimension=3, bits=9).for_recipe("paper", 1).coding == BitString(3, 9)
    assert function(name="sphere", dimension=3, bits=9).for_recipe("tuned", 1).coding == BitString(3, 9, gray=True)
    assert function(name="onemax", dimension=9).coding == BitString(9, 1)
    assert function(name="graph-partition", graph=GRAPH).coding == BitString(30, 2)


# Graphs ---------------------------------------------------------------------------------------------------------------
def test_a_graph_is_planted_as_asked():
    graph = Graph(vertices=400, parts=4, p_in=0.4, p_out=0.1, seed=9)
    assert np.bincount(graph.planted).tolist() == [100] * 4
    assert np.all(graph.edges[:, 0] < graph.edges[:, 1])
    inside = 4 * 100 * 99 / 2
    between = 400 * 399 / 2 - inside
    assert graph.planted_cut == pytest.approx(0.1 * between, rel=0.03)
    assert len(graph.edges) - graph.planted_cut == pytest.approx(0.4 * inside, rel=0.03)


def test_the_same_numbers_give_the_same_graph_and_another_seed_another():
    one, same, other = (Graph(vertices=30, seed=seed) for seed in (7, 7, 8))
    np.testing.assert_array_equal(one.edges, same.edges)
    assert one.edges.tolist() != other.edges.tolist()
    assert one.edges[:5].tolist() == [[0, 2], [0, 3], [0, 11], [0, 12], [0, 25]], (
        "the stream of numbers must not change"
    )


def test_the_planted_partition_has_fitness_0_whatever_its_labels():
    problem = function(name="graph-partition", graph={"vertices": 31, "parts": 3})
    planted = problem.graph.planted
    for labels in (planted, (planted + 1) % 3, np.where(planted == 0, 3, planted)):
        assert problem.evaluate(problem.coding.encode(labels[None]))[0] == 0


def test_imbalance_costs():
    problem = function(name="graph-partition", graph={"vertices": 10, "p_in": 0.0, "p_out": 0.0})
    for ones in range(11):
        labels = (np.arange(10) < ones).astype(np.int64)
        assert problem.evaluate(problem.coding.encode(labels[None]))[0] == 2 * (ones - 5) ** 2


# Judge ----------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("fields", "change", "complaint"),
    [
        ({"name": "sphere", "dimension": 2}, {"value": 1.0}, "the value is"),
        ({"name": "sphere", "dimension": 2}, {"x": [6.0, 0.0], "value": 36.0}, "x[0] is 6, outside [-5.12, 5.12]"),
        ({"name": "onemax", "dimension": 4}, {"bits": "1111"}, "the value is 0, not"),
        ({"name": "graph-partition", "graph": GRAPH}, {"cut": 1}, "by the planted partition, not 1"),
        ({"name": "graph-partition", "graph": GRAPH}, {"parts": [0] * 30}, "0 edges are cut"),
    ],
)
def test_the_judge_rejects_a_corrupted_solution(fields, change, complaint):
    problem = function(**fields)
    solution = problem.decode(genomes_of(problem, 1)[0])
    assert problem.check(solution).feasible
    verdict = problem.check(solution | change)
    assert not verdict.feasible
    assert any(complaint in objection for objection in verdict.objections)


@pytest.mark.parametrize(
    ("fields", "solution", "complaint"),
    [
        ({"name": "sphere"}, {"x": [0.0], "value": 0}, "x: expected 10 numbers, found 1"),
        ({"name": "sphere"}, {"x": [0.0] * 10}, "value: expected this field, found nothing"),
        ({"name": "sphere"}, {"x": [float("inf")] * 10, "value": 0}, "x[0]: expected a finite number"),
        ({"name": "onemax"}, {"bits": "0102010101", "value": 0}, "bits: "),
        ({"name": "onemax"}, {"bits": "01", "value": 0}, "bits: expected 10 digits, found 2"),
        (
            {"name": "graph-partition", "graph": GRAPH},
            {"parts": [3] * 30, "cut": 0, "planted_cut": 0, "value": 0},
            "parts: expected numbers below 3, found 3",
        ),
        ({"name": "graph-partition", "graph": GRAPH}, {"bits": "1", "value": 0}, "unknown field"),
    ],
)
def test_what_is_no_solution_at_all_is_refused(fields, solution, complaint):
    with pytest.raises(BadInput) as refused:
        function(**fields).check(solution)
    assert str(refused.value).startswith("solution: ")
    assert complaint in str(refused.value)


# Files ----------------------------------------------------------------------------------------------------------------
HEAD = 'kind = "function"\nname = '
BAD_FILES = [
    ('kind = "function"', "name: expected this field, found nothing"),
    (HEAD + '"rastrgin"', "name: expected 'rastrigin', 'sphere'"),
    (HEAD + '"sphere"\ndimension = 0', "dimension: expected greater than or equal to 1, found 0"),
    (HEAD + '"sphere"\nbits = 63', "bits: expected less than or equal to 62, found 63"),
    (HEAD + '"sphere"\nbits = -1', "bits: expected greater than or equal to 0, found -1"),
    (HEAD + '"sphere"\ncost_us = -1', "cost_us: expected greater than or equal to 0, found -1"),
    (HEAD + '"sphere"\ncost_us = nan', "cost_us: expected a finite number, found NaN"),
    (HEAD + '"sphere"\nsize = 3', "size: unknown field, expected one of kind, code, name, dimension"),
    (HEAD + '"sphere"\n[graph]\nvertices = 8', "graph: expected a table [graph] for graph-partition only, found one"),
    (HEAD + '"graph-partition"', "graph: expected a table [graph] for graph-partition only, found nothing"),
    (HEAD + '"graph-partition"\ndimension = 9\n[graph]\nvertices = 8', "dimension: expected none, as the graph has"),
    (HEAD + '"graph-partition"\n[graph]\nvertices = 1', "graph.vertices: expected greater than or equal to 2, found 1"),
    (HEAD + '"graph-partition"\n[graph]\nvertices = 8\nparts = 9', "graph: parts: expected at most the 8 vertices"),
    (HEAD + '"graph-partition"\n[graph]\nvertices = 8\np_in = 1.5', "graph.p_in: expected less than or equal to 1"),
    (HEAD + '"onemax"\nbits = 8', "bits: expected none, as the parameters of onemax are not numbers, found 8"),
    (HEAD + '"trap"\ndimension = 12', "dimension: expected a multiple of 5, the bits of a trap, found 12"),
    (HEAD + '"rosenbrock"\ndimension = 1', "dimension: expected at least 2 for rosenbrock, found 1"),
]


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


def test_every_field_says_what_it_is_and_in_which_unit():
    schema = Function.model_json_schema()
    for table in (schema, schema["$defs"]["Graph"]):
        for name, field in table["properties"].items():
            assert field["description"], name
            assert "unit" in field or name == "kind", name


# Oracle ---------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("fields", EVERY, ids=label)
def test_the_oracle_knows_a_solution_that_solves(fields):
    problem = function(**fields)
    answer = problem.oracle()
    verdict = problem.check(json.loads(json.dumps(answer.solution)))
    assert verdict.feasible
    assert verdict.fitness == pytest.approx(answer.fitness, abs=1e-12)
    assert answer.fitness <= problem.solved_at
    known = problem.graph is None and not (problem.bits and problem.name != "sphere")
    assert answer.meaning == ("optimum" if known else "upper bound")


@pytest.mark.parametrize("fields", [{"name": "onemax", "dimension": 10}, {"name": "trap", "dimension": 10}], ids=label)
def test_no_bits_are_better_than_the_oracle_says(fields):
    problem = function(**fields)
    everything = problem.coding.encode(np.array(list(itertools.product((0, 1), repeat=10))))
    assert problem.evaluate(everything).min() == problem.oracle().fitness


@pytest.mark.parametrize("name", REAL)
def test_no_codes_are_better_than_the_oracle_says(name):
    problem = function(name=name, dimension=2, bits=7)
    everything = problem.coding.encode(np.array(list(itertools.product(range(128), repeat=2))))
    answer = problem.oracle()
    best = problem.evaluate(everything).min()
    assert answer.figures["lower_bound"] <= best <= answer.fitness + 1e-12
    if answer.meaning == "optimum":
        assert best == pytest.approx(answer.fitness, abs=1e-12)


def test_some_partition_is_as_good_as_the_planted_one():
    problem = function(name="graph-partition", graph={"vertices": 10, "p_in": 0.9, "p_out": 0.1})
    everything = problem.coding.encode(np.array(list(itertools.product((0, 1), repeat=10))))
    assert problem.evaluate(everything).min() <= problem.oracle().fitness == 0.0


# Runs -----------------------------------------------------------------------------------------------------------------
def solved_share(file, seeds=20):
    solved = 0
    for seed in range(1, seeds + 1):
        plan = Plan.of(file.with_run(seed=seed))
        champion = simulate(plan)[0].champion
        verdict = plan.problem.check(plan.problem.decode(np.frombuffer(champion.genome, np.uint8)))
        assert verdict.feasible
        solved += verdict.fitness <= plan.problem.solved_at
    return solved / seeds


def test_the_example_is_solved_whatever_the_seed():
    file = load(EXAMPLE)
    assert file.run.topology == "torus 4x4"
    assert solved_share(file) == 1


@pytest.mark.parametrize(
    ("lines", "least"),
    [
        ('name = "onemax"\ndimension = 100', 1.0),
        ('name = "graph-partition"\n[graph]\nvertices = 64', 1.0),
        ('name = "rastrigin"\nbits = 8', 0.9),
        ('name = "trap"\ndimension = 15\n[run]\ndeme = 20', 0.9),
    ],
)
def test_the_default_recipe_solves_other_functions(lines, least):
    assert solved_share(parse(f'kind = "function"\n{lines}', "here", Path()), seeds=10) >= least


def test_the_template_is_valid_and_solved():
    assert solved_share(parse(Function.template, "template", Path()), seeds=5) == 1


def test_evaluations_cost_the_processor_time_asked_for():
    cheap, dear = function(name="sphere"), function(name="sphere", cost_us=2000)
    genomes = genomes_of(cheap, 10)
    np.testing.assert_array_equal(cheap.evaluate(genomes), dear.evaluate(genomes))
    before = time.thread_time()
    dear.evaluate(genomes)
    assert 0.02 <= time.thread_time() - before < 0.04
    before = time.thread_time()
    dear.decode(genomes[0])
    assert time.thread_time() - before < 0.002, "only evaluations are dear"


@pytest.mark.parametrize("fields", [*EVERY, {"name": "sphere", "dimension": 1}], ids=label)
@pytest.mark.parametrize("solved", [True, False])
def test_pictures(fields, solved, tmp_path):
    problem = function(**fields)
    genomes = genomes_of(problem, 9)
    figure = Figure()
    populations = {0: genomes, 4: genomes[::-1]} if solved else {}
    problem.draw(figure, problem.decode(genomes[0]) if solved else None, populations)
    figure.savefig(tmp_path / "picture.png")
    assert figure.axes[0].has_data()
    assert figure.axes[0].get_title().startswith(problem.name if solved else "")
