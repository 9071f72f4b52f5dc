"""The settings of a run: their defaults and what follows from them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

import topologies
from genetics import BitString, RealVector, Recipe, evaluations_per_generation
from problems import Problem, Run
from problems.run import DEFAULT_STALL


class Bits(Problem):
    """Any problem over bits."""

    size: int = 10

    @property
    def coding(self):
        return BitString(self.size, 1)

    def evaluate(self, genomes):
        return genomes[:, 0].astype(float)


class Reals(Bits):
    """Any problem over real numbers."""

    @property
    def coding(self):
        return RealVector(self.size, 0.0, 1.0)


def test_the_defaults_are_those_of_the_manual():
    run = Run()
    assert (run.mode, run.topology, run.deme, run.seed, run.recipe) == ("lockstep", "torus 4x4", 1, 1, "tuned")
    assert (run.interval, run.emigrants, run.spy) == (1, 1, "champion")
    assert run.generations is run.evaluations is run.seconds is run.target is run.stall is run.restarts is None


@pytest.mark.parametrize(
    ("settings", "limit"),
    [
        ({}, DEFAULT_STALL),
        ({"target": 0.5}, DEFAULT_STALL),
        ({"seed": 3, "deme": 4}, DEFAULT_STALL),
        ({"generations": 10}, None),
        ({"generations": 0}, None),
        ({"evaluations": 0}, None),
        ({"seconds": 1.5}, None),
        ({"stall": 7}, 7),
        ({"stall": 7, "generations": 10}, 7),
        ({"stall": 7, "seconds": 1.5, "evaluations": 3}, 7),
    ],
)
def test_the_default_stall_applies_only_if_nothing_else_limits_the_run(settings, limit):
    assert DEFAULT_STALL == 200
    assert Run(**settings).stall_limit() == limit


@pytest.mark.parametrize(
    ("settings", "last"),
    [
        ({}, None),
        ({"seconds": 3.0, "stall": 5}, None),
        ({"generations": 17}, 17),
        ({"generations": 0}, 0),
        # 16 cells make 16 evaluations first and 128 in each generation.
        ({"evaluations": 16 + 128 * 3}, 3),
        ({"evaluations": 16 + 128 * 3 - 1}, 2),
        ({"evaluations": 16 + 127}, 0),
        ({"evaluations": 15}, 0),
        ({"evaluations": 0}, 0),
        ({"evaluations": 16 + 128 * 3, "generations": 2}, 2),
        ({"evaluations": 16 + 128 * 3, "generations": 4}, 3),
        # 4 islands of 10 make 40 first and 80 in each generation.
        ({"evaluations": 40 + 80 * 5, "deme": 10, "topology": "torus 2x2"}, 5),
        ({"evaluations": 40 + 80 * 5 - 1, "deme": 10, "topology": "torus 2x2"}, 4),
    ],
)
def test_the_last_generation(settings, last):
    assert Run(**settings).last_generation(Recipe()) == last


def test_the_first_individuals_of_each_world_are_evaluated_too():
    run = Run(evaluations=3 * 16 + 128 * 5)
    assert [run.last_generation(Recipe(), epochs) for epochs in (1, 2, 3, 4, 50)] == [5, 5, 5, 4, 0]
    assert Run(generations=17).last_generation(Recipe(), 3) == 17


def test_what_limits_a_run_however_it_goes():
    assert not Run(stall=3, target=0.5, restarts=2).is_limited
    for limit in ({"generations": 0}, {"evaluations": 5}, {"seconds": 1.0}):
        assert Run(**limit).is_limited


def test_the_stray_evaluation_of_the_one_bit_mutation_counts():
    run = Run(evaluations=40 + 84 * 5, deme=10, topology="torus 2x2")
    assert run.last_generation(Recipe(mutation="one-bit")) == 5
    assert run.last_generation(Recipe()) == 5
    assert Run(**run.model_dump() | {"evaluations": 459}).last_generation(Recipe(mutation="one-bit")) == 4


@given(
    st.integers(0, 10_000),
    st.integers(1, 20),
    st.builds("torus {}x{}".format, st.integers(1, 5), st.integers(1, 5)),
    st.sampled_from([0.1, "one-bit"]),
)
def test_a_run_makes_as_many_evaluations_as_fit_and_no_more(evaluations, deme, topology, mutation):
    recipe = Recipe(mutation=mutation)
    run = Run(evaluations=evaluations, deme=deme, topology=topology)
    cells = topologies.parse(topology).cells
    last = run.last_generation(recipe)

    def made(generations):
        return cells * (deme + generations * evaluations_per_generation(deme, 4, recipe))

    assert made(last) <= evaluations or last == 0
    assert made(last + 1) > evaluations


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, Recipe("one-point", 0.1, "elitist")),
        ({"recipe": "paper"}, Recipe("one-point", 0.1, "offspring")),
        ({"mutation": 0.5}, Recipe("one-point", 0.5, "elitist")),
        ({"mutation": 0.0}, Recipe("one-point", 0.0, "elitist")),
        ({"mutation": "one-bit"}, Recipe("one-point", "one-bit", "elitist")),
        ({"replacement": "offspring"}, Recipe("one-point", 0.1, "offspring")),
        ({"recipe": "paper", "replacement": "elitist", "mutation": 1.0}, Recipe("one-point", 1.0, "elitist")),
    ],
)
def test_the_choices_of_the_run_go_into_the_problem_s_recipe(settings, expected):
    assert Run(**settings).breeding(Bits(kind="bits")) == expected


def test_real_vectors_have_a_recipe_of_their_own():
    assert Run().breeding(Reals(kind="reals")) == Recipe("blend", 0.1, "elitist")


def test_a_run_cannot_be_changed():
    with pytest.raises(ValidationError, match="frozen"):
        Run().seed = 2


@pytest.mark.parametrize("emigrants", [1, 4])
def test_as_many_may_emigrate_as_live_there(emigrants):
    assert Run(deme=4, emigrants=emigrants).emigrants == emigrants


@pytest.mark.parametrize("seed", [0, (1 << 64) - 1])
def test_seeds_have_64_bits(seed):
    assert Run(seed=seed).seed == seed


def test_every_setting_says_what_it_is():
    assert [name for name, field in Run.model_fields.items() if not field.description] == []
