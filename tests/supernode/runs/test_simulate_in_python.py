"""`supernode.simulate`: the command's run, in Python, with a callback."""

import json
import subprocess
import sys

import numpy as np
import pytest

import supernode
from node.plan import Plan
from node.simulation import simulate as simulate_cells
from supernode.__main__ import main

SPHERE = 'kind = "function"\nname = "sphere"\ndimension = 2\n[run]\ntopology = "torus 2x3"\n'
CELLS = 6


@pytest.fixture
def sphere(tmp_path):
    path = tmp_path / "sphere.toml"
    path.write_text(SPHERE)
    return path


class Seen(list):
    """All generations; the run is cancelled after that one, if it is given."""

    def __init__(self, last=None):
        super().__init__()
        self.last = last

    def __call__(self, generation):
        self.append(generation)
        return generation.number == self.last


def test_it_returns_what_the_command_prints(sphere, capsys):
    assert main(["simulate", str(sphere), "--seed", "3", "--deme", "4", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    for problem in (sphere, str(sphere), supernode.load(sphere)):
        result = supernode.simulate(problem, seed=3, deme=4)
        assert isinstance(result, supernode.Result)
        assert (result.status, result.seed, result.generations) == ("solved", 3, printed["generations"])
        assert result.history_sha256 == printed["history_sha256"]
        assert result.solution == printed["solution"]


def test_a_callback_sees_each_generation_and_changes_nothing(sphere):
    seen = Seen()
    result = supernode.simulate(sphere, seed=3, deme=4, callback=seen)
    assert result.history_sha256 == supernode.simulate(sphere, seed=3, deme=4).history_sha256
    assert [generation.number for generation in seen] == list(range(result.generations + 1))
    plan = Plan.of(supernode.load(sphere).with_run(seed=3, deme=4))
    expected = []
    simulate_cells(plan, snapshot=lambda number, genomes, fitness: expected.append((genomes.copy(), fitness.copy())))
    for generation, (genomes, fitness) in zip(seen, expected, strict=True):
        assert generation.genomes.shape == (CELLS, 4, plan.coding.genome_bytes)
        assert generation.genomes.dtype == np.uint8
        assert generation.attempt == 0
        np.testing.assert_array_equal(generation.genomes, genomes)
        np.testing.assert_array_equal(generation.fitness, fitness)


def test_the_best_so_far_is_what_the_root_has_heard_of(sphere):
    seen = Seen()
    result = supernode.simulate(sphere, callback=seen, target=-1.0, generations=40)
    distance = 3  # of the farthest cell from the root, and a generation to be told
    best = [generation.best.fitness for generation in seen]
    assert best == sorted(best, reverse=True)
    assert result.fitness <= best[-1], "in the end all cells are asked"
    assert seen[0].best.fitness == seen[0].fitness[0].min(), "of its own cell at first"
    for number, fitness in enumerate(best):
        known = min(generation.fitness.min() for generation in seen[: max(1, number + 1 - distance)])
        alive = min(generation.fitness.min() for generation in seen[: number + 1])
        assert alive <= fitness <= (known if number >= distance else np.inf)
    assert seen[-1].best.solution.keys() == result.solution.keys()


def test_what_a_callback_keeps_is_its_own(sphere):
    seen = Seen()
    supernode.simulate(sphere, callback=seen, target=-1.0, generations=5)
    assert len({generation.genomes.tobytes() for generation in seen}) == 6

    def spoil(generation):
        generation.genomes[:] = 0
        generation.fitness[:] = 0.0

    undisturbed = supernode.simulate(sphere, generations=20)
    assert supernode.simulate(sphere, generations=20, callback=spoil).history_sha256 == undisturbed.history_sha256


def test_a_callback_may_cancel_the_run(sphere):
    seen = Seen(last=11)
    result = supernode.simulate(sphere, target=-1.0, callback=seen)
    assert result.status == "cancelled"
    assert 11 < result.generations == seen[-1].number < 11 + 10
    assert result.solution is not None


def test_what_a_callback_raises_ends_the_run(sphere):
    def raises(generation):
        raise ZeroDivisionError("mine")

    with pytest.raises(ZeroDivisionError, match="mine"):
        supernode.simulate(sphere, callback=raises)


def test_a_deadline_ends_the_run(sphere):
    assert supernode.simulate(sphere, target=-1.0, seconds=0.05).status == "deadline"


def test_asynchronous_runs_are_simulated_too_but_have_no_common_generation(sphere):
    assert supernode.simulate(sphere, mode="async").status == "solved"
    with pytest.raises(supernode.BadInput, match=r"callback: expected mode lockstep, .*, found async"):
        supernode.simulate(sphere, mode="async", callback=Seen())


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [({"dme": 2}, "dme"), ({"deme": 0}, "deme"), ({"torus": "4"}, "torus"), ({"callback": 3, "mode": "async"}, "mode")],
)
def test_what_is_wrong_is_said(sphere, settings, complaint):
    with pytest.raises(supernode.BadInput, match=complaint):
        supernode.simulate(sphere, **settings)


class Onemax(supernode.Problem):
    """Made in Python; restarts when it stalls, with more bits that count."""

    size: int = 20
    least: float = 0.0
    is_batch_invariant = True

    @property
    def coding(self):
        return supernode.BitString(self.size, 1)

    @property
    def solved_at(self):
        return 0.0

    def evaluate(self, genomes):
        return np.maximum(self.size - self.coding.integers(genomes).sum(axis=1), self.least).astype(float)

    def next_attempt(self, attempt):
        return {"least": 0.0} if attempt == 2 else {}


def test_a_problem_made_in_python_needs_no_file():
    result = supernode.simulate(Onemax(kind="onemax"), torus="2x2", seed=2)
    assert (result.status, result.fitness) == ("solved", 0.0)
    assert result.kind.endswith("test_simulate_in_python:Onemax")


def test_attempts_are_counted_and_their_generations_go_on():
    seen = Seen()
    result = supernode.simulate(Onemax(kind="onemax", least=3.0), torus="2x2", stall=20, callback=seen)
    assert (result.status, result.fitness) == ("solved", 0.0)
    assert sorted({generation.attempt for generation in seen}) == [0, 1, 2]
    numbers = [generation.number for generation in seen]
    assert numbers == sorted(numbers)
    assert numbers[-1] == result.generations
    best = [generation.best.fitness for generation in seen]
    assert best == sorted(best, reverse=True)


def test_a_built_in_problem_made_in_python_is_that_of_a_file(sphere):
    file = supernode.load(sphere)
    made = supernode.simulate(file.problem(), torus="2x3")
    assert made.kind == "function"
    assert made.history_sha256 == supernode.simulate(file).history_sha256


def test_a_class_of_a_script_is_solved(tmp_path):
    script = tmp_path / "mine.py"
    script.write_text(
        "import numpy as np, supernode\n"
        "class Mine(supernode.Problem):\n"
        "    @property\n"
        "    def coding(self):\n"
        "        return supernode.BitString(8, 1)\n"
        "    def evaluate(self, genomes):\n"
        "        return 8.0 - self.coding.integers(genomes).sum(axis=1)\n"
        "print(supernode.simulate(Mine(kind='mine'), target=0.0).status)\n"
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=False)
    assert (done.stdout, done.stderr) == ("solved\n", "")


def test_a_limit_on_generations_is_one_on_those_of_all_attempts(tmp_path):
    """A stall counts as one even where its generation is what the limit leaves: the next attempt still has room."""
    path = tmp_path / "hopeless.toml"
    path.write_text('kind = "function"\nname = "onemax"\ndimension = 20\n')
    settings = {"seed": 3, "topology": "torus 2x2", "target": -1.0, "stall": 5, "restarts": 2}
    stalls = [turn["generation"] for turn in supernode.simulate(path, **settings).directives if turn["do"] == "retry"]
    assert len(stalls) == 2
    first, second = stalls
    result = supernode.simulate(path, **settings, generations=2 * first + second)
    assert [turn["generation"] for turn in result.directives if turn["do"] == "retry"] == stalls
