"""Who mates with whom."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from genetics import randomness, selection

INF = math.inf
# Few values, so that ties are common; infeasible individuals too.
fitnesses = st.sampled_from([0.0, 1.0, 2.0, 3.0, INF])


def demes(rows, deme):
    row = st.lists(fitnesses, min_size=deme, max_size=deme)
    return st.lists(row, min_size=rows, max_size=rows).map(np.array)


def tagged(count, start=0, rows=1):
    """Genomes of one byte that tell who is who."""
    return np.tile(np.arange(start, start + count, dtype=np.uint8)[None, :, None], (rows, 1, 1)).copy()


def couples_by_rank(fitness, seed=1, generation=1, cells=None):
    cells = np.arange(len(fitness)) if cells is None else np.array(cells)
    fitness = np.array(fitness, dtype=float)
    return selection.pairs(fitness, np.uint64(seed), cells, generation, fitness.shape[1], False, 0)


@given(st.data())
def test_an_individual_alone_is_coupled_with_each_of_its_immigrants_in_turn(data):
    rows, senders, slots, count = (data.draw(st.integers(1, most)) for most in (3, 4, 4, 3))
    named = st.lists(st.integers(0, senders - 1), min_size=slots, max_size=slots)
    source_row = np.array(data.draw(st.lists(named, min_size=rows, max_size=rows)))
    own = np.arange(rows, dtype=np.uint8).reshape(rows, 1, 1)
    emigrants = np.arange(100, 100 + senders * (count + 1), dtype=np.uint8).reshape(senders, count + 1, 1)
    expected = [
        [[row, guest] for each in source_row[row] for guest in emigrants[each, :count, 0]] for row in range(rows)
    ]
    assert selection.couples_with(own, emigrants, source_row, count)[..., 0].tolist() == expected


# What is no fitness -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("wrong", [math.nan, -math.nan, -INF])
def test_the_first_that_is_none_is_found(wrong):
    assert selection.unsound(np.array([0.0, -1e308, INF, 5e-324])) == -1
    assert selection.unsound(np.array([])) == -1
    assert selection.unsound(np.array([INF, wrong, 1.0, math.nan])) == 1


# Couples ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("deme", [2, 3, 5, 10, 33])
def test_individuals_mate_in_proportion_to_their_rank(deme):
    fitness = np.random.default_rng(deme).permutation(deme).astype(float)
    rows = 40_000 // deme
    chosen = couples_by_rank(np.tile(fitness, (rows, 1)))
    assert chosen.shape == (rows, deme, 2)
    counts = np.bincount(chosen.ravel(), minlength=deme)
    weight = deme - fitness  # deme for the best, 1 for the worst
    expected = counts.sum() * weight / weight.sum()
    chi_square = np.sum((counts - expected) ** 2 / expected)
    assert abs(chi_square - (deme - 1)) < 5 * math.sqrt(2 * (deme - 1))


def test_the_two_of_a_couple_are_drawn_independently():
    chosen = couples_by_rank(np.tile([0.0, 1.0, 2.0], (10_000, 1))).reshape(-1, 2)
    counts = np.bincount(3 * chosen[:, 0] + chosen[:, 1], minlength=9).reshape(3, 3)
    weight = np.array([3, 2, 1]) / 6
    expected = len(chosen) * np.outer(weight, weight)
    assert np.sum((counts - expected) ** 2 / expected) < 8 + 5 * math.sqrt(16)


# Three sizes of tie groups, and the whole deme.
tied = pytest.mark.parametrize(
    ("fitness", "expected"),
    [
        ([INF, 1.0, 1.0, INF], [0.15, 0.35, 0.35, 0.15]),
        ([2.0, 1.0, 2.0, 2.0, 0.0], [2 / 15, 4 / 15, 2 / 15, 2 / 15, 5 / 15]),
        ([INF] * 16, [1 / 16] * 16),
    ],
)


@tied
@pytest.mark.parametrize("most", [0, 1])
def test_equals_mate_as_often_as_the_mean_of_their_ranks_says(fitness, expected, most):
    first = coupled(np.tile(fitness, (30_000, 1)), 1, most=most)[:, 0, 0]
    shares = np.bincount(first, minlength=len(fitness)) / len(first)
    np.testing.assert_allclose(shares, expected, atol=0.01)


def test_equals_on_either_side_of_the_middle_are_in_the_better_half_as_often():
    chosen = coupled(np.tile([1.0, 0.0, 1.0, 1.0], (20_000, 1)), 1, better_half=True)
    shares = np.bincount(chosen.ravel(), minlength=4) / chosen.size
    np.testing.assert_allclose(shares, [1 / 6, 1 / 2, 1 / 6, 1 / 6], atol=0.01)


def test_the_two_of_a_couple_of_equals_are_drawn_independently():
    chosen = couples_by_rank(np.zeros((10_000, 3))).reshape(-1, 2)
    counts = np.bincount(3 * chosen[:, 0] + chosen[:, 1], minlength=9)
    assert np.sum((counts - len(chosen) / 9) ** 2 / (len(chosen) / 9)) < 8 + 5 * math.sqrt(16)


def test_an_individual_alone_mates_with_itself():
    assert couples_by_rank([[3.0]]).tolist() == [[[0, 0]]]


def test_couples_are_keyed_by_cell_generation_and_seed():
    fitness = np.tile(np.arange(20.0), (4, 1))
    couples = couples_by_rank(fitness)
    for cell in range(4):
        np.testing.assert_array_equal(couples_by_rank(fitness[:1], cells=[cell])[0], couples[cell])
    others = [couples[1], couples_by_rank(fitness, generation=2)[0], couples_by_rank(fitness, seed=2)[0]]
    assert all((couples[0] != other).any() for other in others)


def test_each_parent_is_drawn_by_a_number_of_its_own():
    deme, seed, cell, generation = 21, 1992, 77, 5
    fitness = np.random.default_rng(4).permutation(deme).astype(float)
    order = np.argsort(fitness)
    keys = np.uint64(seed), cell, generation, randomness.SELECT
    expected = [
        [order[selection._place_by_rank(deme, np.uint64(randomness.draw(*keys, couple, number)))] for number in (0, 1)]
        for couple in range(deme)
    ]
    assert couples_by_rank([fitness], seed, generation, cells=[cell])[0].tolist() == expected


@pytest.mark.parametrize("deme", [1, 2, 3, 7, 100, 1000, 1 << 16])
def test_every_ticket_belongs_to_one_individual(deme):
    # The ticket is computed back from a square root, which must be right for the largest deme too.
    tickets = deme * (deme + 1) // 2
    for weight in {*range(1, deme + 1, 1 + deme // 500), deme}:
        for ticket in {weight * (weight - 1) // 2, weight * (weight + 1) // 2 - 1}:
            # Bits of which `below` makes exactly this ticket.
            bits = np.uint64(-(-(ticket << 32) // tickets) << 32)
            assert randomness.below(bits, tickets) == ticket
            assert selection._place_by_rank(deme, bits) == deme - weight


# Other ways to couple ---------------------------------------------------------------------------------------------
def coupled(fitness, count, *, better_half=False, most=0, seed=1):
    fitness = np.array(fitness, dtype=float)
    return selection.pairs(fitness, np.uint64(seed), np.arange(len(fitness)), 1, count, better_half, most)


@pytest.mark.parametrize(("deme", "half"), [(2, 1), (3, 2), (6, 3), (7, 4)])
def test_of_the_better_half_anyone_mates_as_often(deme, half):
    fitness = np.random.default_rng(deme).permutation(deme).astype(float)
    chosen = coupled(np.tile(fitness, (4000, 1)), 5, better_half=True)
    assert chosen.shape == (4000, 5, 2)
    shares = np.bincount(chosen.ravel(), minlength=deme) / chosen.size
    np.testing.assert_allclose(shares, np.where(fitness < half, 1 / half, 0.0), atol=0.01)


@given(st.data(), st.integers(1, 3), st.integers(2, 9), st.integers(1, 3))
def test_nobody_is_chosen_too_often_while_there_are_others(data, rows, deme, most):
    count = data.draw(st.integers(1, 2 * deme))
    chosen = coupled(data.draw(demes(rows, deme)), count, most=most, seed=data.draw(st.integers(0, 1000)))
    assert chosen.shape == (rows, count, 2)
    for row in range(rows):
        assert chosen[row].min() >= 0
        assert chosen[row].max() < deme
        first = chosen[row].ravel()[: most * deme]  # by then everybody has had their turns
        assert np.bincount(first, minlength=deme).max() <= most


def test_a_limit_that_is_never_met_changes_no_proportion():
    fitness = np.tile([2.0, 0.0, 1.0], (20_000, 1))
    chosen = coupled(fitness, 1, most=2)
    np.testing.assert_allclose(np.bincount(chosen.ravel()) / chosen.size, [1 / 6, 1 / 2, 1 / 3], atol=0.01)


def test_who_has_had_their_turns_leaves_the_others_in_proportion():
    chosen = coupled(np.tile([0.0, 1.0, 2.0], (20_000, 1)), 1, most=1)[:, 0]
    after_the_best = chosen[chosen[:, 0] == 0, 1]
    np.testing.assert_allclose(np.bincount(after_the_best) / len(after_the_best), [0, 2 / 3, 1 / 3], atol=0.015)


# Compiled and in Python -------------------------------------------------------------------------------------------
def test_couples_are_the_same_compiled_and_in_python(monkeypatch):
    fitness = np.random.default_rng(3).choice([0.0, 1.0, 2.0, INF], (6, 17))
    rules = [(False, 0), (False, 2), (True, 0)]
    expected = [coupled(fitness, 17, better_half=half, most=most, seed=(1 << 64) - 1) for half, most in rules]
    for module in (randomness, selection):
        for name, value in list(vars(module).items()):
            if hasattr(value, "py_func"):
                monkeypatch.setattr(module, name, value.py_func)
    # Python's argsort is stable by another name.
    couples = [coupled(fitness, 17, better_half=half, most=most, seed=(1 << 64) - 1) for half, most in rules]
    np.testing.assert_array_equal(couples, expected)
