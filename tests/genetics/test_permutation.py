"""Permutations: first demes, crossover and mutation, and what is one."""

import itertools
import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from genetics import Keys, Permutation, Recipe, permutation_kernels

cells = st.lists(st.integers(0, (1 << 20) - 1), min_size=1, max_size=3, unique=True).map(np.array)
seeds = st.integers(0, (1 << 64) - 1).map(np.uint64)
recipes = st.builds(Recipe, st.sampled_from(["order", "edge"]), st.sampled_from([0.0, 0.4, 1.0]))
codings = st.builds(Permutation, st.integers(1, 30), st.sampled_from([0.0, 0.3, 1.0]))
orders = st.integers(1, 12).flatmap(lambda size: st.tuples(*[st.permutations(range(size))] * 2))


def encoded(coding, *several):
    return np.stack([coding.encode(np.array(order)) for order in several])


def offspring_of(first, second, recipe, inversions=0.5, generations=1, seed=1):
    """The orders of two offspring in each of many generations: (generations, 2, size)."""
    coding = Permutation(len(first), inversions)
    couples = encoded(coding, first, second)[None, None]
    bred = [
        coding.recombine(couples, recipe, Keys(np.array([3]), np.uint64(seed), generation))[0]
        for generation in range(1, generations + 1)
    ]
    return np.stack([coding.orders(genomes) for genomes in bred])


def edges_of(order):
    """The unordered pairs of items that follow each other, the first after the last."""
    return {frozenset(pair) for pair in zip(order, np.roll(order, -1), strict=True)}


# Codes ----------------------------------------------------------------------------------------------------------------
@given(orders)
def test_an_order_comes_back(pair):
    coding = Permutation(len(pair[0]))
    np.testing.assert_array_equal(coding.orders(encoded(coding, *pair)), pair)


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_exactly_the_permutations_are_admitted(size):
    coding = Permutation(size)
    for numbers in itertools.product(range(size + 1), repeat=size):
        genome = np.array([size, *numbers], np.uint16).view(np.uint8)
        assert coding.alphabet.admits(genome) == (sorted(numbers) == list(range(size)))
    short = np.array([size - 1, *range(size)], np.uint16).view(np.uint8)
    assert not coding.alphabet.admits(short)


def test_what_is_no_permutation_is_not_encoded():
    for wrong, complaint in (
        ([0, 1, 1], "expected items that differ"),
        ([0, 1], "expected 3 to 3 items"),
        ([1, 2, 3], "expected 3 to 3 items within"),
    ):
        with pytest.raises(ValueError, match=complaint):
            Permutation(3).encode(np.array(wrong))


@pytest.mark.parametrize("size", [0, -1, 1 << 16])
def test_a_size_out_of_range_is_refused(size):
    with pytest.raises(ValueError, match=f"a permutation has 1 to 65535 items, found {size}"):
        Permutation(size)


@pytest.mark.parametrize("inversions", [-0.1, 1.1, math.nan])
def test_what_is_no_share_of_inversions_is_refused(inversions):
    with pytest.raises(ValueError, match="expected a share of inversions from 0 to 1, found"):
        Permutation(5, inversions)


def test_recipes_are_those_of_the_coding():
    for crossover in ("order", "edge"):
        Permutation(5).check(Recipe(crossover, 0.1))
    with pytest.raises(ValueError, match="these individuals cross by 'order' or 'edge', found 'one-point'"):
        Permutation(5).check(Recipe("one-point", 0.1))
    with pytest.raises(ValueError, match="found 'one-bit'"):
        Permutation(5).check(Recipe("order", "one-bit"))


# Any crossover ----------------------------------------------------------------------------------------------------
@given(codings, cells, seeds, st.integers(1, (1 << 31) - 1), st.integers(1, 3), recipes)
def test_offspring_are_permutations_and_each_row_is_what_it_is_alone(coding, cells, seed, generation, count, recipe):
    demes = coding.random(Keys(cells, seed, 0), 2 * count)
    couples = demes.reshape(len(cells), count, 2, coding.genome_bytes)
    together = coding.recombine(couples, recipe, Keys(cells, seed, generation))
    operator = coding.variation(recipe)
    for row, cell in enumerate(cells):
        alone = np.full_like(together[row], 0xFF)  # whatever was there before
        operator.function(couples[row].copy(), alone, seed, cell, generation, operator.table)
        np.testing.assert_array_equal(alone, together[row])
    for genomes in (demes, together):
        flat = genomes.reshape(-1, coding.genome_bytes)
        assert all(coding.alphabet.admits(genome) for genome in flat)
        np.testing.assert_array_equal(np.sort(coding.orders(flat), axis=1), [range(coding.size)] * len(flat))


@given(orders, st.sampled_from(["order", "edge"]))
def test_parents_alike_have_offspring_alike_without_mutation(pair, crossover):
    (offspring,) = offspring_of(pair[0], pair[0], Recipe(crossover, 0.0))
    for child in offspring:
        assert edges_of(child) == edges_of(pair[0])


def test_first_orders_are_drawn_with_equal_probability():
    coding = Permutation(4)
    drawn = coding.orders(coding.random(Keys(np.arange(24), np.uint64(1), 0), 500).reshape(-1, coding.genome_bytes))
    counts = Counter(map(tuple, drawn.tolist()))
    assert len(counts) == 24
    chi_square = sum((count - 500) ** 2 / 500 for count in counts.values())
    assert chi_square < 23 + 5 * math.sqrt(2 * 23)


# Order crossover ------------------------------------------------------------------------------------------------------
def by_order(first, second, start, end):
    """OX in plain Python: a stretch, and from behind it on the others as the second parent has them from there on."""
    kept = first[start : end + 1]
    behind = np.roll(second, -(end + 1))
    others = [item for item in behind if item not in kept]
    tail = len(first) - end - 1
    return [*others[tail:], *kept, *others[:tail]]


@given(orders, st.data())
def test_order_crossover_is_davis_s(pair, data):
    size = len(pair[0])
    start = data.draw(st.integers(0, size - 1))
    end = data.draw(st.integers(start, size - 1))
    first, second = (np.array(order, np.uint16) for order in pair)
    child = np.zeros(size, np.uint16)
    permutation_kernels._order(first, second, child, start, end)
    assert child.tolist() == by_order(pair[0], pair[1], start, end)


def test_the_textbook_example_of_order_crossover():
    first, second = np.arange(9, dtype=np.uint16), np.array([3, 4, 0, 7, 6, 5, 8, 1, 2], np.uint16)
    child = np.zeros(9, np.uint16)
    permutation_kernels._order(first, second, child, 3, 6)
    assert child.tolist() == [0, 7, 8, 3, 4, 5, 6, 1, 2]


def test_every_stretch_may_be_kept_and_both_parents_give_one():
    first, second = np.arange(5), np.array([4, 2, 0, 3, 1])
    stretches = {(start, end) for start in range(5) for end in range(start, 5)}
    for turn, (one, other) in enumerate([(first, second), (second, first)]):
        possible = {tuple(by_order(one.tolist(), other.tolist(), *stretch)) for stretch in stretches}
        children = offspring_of(first, second, Recipe("order", 0.0), generations=600)[:, turn]
        assert {tuple(child) for child in children.tolist()} == possible


# Edge recombination -------------------------------------------------------------------------------------------------
@given(orders, st.integers(0, 1000))
def test_edge_recombination_goes_on_to_the_neighbour_with_the_fewest_neighbours_left(pair, seed):
    (offspring,) = offspring_of(*pair, Recipe("edge", 0.0), seed=seed)
    known = edges_of(pair[0]) | edges_of(pair[1])
    neighbours = {item: {other for other in pair[0] if other != item and {item, other} in known} for item in pair[0]}
    for parent, child in zip(pair, offspring.tolist(), strict=True):
        assert child[0] == parent[0]
        for place, (item, following) in enumerate(itertools.pairwise(child)):
            visited = set(child[: place + 1])
            nearest = {other: len(neighbours[other] - visited) for other in neighbours[item] - visited}
            if nearest:
                assert nearest.get(following) == min(nearest.values())


def test_of_equally_good_neighbours_each_comes_as_often():
    first, second = [0, 1, 2, 3, 4, 5], [0, 2, 4, 1, 5, 3]  # 0 has the neighbours 1, 5, 2 and 3, each with three more
    children = offspring_of(first, second, Recipe("edge", 0.0), generations=2000)[:, 0]
    counts = Counter(children[:, 1].tolist())
    assert set(counts) == {1, 2, 3, 5}
    assert all(abs(count - 500) < 5 * math.sqrt(2000 * 0.25 * 0.75) for count in counts.values())


def test_hardly_any_edge_of_an_offspring_is_neither_parent_s():
    random = np.random.default_rng(1)
    foreign = total = 0
    for seed in range(50):
        pair = random.permutation(40), random.permutation(40)
        (offspring,) = offspring_of(*pair, Recipe("edge", 0.0), seed=seed)
        for child in offspring:
            foreign += len(edges_of(child) - edges_of(pair[0]) - edges_of(pair[1]))
            total += 40
    assert 0 < foreign / total < 0.05  # 1 to 5 % (Whitley, Starkweather and Fuquay 1989)


# Mutation -------------------------------------------------------------------------------------------------------------
def changes(inversions, rate=1.0, size=7):
    """The offspring of parents that are alike, in which a mutation is all that differs."""
    order = np.random.default_rng(2).permutation(size)
    return order, offspring_of(order, order, Recipe("order", rate), inversions, generations=1500).reshape(-1, size)


def test_an_inversion_reverses_a_stretch():
    order, mutants = changes(inversions=1.0)
    possible = {
        (*order[:start], *order[start : end + 1][::-1], *order[end + 1 :])
        for start, end in itertools.combinations(range(7), 2)
    }
    assert {tuple(mutant) for mutant in mutants} == possible


def test_a_swap_exchanges_two_items_with_equal_probability():
    order, mutants = changes(inversions=0.0)
    counts = Counter(tuple(np.flatnonzero(mutant != order)) for mutant in mutants)
    assert set(counts) == set(itertools.combinations(range(7), 2))
    each = len(mutants) / 21
    assert sum((count - each) ** 2 / each for count in counts.values()) < 20 + 5 * math.sqrt(40)


def test_the_probability_of_a_mutation_and_the_share_of_inversions():
    order, mutants = changes(inversions=0.25, rate=0.4, size=50)
    changed = [np.flatnonzero(mutant != order) for mutant in mutants]
    mutated = sum(len(places) > 0 for places in changed) / len(changed)
    assert mutated == pytest.approx(0.4, abs=0.05)
    swaps = sum(len(places) == 2 for places in changed) / len(changed)
    short = 0.25 * 0.4 * (49 + 48) / 1225  # inversions of two or three items exchange two as well
    assert swaps == pytest.approx(0.3 + short, abs=0.05)


# Compiled and in Python -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("crossover", ["order", "edge"])
def test_offspring_are_the_same_compiled_and_in_python(crossover, monkeypatch):
    coding, recipe = Permutation(9), Recipe(crossover, 0.7)
    couples = coding.random(Keys(np.array([5]), np.uint64(2), 0), 20).reshape(1, 10, 2, -1)
    expected = coding.recombine(couples, recipe, Keys(np.array([5]), np.uint64(2), 9))[0]
    monkeypatch.setattr(permutation_kernels, "integers", lambda table, place: np.array([[crossover == "edge"]]))
    monkeypatch.setattr(permutation_kernels, "reals", lambda table, place: np.array([[0.7, 0.5]]))
    for name, value in list(vars(permutation_kernels).items()):
        if hasattr(value, "py_func"):
            monkeypatch.setattr(permutation_kernels, name, value.py_func)
    from genetics import randomness

    monkeypatch.setattr(randomness, "philox", randomness.philox.py_func)
    offspring = np.zeros_like(expected)
    permutation_kernels.variation(couples[0], offspring, np.uint64(2), 5, 9, None)
    np.testing.assert_array_equal(offspring, expected)
