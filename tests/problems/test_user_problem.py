"""A user's own problem: how it is found, what is said when it cannot be used, and the fence around it."""

import math
import sys

import numpy as np
import pytest

from genetics import BitString
from problems import BadInput, EvaluationFailed, Problem, guarded, load, registry

GOOD = """
from __future__ import annotations

import dataclasses

import numpy as np
import supernode


@dataclasses.dataclass
class Beside:
    number: float


class Mine(supernode.Problem):
    weights: list[float] = [1.0, 2.0, 3.0]
    capacity: float = 4.0

    @property
    def coding(self):
        return supernode.BitString(len(self.weights), 1)

    def evaluate(self, genomes):
        load = self.coding.integers(genomes) @ np.array(self.weights)
        return np.where(load <= self.capacity, self.capacity - load, np.inf)
"""


@pytest.fixture(autouse=True)
def _clean_imports(monkeypatch):
    """Whatever a test imports is forgotten afterwards."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(registry, "_read", set(registry._read))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        if name.startswith("user_"):
            del sys.modules[name]


@pytest.fixture
def write(tmp_path):
    """Writes a user's module, and the problem file beside it that names a class of it."""

    def write(source, *lines, module="user_module", name="Mine", folder=tmp_path):
        folder.mkdir(exist_ok=True)
        (folder / f"{module}.py").write_text(source)
        path = folder / f"{module}.toml"
        path.write_text("\n".join([f'kind = "{module}:{name}"', *lines]))
        return path

    return write


def refused(path):
    """The one line with which the problem is refused, without the file's name."""
    with pytest.raises(BadInput) as caught:
        load(path).problem()
    (line,) = str(caught.value).splitlines()
    assert line.startswith(f"{path}: ")
    return line.removeprefix(f"{path}: ")


# How it is found ------------------------------------------------------------------------------------------------------
def test_it_is_found_beside_its_file(write):
    problem = load(write(GOOD, "capacity = 5.0")).problem()
    assert type(problem).__name__ == "Mine"
    assert problem.evaluate(problem.coding.encode([[1, 0, 1], [1, 1, 1], [0, 0, 0]])).tolist() == [1.0, math.inf, 5.0]


def test_loading_a_file_does_not_run_the_module(write, tmp_path):
    file = load(write(GOOD + f"\n\nopen({str(tmp_path / 'ran')!r}, 'w')\n"))
    assert not (tmp_path / "ran").exists()
    assert file.kind == "user_module:Mine"
    file.problem()
    assert (tmp_path / "ran").exists()


def test_loading_a_built_in_kind_runs_nothing_of_its_folder(tmp_path):
    (tmp_path / "arm.toml").write_text('kind = "arm-ik"\ntarget = [1, 1]\narm.links = [1, 1]')
    load(tmp_path / "arm.toml").problem()
    assert str(tmp_path) not in sys.path


def test_it_is_found_on_the_path(write, tmp_path, monkeypatch):
    write(GOOD, module="user_elsewhere", folder=tmp_path / "library")
    monkeypatch.syspath_prepend(tmp_path / "library")
    (tmp_path / "other.toml").write_text('kind = "user_elsewhere:Mine"')
    assert load(tmp_path / "other.toml").problem().capacity == 4.0


def test_it_is_found_in_a_package_beside_its_file(tmp_path):
    (tmp_path / "user_package").mkdir()
    (tmp_path / "user_package" / "__init__.py").touch()
    (tmp_path / "user_package" / "part.py").write_text(GOOD)
    (tmp_path / "own.toml").write_text('kind = "user_package.part:Mine"')
    assert load(tmp_path / "own.toml").problem().capacity == 4.0


def test_it_may_import_modules_that_lie_beside_it(write, tmp_path):
    (tmp_path / "user_helper.py").write_text("CAPACITY = 8.0\n")
    source = GOOD.replace("import dataclasses", "import dataclasses\nimport user_helper")
    assert load(write(source.replace("= 4.0", "= user_helper.CAPACITY"))).problem().capacity == 8.0


def test_the_module_beside_the_file_wins_over_one_of_the_same_name_elsewhere(write, tmp_path):
    one = write(GOOD, folder=tmp_path / "one")
    other = write(GOOD.replace("capacity: float = 4.0", "capacity: float = 40.0"), folder=tmp_path / "other")
    capacities = [load(path).problem().capacity for path in (one, other, one)]
    assert capacities == [4.0, 40.0, 4.0]


def test_an_edited_module_is_read_anew(write):
    assert load(write(GOOD)).problem().capacity == 4.0
    assert load(write(GOOD.replace("= 4.0", "= 44.0"))).problem().capacity == 44.0


@pytest.mark.parametrize("module", ["json", "problems", "numpy"])
def test_it_may_not_take_the_name_of_another_module(write, module):
    before = sys.modules[module]
    line = refused(write(GOOD, module=module))
    assert line.startswith(
        f"kind: cannot import '{module}:Mine': ImportError: there is another module '{module}' already"
    )
    assert sys.modules[module] is before


# What is said when it cannot be used ----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("source", "complaint"),
    [
        ("raise RuntimeError('no\\nluck')", "kind: cannot import 'user_module:Mine': RuntimeError: no luck"),
        (
            "import user_missing",
            "kind: cannot import 'user_module:Mine': ModuleNotFoundError: No module named 'user_missing'",
        ),
        ("1 / 0", "kind: cannot import 'user_module:Mine': ZeroDivisionError: division by zero"),
        ("import sys\nsys.exit(3)", "kind: cannot import 'user_module:Mine': SystemExit: 3"),
        ("def f(:\n", "kind: cannot import 'user_module:Mine': SyntaxError: "),
        ("", "kind: cannot import 'user_module:Mine': AttributeError: module 'user_module' has no attribute 'Mine'"),
        ("Mine = 3", "kind: expected a subclass of supernode.Problem, found 'user_module:Mine', which is 3"),
        (
            "class Mine: pass",
            "kind: expected a subclass of supernode.Problem, found 'user_module:Mine', which is <class",
        ),
        (
            "def Mine(): pass",
            "kind: expected a subclass of supernode.Problem, found 'user_module:Mine', which is <function",
        ),
        (
            "import numpy\nMine = numpy.eye(3)",
            "kind: expected a subclass of supernode.Problem, found 'user_module:Mine'",
        ),
    ],
)
def test_a_module_that_is_no_use(write, source, complaint):
    assert refused(write(source)).startswith(complaint)
    if "Mine" not in source and source:
        assert "user_module" not in sys.modules


@pytest.mark.parametrize(
    ("kind", "complaint"),
    [
        (
            "user_nowhere:Mine",
            "kind: cannot import 'user_nowhere:Mine': ModuleNotFoundError: No module named 'user_nowhere'",
        ),
        (":Mine", "kind: cannot import ':Mine': ValueError: Empty module name"),
        (":", "kind: cannot import ':': ValueError: Empty module name"),
        (
            "user_module:",
            "kind: cannot import 'user_module:': AttributeError: module 'user_module' has no attribute ''",
        ),
        ("user_module:Mine:Mine", "kind: cannot import 'user_module:Mine:Mine': AttributeError: "),
        ("../user_module:Mine", "kind: cannot import '../user_module:Mine': "),
    ],
)
def test_a_kind_that_names_no_class(write, tmp_path, kind, complaint):
    write("x = 1")
    path = tmp_path / "other.toml"
    path.write_text(f'kind = "{kind}"')
    assert refused(path).startswith(complaint)


BASE = """
import supernode
from pydantic import model_validator

class Mine(supernode.Problem):
    size: int = 4

    @property
    def coding(self):
        {coding}

    def evaluate(self, genomes):
        return genomes.sum(axis=1).astype(float)
"""


@pytest.mark.parametrize(
    ("source", "complaint"),
    [
        (
            "import supernode\nclass Mine(supernode.Problem): pass",
            "kind: cannot make a 'user_module:Mine': TypeError: Can't",
        ),
        (BASE.format(coding="return supernode.BitString(self.size, 99)"), "a parameter has 1 to 62 bits, found 99"),
        (BASE.format(coding="return None"), "AttributeError: 'NoneType' object has no attribute 'genome_bytes'"),
        (BASE.format(coding="return self.sizes"), "AttributeError: "),
        (BASE.format(coding="return {}['x']"), "KeyError: 'x'"),
        (BASE.format(coding="raise ValueError('two\\nlines')"), "two lines"),
        (
            BASE.format(coding="return supernode.BitString(4, 4)")
            + "    @model_validator(mode='after')\n    def _check(self):\n        raise ZeroDivisionError('oh')\n",
            "kind: cannot make a 'user_module:Mine': ZeroDivisionError: oh",
        ),
        (
            BASE.format(coding="return supernode.BitString(4, 4)")
            + "    @model_validator(mode='after')\n    def _check(self):\n        raise ValueError('expected x')\n",
            'expected x, found {"kind": "user_module:Mine"}',
        ),
        (
            BASE.format(coding="return supernode.BitString(4, 4)")
            + "    def for_recipe(self, name, deme):\n        raise RuntimeError('not today')\n",
            "RuntimeError: not today",
        ),
        (
            BASE.format(coding="return supernode.BitString(4, 4)")
            + "    def for_recipe(self, name, deme):\n        pass\n",
            "AttributeError: 'NoneType' object has no attribute 'coding'",
        ),
    ],
)
def test_a_class_that_is_no_use(write, source, complaint):
    assert refused(write(source)).startswith(complaint)


@pytest.mark.parametrize(
    ("coding", "lines", "complaint"),
    [
        (
            "return supernode.RealVector(2, 0.0, 1.0)",
            ["[run]", 'mutation = "one-bit"'],
            "real vectors have no bits: 'mutation' is a probability, found 'one-bit'",
        ),
        (
            "from types import SimpleNamespace\n        return SimpleNamespace(genome_bytes=4)",
            [],
            "AttributeError: 'types.SimpleNamespace' object has no attribute 'check'",
        ),
    ],
)
def test_a_recipe_that_is_not_for_the_coding_is_refused_before_the_run(write, coding, lines, complaint):
    assert refused(write(BASE.format(coding=coding), *lines)) == complaint


def test_fields_of_a_user_s_problem_are_checked_like_those_of_any(write):
    path = write(GOOD, "capacty = 3")
    assert refused(path) == "capacty: unknown field, expected one of kind, weights, capacity; did you mean 'capacity'?"
    assert refused(write(GOOD, 'weights = ["a"]')) == 'weights[0]: expected a valid number, found "a"'


def test_a_message_of_bad_input_is_not_named_a_value_error(write):
    source = BASE.format(coding="return supernode.BitString(4, 4)") + (
        "    def for_recipe(self, name, deme):\n        raise supernode.BadInput('size: expected 1, found 2')\n"
    )
    assert refused(write(source)) == "size: expected 1, found 2"


# What it has of itself ------------------------------------------------------------------------------------------------
def test_a_problem_without_a_checker_of_its_own_checks_genomes(write):
    problem = load(write(GOOD)).problem()
    genome = problem.coding.encode([[1, 0, 1]])[0]
    solution = problem.decode(genome)
    assert solution == {"integers": [1, 0, 1]}
    assert problem.describe(solution) == "integers: [1, 0, 1]"
    verdict = problem.check(solution)
    assert verdict.fitness == 0.0
    assert verdict.feasible
    refused_verdict = problem.check({"integers": [1, 1, 1]})
    assert refused_verdict.fitness == math.inf
    assert not refused_verdict.feasible


@pytest.mark.parametrize(
    "solution",
    [{}, *({"integers": wrong} for wrong in (3, "101", "", [1, 0], [1, 0, 2], [1, 0, True], [1, 0, 1 << 70], None))],
)
def test_what_is_no_solution_at_all_is_bad_input(write, solution):
    problem = load(write(GOOD)).problem()
    with pytest.raises(BadInput, match=r"^solution: expected a field 'integers' with 3 integers from 0 to 1, for "):
        problem.check(solution)


def test_a_problem_without_a_picture_says_so(write):
    problem = load(write(GOOD)).problem()
    with pytest.raises(BadInput, match=r"user_module:Mine.* have no picture"):
        problem.draw(None, None, {})


# The fence around its evaluation --------------------------------------------------------------------------------------
class Returns(Problem):
    """Returns whatever it is made to."""

    @property
    def coding(self):
        return BitString(1, 8)

    def evaluate(self, genomes):
        return what_to_return(genomes)


def what_to_return(genomes):
    raise NotImplementedError


GENOMES = np.arange(3, dtype=np.uint8)[:, None]


@pytest.fixture
def evaluate(monkeypatch):
    """The guarded evaluation of three genomes by a function."""

    def evaluate(function, genomes=GENOMES):
        monkeypatch.setitem(globals(), "what_to_return", function)
        return guarded(Returns(kind="returns"))(genomes)

    return evaluate


@pytest.mark.parametrize(
    ("returned", "complaint"),
    [
        ([1.0, math.nan, math.inf], "evaluate must not return NaN or -inf, got nan for genome 01"),
        ([1.0, 2.0, -math.inf], "evaluate must not return NaN or -inf, got -inf for genome 02"),
        ([1.0, 2.0], r"evaluate must return an array of shape \(3,\), got \(2,\)"),
        ([1.0] * 4, r"evaluate must return an array of shape \(3,\), got \(4,\)"),
        ([], r"evaluate must return an array of shape \(3,\), got \(0,\)"),
        ([[1.0], [2.0], [3.0]], r"evaluate must return an array of shape \(3,\), got \(3, 1\)"),
        (1.0, r"evaluate must return an array of shape \(3,\), got \(\)"),
        (None, r"evaluate must return an array of shape \(3,\), got \(\)"),
        ([1.0, None, 2.0], "evaluate must not return NaN or -inf, got nan for genome 01"),
        (["a", "b", "c"], "evaluate raised ValueError"),
        ([[1.0], [2.0, 3.0], []], "evaluate raised ValueError"),
        ({}, "evaluate raised TypeError"),
    ],
)
def test_what_is_no_fitness_is_refused(evaluate, returned, complaint):
    with pytest.raises(EvaluationFailed, match=f"^returns: {complaint}") as caught:
        evaluate(lambda genomes: returned)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("error", [RuntimeError("a\nb"), KeyError("a\nb"), MemoryError("a\nb"), RecursionError("a\nb")])
def test_what_it_raises_is_told_in_one_line(evaluate, error):
    def fail(genomes):
        raise error

    with pytest.raises(EvaluationFailed, match=f"^returns: evaluate raised {type(error).__name__}: .*b") as caught:
        evaluate(fail)
    assert len(str(caught.value).splitlines()) == 1
    assert caught.value.__cause__ is error


def test_an_interruption_is_no_failure(evaluate):
    def interrupt(genomes):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate(interrupt)


@pytest.mark.parametrize(
    ("returned", "fitness"),
    [
        ([1.0, math.inf, 3.0], [1.0, math.inf, 3.0]),
        ([1, 2, 3], [1.0, 2.0, 3.0]),
        (np.array([-1.5, 0.0, 1e300]), [-1.5, 0.0, 1e300]),
        (np.array([1, 2, 3], np.float32), [1.0, 2.0, 3.0]),
        (np.array([True, False, True]), [1.0, 0.0, 1.0]),
        (np.arange(6.0)[::2], [0.0, 2.0, 4.0]),
        (np.broadcast_to(np.float64(7), 3), [7.0, 7.0, 7.0]),
    ],
)
def test_what_is_a_fitness_becomes_a_plain_array(evaluate, returned, fitness):
    given = evaluate(lambda genomes: returned)
    assert given.tolist() == fitness
    assert given.dtype == np.float64
    assert given.flags.c_contiguous
    assert given.flags.writeable


def test_an_array_that_the_problem_uses_again_is_copied(evaluate):
    kept = np.zeros(3)
    given = evaluate(lambda genomes: kept)
    kept[:] = 5.0
    assert given.tolist() == [0.0, 0.0, 0.0]
    given[:] = 9.0
    assert kept.tolist() == [5.0, 5.0, 5.0]


def test_an_empty_batch_is_no_trouble(evaluate):
    assert evaluate(lambda genomes: np.zeros(len(genomes)), GENOMES[:0]).shape == (0,)
