"""The breeding rule: one row at a time or many, a deme of one and an island."""

import dataclasses
import itertools
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lists import Lists

from genetics import (
    BitString,
    Keys,
    RealVector,
    Recipe,
    bit_kernels,
    evaluations_per_generation,
    randomness,
    real_kernels,
    replacement,
    selection,
)
from genetics.breeding import breed
from genetics.coding import Immigrants

SLOTS = 4

bit_recipes = [
    Recipe(crossover, mutation, replacement)
    for crossover, mutation, replacement in itertools.product(
        ("one-point", "uniform"), (0.0, 0.05, 1.0, "one-bit"), ("offspring", "elitist")
    )
]
real_recipes = [
    Recipe(crossover, mutation, replacement)
    for crossover, mutation, replacement in itertools.product(
        ("blend", "uniform"), (0.0, 0.3, 1.0), ("offspring", "elitist")
    )
]
island_rules = st.sampled_from(
    [
        {"renewal": renewal} | pairing
        for renewal in (0.3, 0.5, 1.0, None)
        for pairing in ({}, {"pairing": "better-half"}, {"most_selections": 2})
    ]
)
list_recipes = [Recipe("splice", rate, replacement) for rate in (0.0, 0.3) for replacement in ("offspring", "elitist")]
families = st.one_of(
    st.tuples(st.builds(BitString, st.integers(1, 5), st.integers(1, 20)), st.sampled_from(bit_recipes)),
    st.tuples(st.just(RealVector(3, -2.0, 5.0)), st.sampled_from(real_recipes)),
    st.tuples(st.just(Lists()), st.sampled_from(list_recipes)),
)
breeds = st.one_of(
    families,
    st.tuples(families, island_rules).map(lambda drawn: (drawn[0][0], dataclasses.replace(drawn[0][1], **drawn[1]))),
)


def evaluate(genomes):
    """Any function of the bytes, with ties and infeasible individuals."""
    assert genomes.ndim == 2
    assert genomes.flags.c_contiguous
    mixed = (genomes.astype(np.int64) * np.arange(1, genomes.shape[1] + 1)).sum(axis=1) * 2654435761 % 4294967296 >> 20
    return np.where(mixed % 5 == 0, np.inf, mixed % 97.0)


class Counting:
    """An evaluation that knows how many genomes it has seen."""

    def __init__(self):
        self.count = 0

    def __call__(self, genomes):
        self.count += len(genomes)
        return evaluate(genomes)


def immigrants_of(genomes, fitness):
    """A stranger for each slot: genomes (rows, slots, genome_bytes), and fitness. The rows themselves come first."""
    rows, slots, size = genomes.shape
    themselves, strangers = np.zeros((rows, 1, size), np.uint8), genomes.reshape(rows * slots, 1, size)
    their_fitness = np.concatenate([np.full((rows, 1), -1.0), fitness.reshape(rows * slots, 1)])
    source_row = rows + np.arange(rows * slots).reshape(rows, slots)
    return Immigrants(np.concatenate([themselves, strangers]), their_fitness, source_row, 1)


def population(coding, cells, deme, seed):
    """Demes and immigrants with their fitness."""
    keys = Keys(np.array(cells), np.uint64(seed), 0)
    genomes = coding.random(keys, deme + SLOTS)
    rows, count, size = genomes.shape
    fitness = evaluate(genomes.reshape(-1, size)).reshape(rows, count)
    demes = np.ascontiguousarray(genomes[:, :deme]), np.ascontiguousarray(fitness[:, :deme])
    return *demes, immigrants_of(genomes[:, deme:], fitness[:, deme:])


def bred(coding, recipe, deme, cells=(3,), seed=1, generation=1, exchange=True, evaluation=evaluate):
    """The demes before and after a generation."""
    genomes, fitness, immigrants = population(coding, cells, deme, seed)
    before = genomes.copy(), fitness.copy()
    keys = Keys(np.array(cells), np.uint64(seed), generation)
    breed(genomes, fitness, immigrants if exchange else None, coding, recipe, evaluation, keys)
    return before, (genomes, fitness)


def of_row(row, immigrants):
    """The immigrants of one row, as that row alone would see them: it is number 0 there."""
    genomes, fitness, source_row, each = immigrants
    renamed = np.where(source_row[row] == row, 0, source_row[row] + 1)[None]
    return Immigrants(
        np.concatenate([genomes[row : row + 1], genomes]),
        np.concatenate([fitness[row : row + 1], fitness]),
        renamed,
        each,
    )


@given(
    breeds,
    st.integers(1, 9),
    st.lists(st.integers(0, (1 << 20) - 1), min_size=1, max_size=4, unique=True),
    st.integers(0, (1 << 64) - 1),
    st.integers(1, (1 << 31) - 1),
    st.booleans(),
    st.data(),
)
def test_rows_bred_together_are_those_bred_one_at_a_time(breed_of, deme, cells, seed, generation, exchange, data):
    coding, recipe = breed_of
    exchange = exchange or deme == 1
    genomes, fitness, immigrants = population(coding, cells, deme, seed)
    senders = st.integers(0, len(immigrants.genomes) - 1)  # whoever it is: repeatedly, or the row itself
    slots = st.lists(senders, min_size=SLOTS, max_size=SLOTS)
    source_row = data.draw(st.lists(slots, min_size=len(cells), max_size=len(cells)))
    immigrants = immigrants._replace(source_row=np.array(source_row))
    alone = [
        (genomes[row : row + 1].copy(), fitness[row : row + 1].copy(), of_row(row, immigrants))
        for row in range(len(cells))
    ]
    together = immigrants if exchange else None
    breed(genomes, fitness, together, coding, recipe, evaluate, Keys(np.array(cells), np.uint64(seed), generation))
    for row, (its_genomes, its_fitness, its_immigrants) in enumerate(alone):
        keys = Keys(np.array(cells[row : row + 1]), np.uint64(seed), generation)
        breed(its_genomes, its_fitness, its_immigrants if exchange else None, coding, recipe, evaluate, keys)
        np.testing.assert_array_equal(its_genomes[0], genomes[row])
        np.testing.assert_array_equal(its_fitness[0], fitness[row])


@given(breeds, st.integers(1, 9), st.integers(0, 1000), st.booleans())
def test_a_bred_deme_is_sound(breed_of, deme, seed, exchange):
    coding, recipe = breed_of
    evaluation = Counting()
    (old_genomes, old_fitness), (genomes, fitness) = bred(
        coding, recipe, deme, (0, 9), seed, exchange=exchange or deme == 1, evaluation=evaluation
    )
    assert genomes.shape == old_genomes.shape
    flat = genomes.reshape(-1, coding.genome_bytes)
    np.testing.assert_array_equal(fitness.ravel(), evaluate(flat), "the fitness is that of the genome beside it")
    assert all(coding.alphabet.admits(genome) for genome in flat)
    assert evaluation.count == 2 * evaluations_per_generation(deme, SLOTS, recipe)
    if recipe.replacement == "elitist" and (deme == 1 or recipe.mutation != "one-bit"):
        assert (fitness.min(axis=1) <= old_fitness.min(axis=1)).all()


@pytest.mark.parametrize(
    ("deme", "slots", "mutation", "count"),
    [
        (1, 4, 0.0, 8),
        (1, 4, "one-bit", 8),
        (1, 6, 0.1, 12),
        (2, 4, 0.0, 4),
        (16, 4, 0.1, 32),
        (16, 4, "one-bit", 33),
    ],
)
def test_evaluations_of_a_generation(deme, slots, mutation, count):
    assert evaluations_per_generation(deme, slots, Recipe(mutation=mutation)) == count


@pytest.mark.parametrize(
    ("deme", "renewal", "couples"),
    [(2, 0.1, 1), (2, 1.0, 1), (3, 1.0, 1), (7, 0.5, 2), (10, 0.5, 2), (100, 0.58, 29), (100, 1.0, 50), (9, None, 9)],
)
def test_an_island_has_a_couple_for_every_two_places_that_it_renews(deme, renewal, couples):
    recipe = Recipe(renewal=renewal)
    assert recipe.couples(deme) == couples
    assert evaluations_per_generation(deme, 4, recipe) == 2 * couples
    assert evaluations_per_generation(deme, 4, Recipe(mutation="one-bit", renewal=renewal)) == 2 * couples + 1
    assert evaluations_per_generation(1, 4, recipe) == 8


@pytest.mark.parametrize("renewal", [0.0, -0.5, 1.1, float("nan")])
def test_what_is_no_share_is_no_renewal(renewal):
    with pytest.raises(ValueError, match="expected a renewal above 0 and at most 1, found"):
        Recipe(renewal=renewal)


def test_a_renewed_deme_keeps_its_better_part():
    (old_genomes, old_fitness), (genomes, fitness) = bred(BitString(4, 16), Recipe(renewal=0.4), 10, exchange=False)
    best = np.argsort(old_fitness[0], kind="stable")[:6]
    np.testing.assert_array_equal(genomes[0, best], old_genomes[0, best])
    np.testing.assert_array_equal(fitness[0, best], old_fitness[0, best])
    assert (genomes[0] != old_genomes[0]).any(axis=1).sum() == 4


def test_an_individual_is_crossed_with_each_immigrant_in_the_order_of_the_neighbours():
    coding = BitString(4, 8)
    seen = []

    def watching(genomes):
        seen.append(genomes.copy())
        return np.arange(len(genomes), 0, -1.0)  # the last offspring is the best

    genomes = np.full((1, 1, 4), 0xFF, np.uint8)
    fitness = np.array([[0.5]])
    immigrants = np.repeat(np.array([0x01, 0x02, 0x04, 0x08], np.uint8)[None, :, None], 4, axis=2)
    strangers = immigrants_of(immigrants, np.zeros((1, 4)))
    breed(genomes, fitness, strangers, coding, Recipe(), watching, Keys(np.array([2]), 1, 1))
    (offspring,) = seen
    assert offspring.shape == (8, 4)
    for slot, mark in enumerate([0x01, 0x02, 0x04, 0x08]):
        one, other = offspring[2 * slot : 2 * slot + 2]
        np.testing.assert_array_equal(one ^ other, np.full(4, 0xFF ^ mark))
        np.testing.assert_array_equal(one & other, np.full(4, mark))
    np.testing.assert_array_equal(genomes[0, 0], offspring[-1])
    assert fitness[0, 0] == 1.0, "the offspring replaces the local individual though that was better"


def test_the_elitist_individual_gives_way_only_to_an_offspring_as_good():
    coding = BitString(4, 8)
    for best, stays in ((0.4, False), (0.5, False), (0.6, True)):
        genomes, fitness = np.full((1, 1, 4), 0xFF, np.uint8), np.array([[0.5]])
        immigrants = immigrants_of(np.zeros((1, 4, 4), np.uint8), np.zeros((1, 4)))
        keys = Keys(np.array([2]), 1, 1)
        breed(
            genomes, fitness, immigrants, coding, Recipe(replacement="elitist"), lambda g, b=best: np.full(8, b), keys
        )
        assert fitness[0, 0] == min(best, 0.5)
        assert (genomes == 0xFF).all() == stays


def test_the_one_bit_of_an_individual_alone_is_flipped_before_its_offspring_are_evaluated():
    coding = BitString(4, 8)
    seen = []

    def watching(genomes):
        seen.append(genomes.copy())
        return np.zeros(len(genomes))

    genomes, immigrants = np.zeros((1, 1, 4), np.uint8), immigrants_of(np.zeros((1, 4, 4), np.uint8), np.zeros((1, 4)))
    recipe = Recipe(mutation="one-bit")
    breed(genomes, np.zeros((1, 1)), immigrants, coding, recipe, watching, Keys(np.array([0]), 1, 1))
    assert [np.unpackbits(offspring).sum() for offspring in seen] == [1]


def test_the_one_bit_of_an_island_is_flipped_in_the_new_deme_and_that_individual_evaluated_again():
    coding = BitString(4, 8)
    batches = []

    def watching(genomes):
        batches.append(len(genomes))
        return np.unpackbits(genomes, axis=1).sum(axis=1).astype(float)

    rows, deme = 3, 5
    genomes, fitness = np.zeros((rows, deme, 4), np.uint8), np.zeros((rows, deme))
    breed(genomes, fitness, None, coding, Recipe(mutation="one-bit"), watching, Keys(np.arange(rows), 1, 1))
    assert batches == [rows * 2 * deme, rows]
    assert np.unpackbits(genomes, axis=2).sum(axis=(1, 2)).tolist() == [1, 1, 1]
    np.testing.assert_array_equal(fitness, np.unpackbits(genomes, axis=2).sum(axis=2))


def test_immigrants_of_an_island_come_in_before_it_breeds():
    coding = BitString(4, 8)
    genomes, fitness = np.zeros((1, 3, 4), np.uint8), np.full((1, 3), 9.0)
    immigrants = immigrants_of(np.full((1, 4, 4), 0xFF, np.uint8), np.array([[1.0, 1.0, 1.0, 10.0]]))
    breed(genomes, fitness, immigrants, coding, Recipe(), lambda g: np.full(len(g), 5.0), Keys(np.array([0]), 1, 1))
    assert (genomes == 0xFF).all()
    assert (fitness == 1.0).all()


def test_generations_and_seeds_breed_differently():
    coding = BitString(4, 16)
    recipe = Recipe("uniform", 0.1)
    results = {
        bred(coding, recipe, 8, cells=(cell,), seed=1, generation=generation)[1][0].tobytes()
        for cell in (0, 1)
        for generation in (1, 2, 3)
    }
    assert len(results) == 6


@pytest.mark.parametrize("deme", [1, 3])
@pytest.mark.parametrize(
    ("coding", "recipe"),
    [
        (BitString(3, 30), Recipe("one-point", 0.3)),
        (BitString(3, 30), Recipe("uniform", 0.3)),
        (BitString(3, 30), Recipe("uniform", "one-bit")),
        (RealVector(3, 0.0, 1.0), Recipe("blend", 1.0)),
        (RealVector(3, 0.0, 1.0), Recipe("uniform", 1.0)),
    ],
)
def test_no_draw_is_used_for_two_things(coding, recipe, deme, monkeypatch):
    used = Counter()
    modules = (randomness, bit_kernels, real_kernels, replacement, selection)
    for module in modules:
        for name, value in list(vars(module).items()):
            if hasattr(value, "py_func"):
                monkeypatch.setattr(module, name, value.py_func)
    philox = randomness.philox

    def watched(number, index, generation, cell_and_purpose, *key):
        used[tuple(map(int, (generation, cell_and_purpose, index, number)))] += 1
        return philox(number, index, generation, cell_and_purpose, *key)

    monkeypatch.setattr(randomness, "philox", watched)
    bred(coding, recipe, deme, cells=(0, 1))
    bred(coding, recipe, deme, cells=(0, 1), generation=2)
    first = 0  # the draws of the first demes, which both calls made
    bred_by = Counter({coordinates: count for coordinates, count in used.items() if coordinates[0] != first})
    assert {generation for generation, *_ in bred_by} == {1, 2}
    assert {cell // randomness._PURPOSES for _, cell, *_ in bred_by} == {0, 1}
    assert len(bred_by) > 10
    assert set(bred_by.values()) == {1}
    assert len({count for coordinates, count in used.items() if coordinates[0] == first}) == 1


def test_breeding_again_gives_the_same():
    one, other = (bred(BitString(4, 16), Recipe("one-point", 0.1), 8, cells=(0, 5))[1] for _ in range(2))
    np.testing.assert_array_equal(one[0], other[0])
    np.testing.assert_array_equal(one[1], other[1])


def test_an_individual_alone_needs_immigrants():
    with pytest.raises(AssertionError, match="nobody to breed with"):
        bred(BitString(1, 8), Recipe(), 1, exchange=False)
