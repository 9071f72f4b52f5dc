"""Genomes of variable length."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lists import GENES, Lists, items_of

from genetics import Keys, Recipe, Sequence
from genetics.operators import Operator

codings = st.builds(
    lambda least, more, genes: Lists(least, least + more, [(low, low + wide) for low, wide in genes]),
    st.integers(0, 3),
    st.integers(0, 4),
    st.lists(st.tuples(st.integers(0, 0x7FFF), st.integers(0, 0x8000)), min_size=1, max_size=3),
)
with_items = codings.flatmap(lambda coding: st.tuples(st.just(coding), items_of(coding)))
cells = st.lists(st.integers(0, (1 << 20) - 1), min_size=1, max_size=4, unique=True).map(np.array)
seeds = st.integers(0, (1 << 64) - 1).map(np.uint64)
recipes = st.sampled_from([Recipe("splice", rate) for rate in (0.0, 0.2, 1.0)])


def is_sound(coding, numbers):
    """The rule in plain Python."""
    count, *genes = numbers
    if not coding.least <= count <= coding.most:
        return False
    held, after = genes[: count * coding.width], genes[count * coding.width :]
    return not any(after) and all(
        low <= gene <= high for gene, (low, high) in zip(held, coding.genes * count, strict=True)
    )


@given(with_items)
def test_items_come_back_and_the_alphabet_admits_them(case):
    coding, items = case
    genome = coding.encode(np.array(items, np.int64))
    assert genome.shape == (coding.genome_bytes,)
    assert [tuple(item) for item in coding.items(genome).tolist()] == items
    assert coding.alphabet.admits(genome)
    genome.flags.writeable = False
    assert coding.alphabet.admits(genome), "as what comes over the wire"


@given(with_items, st.data())
def test_exactly_what_is_sound_is_admitted(case, data):
    coding, items = case
    numbers = coding.encode(np.array(items, np.int64)).view(np.uint16).copy()
    limit = st.sampled_from([0, 1, coding.least, coding.most, *np.array(coding.genes).ravel().tolist()])
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(numbers) - 1))
        numbers[place] = (data.draw(limit) + data.draw(st.integers(-1, 1))) % (1 << 16)
    assert coding.alphabet.admits(numbers.view(np.uint8)) == is_sound(coding, numbers.tolist())


@pytest.mark.parametrize("change", [-2, -1, 1, 2])
def test_a_genome_of_another_size_is_not_admitted(change):
    coding = Lists()
    assert not coding.alphabet.admits(np.zeros(coding.genome_bytes + change, np.uint8))


@pytest.mark.parametrize("items", [[], [(1, 7)] * 7, [(10, 7)], [(0, 6)], [(-1, 7)], [(0, 1001)]])
def test_what_is_no_list_of_items_is_not_encoded(items):
    with pytest.raises(ValueError, match=r"expected 1 to 6 items within \(\(0, 9\), \(7, 1000\)\), found"):
        Lists().encode(np.array(items, np.int64))


@pytest.mark.parametrize(
    ("least", "most", "genes", "complaint"),
    [
        (-1, 3, GENES, "items, found -1 to 3"),
        (4, 3, GENES, "items, found 4 to 3"),
        (0, 1 << 16, GENES, "items, found 0 to 65536"),
        (0, 3, (), "bounds of genes"),
        (0, 3, ((2, 1),), "bounds of genes"),
        (0, 3, ((-1, 1),), "bounds of genes"),
        (0, 3, ((0, 1 << 16),), "bounds of genes"),
    ],
)
def test_limits_out_of_order_or_beyond_16_bits_are_refused(least, most, genes, complaint):
    with pytest.raises(ValueError, match=complaint):
        Lists(least, most, genes)


def test_recipes_are_those_of_the_coding():
    Lists().check(Recipe("splice", 0.1))
    with pytest.raises(ValueError, match="these individuals cross by 'splice', found 'one-point'"):
        Lists().check(Recipe("one-point", 0.1))
    with pytest.raises(ValueError, match="not bit strings: 'mutation' is a probability, found 'one-bit'"):
        Lists().check(Recipe("splice", "one-bit"))
    for no_bits in (Lists().mutate_one_bit, lambda: Lists().mutate_one(np.zeros((1, 1, 26), np.uint8), None)):
        with pytest.raises(ValueError, match="no bits to flip"):
            no_bits()


def test_a_coding_says_how_it_founds_and_mates():
    with pytest.raises(TypeError, match="abstract"):
        Sequence(0, 1, GENES)


@given(codings, cells, seeds, st.integers(1, 5))
def test_first_demes_are_sound_and_each_row_is_what_it_is_alone(coding, cells, seed, deme):
    together = coding.random(Keys(cells, seed, 0), deme)
    assert together.shape == (len(cells), deme, coding.genome_bytes)
    for row, cell in enumerate(cells):
        np.testing.assert_array_equal(together[row], coding.random(Keys(np.array([cell]), seed, 0), deme)[0])
    assert all(coding.alphabet.admits(genome) for genome in together.reshape(-1, coding.genome_bytes))


def test_first_demes_have_lists_of_every_length_and_differ():
    demes = Lists().random(Keys(np.arange(20), np.uint64(1), 0), 10).reshape(-1, 26)
    assert {len(Lists().items(genome)) for genome in demes} == set(range(1, 7))
    assert len(np.unique(demes, axis=0)) == len(demes)


@given(codings, cells, seeds, st.integers(1, (1 << 31) - 1), st.integers(1, 4), recipes)
def test_offspring_are_sound_and_each_row_is_what_it_is_alone(coding, cells, seed, generation, count, recipe):
    parents = coding.random(Keys(cells, seed, 0), 2 * count)
    couples = parents.reshape(len(cells), count, 2, coding.genome_bytes)
    together = coding.recombine(couples, recipe, Keys(cells, seed, generation))
    assert together.shape == (len(cells), 2 * count, coding.genome_bytes)
    operator = coding.variation(recipe)
    for row, cell in enumerate(cells):
        keys = Keys(np.array([cell]), seed, generation)
        np.testing.assert_array_equal(together[row], coding.recombine(couples[row : row + 1], recipe, keys)[0])
        alone = np.full_like(together[row], 0xFF)  # whatever was there before
        operator.function(couples[row].copy(), alone, seed, cell, generation, operator.table)
        np.testing.assert_array_equal(alone, together[row])
    assert all(coding.alphabet.admits(genome) for genome in together.reshape(-1, coding.genome_bytes))


def test_without_mutation_genes_are_those_of_the_parents():
    coding = Lists()
    couples = coding.random(Keys(np.arange(8), np.uint64(3), 0), 10).reshape(8, 5, 2, -1)
    offspring = coding.recombine(couples, Recipe("splice", 0.0), Keys(np.arange(8), np.uint64(3), 1))
    lengths = set()
    for row in range(8):
        for child in range(10):
            parents = {tuple(item) for parent in couples[row, child // 2] for item in coding.items(parent)}
            items = coding.items(offspring[row, child])
            assert {tuple(item) for item in items} <= parents
            lengths.add(len(items))
    assert len(lengths) > 3


def test_an_operator_may_need_no_table():
    operator = Operator.of(Lists().initialise().function)
    assert operator.table.shape == (0, 3)
