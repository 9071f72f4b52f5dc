"""What a coding does for rows of cells, its compiled operators do for one; and what genomes are made of."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from genetics import ONE_BIT, BitString, Keys, RealVector, Recipe, selection
from genetics.coding import Alphabet, Immigrants

bit_recipes = list(
    itertools.starmap(Recipe, itertools.product(("one-point", "uniform"), (0.0, 0.05, 0.5, 1.0, ONE_BIT)))
)
real_recipes = list(itertools.starmap(Recipe, itertools.product(("blend", "uniform"), (0.0, 0.3, 1.0))))
breeds = st.one_of(
    st.tuples(st.builds(BitString, st.integers(1, 7), st.integers(1, 62)), st.sampled_from(bit_recipes)),
    st.tuples(
        st.builds(RealVector, st.integers(1, 5), st.floats(-1e6, 0), st.floats(1, 1e6)), st.sampled_from(real_recipes)
    ),
)
SLOTS = 4


@st.composite
def matings(draw):
    """A coding, a recipe, what draws are keyed by, single individuals, and who comes to them."""
    coding, recipe = draw(breeds)
    cells = draw(st.lists(st.integers(0, (1 << 20) - 1), min_size=1, max_size=3, unique=True))
    seed, generation = draw(st.integers(0, (1 << 64) - 1)), draw(st.integers(1, (1 << 31) - 1))
    keys = Keys(np.array(cells), np.uint64(seed), generation)
    each, spare, senders = draw(st.integers(1, 3)), draw(st.integers(0, 1)), draw(st.integers(1, 5))
    slots = st.lists(st.integers(0, senders - 1), min_size=SLOTS, max_size=SLOTS)
    source_row = np.array(draw(st.lists(slots, min_size=len(cells), max_size=len(cells))))
    first = Keys(np.arange(senders), np.uint64(7), 0)
    emigrants = coding.random(first, each + spare)
    own = coding.random(keys, 1)
    return coding, recipe, keys, own, Immigrants(emigrants, np.zeros(emigrants.shape[:2]), source_row, each)


@given(matings())
def test_the_operator_of_a_recipe_recombines_one_row_bit_for_bit(case):
    coding, recipe, keys, own, immigrants = case
    couples = selection.couples_with(own, immigrants.genomes, immigrants.source_row, immigrants.each)
    before, expected = couples.copy(), coding.recombine(couples, recipe, keys)
    assert expected.shape == (len(own), 2 * SLOTS * immigrants.each, coding.genome_bytes)
    operator = coding.variation(recipe)
    for row, cell in enumerate(keys.cells):
        offspring = np.full(expected.shape[1:], 0xAA, np.uint8)
        operator.function(couples[row], offspring, keys.seed, cell, keys.generation, operator.table)
        np.testing.assert_array_equal(offspring, expected[row])
    np.testing.assert_array_equal(couples, before)


@given(matings())
def test_the_operator_of_the_one_bit_rule_changes_what_the_rule_changes(case):
    coding, _, keys, own, _ = case
    if isinstance(coding, RealVector):
        with pytest.raises(ValueError, match="no bits"):
            coding.mutate_one_bit()
        return
    expected, operator = own.copy(), coding.mutate_one_bit()
    changed = coding.mutate_one(expected, keys)
    for row, cell in enumerate(keys.cells):
        assert operator.function(own[row], keys.seed, cell, keys.generation, operator.table) == changed[row]
    np.testing.assert_array_equal(own, expected)


def test_an_alphabet_of_bits_admits_what_its_mask_leaves_open():
    alphabet = Alphabet.of_bits(np.array([0xF0, 0x01], np.uint8))
    admitted = [
        genome for genome in range(1 << 16) if alphabet.admits(np.array([genome >> 8, genome & 0xFF], np.uint8))
    ]
    assert admitted == [high << 12 | low for high in range(16) for low in (0, 1)]
    assert not alphabet.admits(np.zeros(1, np.uint8))
    assert not alphabet.admits(np.zeros(3, np.uint8))
