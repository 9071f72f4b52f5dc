"""One contract for every planner: what any problem must do, held for each example and each template."""

import dataclasses
import functools
import json
import math
import random
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from one_max import Bus

import supernode
from genetics import Keys
from node.plan import Plan
from node.simulation import simulate
from problems import registry
from problems.file import parse
from spy.collector import Collector
from spy.past import best_known, stopped_after
from spy.result import states_of, stop_reasons
from spy.verification import verify

EXAMPLES = sorted((Path(__file__).parent.parent.parent / "examples").glob("*.toml"))
read = functools.cache(supernode.load)  # to make the spheres of a mesh takes a second


@functools.cache
def read_template(kind):
    """The problem file of `supernode init`, with what it names read."""
    model = registry.find(kind)
    parsed = parse(model.template, kind, Path())
    return dataclasses.replace(parsed, fields=model.derive_fields(model.gather(parsed.fields, Path())))


FILES = {path.name: lambda path=path: read(path) for path in EXAMPLES} | {
    f"init {kind}": lambda kind=kind: read_template(kind) for kind in registry.kinds()
}


@pytest.fixture(params=FILES, scope="module")  # so that all tests of a file follow each other
def file(request):
    return FILES[request.param]()


@pytest.fixture(scope="module")
def plan(file):
    return Plan.of(file)


@pytest.fixture(scope="module")
def genomes(plan):
    """Random ones; to make those of a robot's paths takes seconds."""
    genomes = random_genomes(plan)
    genomes.flags.writeable = False
    return genomes


@pytest.fixture(scope="module")
def judgement(plan):
    """What comes of a run of the file; equal runs have equal results, so one serves all tests of the file."""
    return outcome(plan)


def outcome(plan):
    reports = simulate(plan)
    collector = Collector(plan, job=1)
    collector.hear(best_known(reports, plan.run.spy), 0.0)
    reasons = stop_reasons(reports, plan.run.mode)
    return verify(collector, stopped_after(reports), reasons, states=states_of(reports))


def random_genomes(plan, deme=50):
    """Return those of four cells, a row each."""
    return plan.coding.random(Keys(np.arange(4), 7, 0), deme).reshape(-1, plan.coding.genome_bytes)


def test_every_kind_has_an_example():
    assert {supernode.load(path).kind for path in EXAMPLES} >= set(registry.kinds())


def test_it_is_solved_and_its_check_accepts(plan, judgement):
    """Where no fitness is known to be the best, it goes on until nothing better comes."""
    ends = "stalled" if plan.target is None else "solved"
    assert (judgement.status, judgement.feasible, judgement.message) == (ends, True, None)
    assert plan.target is None or judgement.best.fitness <= plan.target
    verdict = plan.problem.check(json.loads(json.dumps(judgement.best.solution)))
    assert verdict.feasible
    assert verdict.fitness == pytest.approx(judgement.best.fitness, abs=1e-6)
    assert plan.problem.describe(judgement.best.solution)


def test_a_corrupted_solution_is_rejected_or_unreadable(plan, judgement):
    solution = json.loads(json.dumps(judgement.best.solution))
    for name in solution:
        lacking = {other: value for other, value in solution.items() if other != name}
        with pytest.raises(supernode.BadInput) as error:
            plan.problem.check(lacking)
        assert len(str(error.value).splitlines()) == 1
        for nonsense in (None, "nonsense", [[]], {"a": 1}):
            with pytest.raises(supernode.BadInput):
                plan.problem.check(solution | {name: nonsense})
    numbers = list(_numbers(solution))
    for container, name in random.Random(1).sample(numbers, min(len(numbers), 150)):
        true, container[name] = container[name], container[name] + 0.37
        try:
            verdict = plan.problem.check(solution)
        except supernode.BadInput:
            continue
        finally:
            container[name] = true
        same = math.isclose(verdict.fitness, judgement.best.fitness, rel_tol=1e-6, abs_tol=1e-6)
        assert verdict.objections or not same


def _numbers(value):
    """Each number of a solution: what holds it, and its name or place there."""
    for name, part in value.items() if isinstance(value, dict) else enumerate(value):
        if isinstance(part, dict | list):
            yield from _numbers(part)
        elif isinstance(part, float):
            yield value, name


def test_the_same_seed_gives_the_same_run(plan):
    again = Plan(plan.problem.model_copy(), plan.run)
    assert simulate(plan) == simulate(again)


def test_fitness_does_not_depend_on_the_batch(plan, genomes):
    together = plan.evaluate(genomes)
    alone = np.concatenate([plan.evaluate(genome[None]) for genome in genomes])
    if plan.problem.is_batch_invariant:
        np.testing.assert_array_equal(together, alone)
    else:
        np.testing.assert_allclose(together, alone, rtol=1e-9)
    assert together.shape == (len(genomes),)
    assert not np.isnan(together).any()


def odd_genomes(plan):
    """The least and the greatest that the coding can hold, and what comes of crossing them with others."""
    mask, low, high, items = plan.coding.alphabet
    if items.size:
        genes = np.array(plan.coding.genes)
        ends = [plan.coding.encode(np.tile(genes[:, end], (count, 1))) for end in (0, 1) for count in items[:2]]
    else:
        ends = [low.view(np.uint8), high.view(np.uint8)] if low.size else [np.zeros_like(mask), mask]
    couples = np.stack([np.stack([end, genome]) for end in ends for genome in random_genomes(plan, 5)])
    offspring = plan.coding.recombine(couples[None].copy(), plan.recipe, plan.keys(np.array([3]), 1))
    assert all(plan.coding.alphabet.admits(genome) for genome in offspring[0])
    return np.concatenate([ends, offspring[0]])


def compiled_fitness(plan):
    fitness_kernel = plan.problem.fitness_kernel
    if fitness_kernel is None:
        pytest.skip("has no compiled fitness")
    return fitness_kernel


def test_its_compiled_fitness_is_its_fitness_bit_for_bit(plan, genomes):
    fitness_kernel = compiled_fitness(plan)
    genomes = np.concatenate([genomes, odd_genomes(plan)])
    expected = plan.problem.evaluate(genomes)
    assert fitness_kernel.fitness(genomes).tobytes() == expected.tobytes()
    for size in (1, 8):  # as many as a cell verifies at once
        for start in range(0, len(genomes), 5 * size):
            part = slice(start, start + size)
            assert fitness_kernel.fitness(genomes[part]).tobytes() == expected[part].tobytes()
            assert plan.problem.evaluate(genomes[part]).tobytes() == expected[part].tobytes()
    assert plan.problem.model_copy().fitness_kernel.fitness(genomes[::-1]).tobytes() == expected[::-1].tobytes()


def test_cells_live_the_same_with_and_without_its_compiled_fitness(plan):
    compiled_fitness(plan)
    kind = type(plan.problem)
    uncompiled = type(kind.__name__, (kind,), {"__module__": __name__, "fitness_kernel": property(lambda _: None)})
    run = plan.run.model_copy(update={"topology": "torus 2x2", "target": -1.0, "generations": 8, "deme": 1})
    slow = Plan(uncompiled.model_validate(plan.problem.model_dump(exclude_unset=True)), run)
    assert slow.problem.fitness_kernel is None
    reports = Bus(Plan(plan.problem, run), random.Random(1)).run()
    assert reports == Bus(slow, random.Random(2)).run() == simulate(slow)


def test_built_in_kinds_are_evaluated_all_at_once():
    assert all(registry.find(kind).is_batch_invariant for kind in registry.kinds())


def test_every_solution_that_decodes_can_be_checked_and_agrees(plan):
    genomes = random_genomes(plan, 8)
    for genome, fitness in zip(genomes, plan.evaluate(genomes), strict=True):
        if np.isfinite(fitness):
            solution = json.loads(json.dumps(plan.problem.decode(genome)))
            assert plan.problem.check(solution).fitness == pytest.approx(fitness, rel=1e-6, abs=1e-6)


def test_its_own_coding_accepts_what_it_makes(plan, genomes):
    assert all(plan.coding.alphabet.admits(genome) for genome in genomes)
    assert not plan.coding.alphabet.admits(np.empty(0, np.uint8))


def test_the_schema_round_trips(file):
    problem = file.problem()
    model = type(problem)
    again = model.model_validate_json(problem.model_dump_json(exclude_unset=True), strict=True)
    assert again == problem
    schema = model.model_json_schema()
    assert json.loads(json.dumps(schema)) == schema


def test_every_field_of_a_built_in_kind_is_described():
    for kind in registry.kinds():
        schema = registry.find(kind).model_json_schema()
        tables = [schema, *schema.get("$defs", {}).values()]
        for table in tables:
            for name, field in table.get("properties", {}).items():
                described = "description" in field or name == "shape" or "const" in field
                assert described, f"{kind}: {name}"


def test_the_picture_renders(plan, genomes, judgement, tmp_path):
    from matplotlib.figure import Figure

    for solution in (judgement.best.solution, None):
        figure = Figure(figsize=(6, 4))
        if ":" in plan.problem.kind:  # a user's own, which has no picture unless it brings one
            with pytest.raises(supernode.BadInput, match="have no picture"):
                plan.problem.draw(figure, solution, {})
            continue
        plan.problem.draw(figure, solution, {0: genomes, 9: genomes[:20]})
        for suffix in ("png",) if solution is None else ("png", "svg", "pdf"):
            target = tmp_path / f"picture.{suffix}"
            figure.savefig(target)
            assert target.stat().st_size > 2000


def test_what_cannot_be_solved_ends_as_stalled_with_the_best_found(plan):
    hopeless = Plan(plan.problem, plan.run.model_copy(update={"target": -1.0, "stall": 5, "generations": None}))
    judgement = outcome(hopeless)
    assert (judgement.status, judgement.best is not None) == ("stalled", True)


KINDS = {path.name: tomllib.loads(path.read_text())["kind"] for path in EXAMPLES} | {
    f"init {kind}": kind for kind in registry.kinds()
}


@pytest.mark.parametrize("kind", sorted(set(KINDS.values())))
def test_a_forked_node_has_all_that_it_needs(kind):
    """What only a node's generations import would be loaded, or compiled, by each of a thousand nodes."""
    kinds = [kind] if registry.is_built_in(kind) else []  # as `solve` loads them
    script = (
        "import json, sys\n"
        "from coordinator.launch.imports import import_all; import node.process; import_all(sys.argv[1:])\n"
        "from problems.file import ProblemFile\n"
        "from node.plan import Plan\n"
        "from node.simulation import simulate\n"
        "from node.fingerprint import fingerprint\n"
        "texts = json.load(sys.stdin)\n"
        "files = [ProblemFile.from_json(text).with_run(generations=2, target=-1.0) for text in texts]\n"
        "users = files[0].kind.partition(':')[0]\n"
        "before = set(sys.modules)\n"
        "for file in files: simulate(Plan.of(file, checked=True)); fingerprint()\n"  # as nodes do
        "late = set(sys.modules) - before - {users, 'supernode'}\n"
        "assert not late, late\n"
    )
    files = [FILES[name]().to_json() for name in FILES if KINDS[name] == kind]
    run = functools.partial(subprocess.run, capture_output=True, text=True, check=False)
    # On standard input, since a file with meshes in it is too long for an argument.
    done = run([sys.executable, "-c", script, *kinds], input=json.dumps(files))
    assert done.returncode == 0, done.stderr
