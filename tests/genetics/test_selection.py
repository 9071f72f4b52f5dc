"""Who mates, who leaves and who stays."""

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
    whence = np.array(data.draw(st.lists(named, min_size=rows, max_size=rows)))
    own = np.arange(rows, dtype=np.uint8).reshape(rows, 1, 1)
    emigrants = np.arange(100, 100 + senders * (count + 1), dtype=np.uint8).reshape(senders, count + 1, 1)
    expected = [[[row, guest] for each in whence[row] for guest in emigrants[each, :count, 0]] for row in range(rows)]
    assert selection.couples_with(own, emigrants, whence, count)[..., 0].tolist() == expected


# Immigrants -------------------------------------------------------------------------------------------------------
def admit(fitness, immigrant_fitness):
    """The (tag, fitness) of each place afterwards; immigrants are tagged from 100 on."""
    return admit_of([immigrant_fitness], fitness, [1])


def admit_of(strangers, fitness, whence, count=None):
    """The same for any senders, of whom the cell itself, number 0, has emigrants of fitness -1 tagged 200."""
    genomes, fitness = tagged(len(fitness)), np.array([fitness], dtype=float)
    each = len(strangers[0])
    emigrants = tagged(len(strangers) * each, start=100).reshape(-1, each, 1)
    emigrants = np.concatenate([np.full((1, each, 1), 200, np.uint8), emigrants])
    emigrant_fitness = np.array([[-1.0] * each, *strangers], dtype=float)
    selection.admit(genomes, fitness, emigrants, emigrant_fitness, np.array([whence]), each if count is None else count)
    return list(zip(genomes[0, :, 0].tolist(), fitness[0].tolist(), strict=True))


def test_an_immigrant_replaces_the_worst():
    assert admit([1, 5, 3], [2]) == [(0, 1), (100, 2), (2, 3)]


def test_immigrants_come_in_order_each_for_the_worst_of_its_time():
    assert admit([1, 5, 3], [2, 0, 1.5]) == [(0, 1), (102, 1.5), (101, 0)]


def test_an_immigrant_that_is_no_better_stays_out():
    assert admit([1, 5, 3], [5, 6, INF]) == [(0, 1), (1, 5), (2, 3)]


def test_of_equal_worst_the_latest_born_leaves():
    assert admit([4, 4, 4], [1]) == [(0, 4), (1, 4), (100, 1)]
    assert admit([INF, 2, INF], [7]) == [(0, INF), (1, 2), (100, 7)]


def test_an_immigrant_may_be_replaced_by_the_next():
    assert admit([1, 5], [4, 3]) == [(0, 1), (101, 3)]


def test_immigrants_come_slot_by_slot():
    assert admit_of([[4, 6], [3, 7]], [5, 9, 9], [2, 1]) == [(0, 5), (100, 4), (102, 3)]
    assert admit_of([[4, 3], [2, 1]], [9, 9], [2, 1]) == [(103, 1), (102, 2)]


def test_only_the_first_emigrants_of_each_sender_come():
    assert admit_of([[4, 3], [2, 1]], [9, 9, 9], [1, 2], count=1) == [(0, 9), (102, 2), (100, 4)]


def test_who_is_north_and_south_comes_twice():
    assert admit_of([[4]], [1, 9, 9], [1, 1]) == [(0, 1), (100, 4), (100, 4)]


def test_an_island_takes_nothing_in_from_itself():
    assert admit_of([[4]], [1, 9, 9], [0, 1, 0, 0]) == [(0, 1), (1, 9), (100, 4)]


@given(st.data(), st.integers(1, 3), st.integers(1, 6), st.integers(0, 5))
def test_after_admission_the_fitness_is_never_worse_and_individuals_stay_whole(data, rows, deme, slots):
    before, immigrants = data.draw(demes(rows, deme)), data.draw(demes(rows, slots)).reshape(rows, slots)
    genomes, fitness = tagged(deme, rows=rows), before.copy()
    strangers = tagged(slots, start=100, rows=rows).reshape(rows * slots, 1, 1)
    emigrants = np.concatenate([np.zeros((rows, 1, 1), np.uint8), strangers])
    emigrant_fitness = np.concatenate([np.full((rows, 1), -1.0), immigrants.reshape(-1, 1)])
    whence = rows + np.arange(rows * slots).reshape(rows, slots)
    selection.admit(genomes, fitness, emigrants, emigrant_fitness, whence, 1)
    for row in range(rows):
        known = {(tag, value) for tag, value in enumerate(before[row])}
        known |= {(100 + tag, value) for tag, value in enumerate(immigrants[row])}
        now = set(zip(genomes[row, :, 0].tolist(), fitness[row], strict=True))
        assert len(now) == deme, "nobody is there twice"
        assert now <= known
        assert sorted(fitness[row]) == sorted([*before[row], *immigrants[row]])[:deme]


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


def test_equals_are_ranked_by_birth_and_the_infeasible_last():
    chosen = couples_by_rank(np.tile([INF, 1.0, 1.0, INF], (10_000, 1)))
    shares = np.bincount(chosen.ravel(), minlength=4) / chosen.size
    np.testing.assert_allclose(shares, [0.2, 0.4, 0.3, 0.1], atol=0.01)


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
    expected = [
        [
            selection._by_rank(order, np.uint64(randomness.draw(np.uint64(seed), cell, generation, *coordinates)))
            for coordinates in ((randomness.SELECT, couple, 0), (randomness.SELECT, couple, 1))
        ]
        for couple in range(deme)
    ]
    assert couples_by_rank([fitness], seed, generation, cells=[cell])[0].tolist() == expected


@pytest.mark.parametrize("deme", [1, 2, 3, 7, 100, 1000, 1 << 16])
def test_every_ticket_belongs_to_one_individual(deme):
    # The ticket is computed back from a square root, which must be right for the largest deme too.
    order = np.arange(deme)
    tickets = deme * (deme + 1) // 2
    for weight in {*range(1, deme + 1, 1 + deme // 500), deme}:
        for ticket in {weight * (weight - 1) // 2, weight * (weight + 1) // 2 - 1}:
            # Bits of which `below` makes exactly this ticket.
            bits = np.uint64(-(-(ticket << 32) // tickets) << 32)
            assert randomness.below(bits, tickets) == ticket
            assert selection._by_rank(order, bits) == deme - weight


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


# Replacement of an individual alone -------------------------------------------------------------------------------
def replace_local(fitness, offspring_fitness, *, elitist):
    genomes, local = tagged(1), np.array([[fitness]], dtype=float)
    offspring = tagged(len(offspring_fitness), start=100)
    selection.replace_local(genomes, local, offspring, np.array([offspring_fitness], dtype=float), elitist)
    return genomes[0, 0, 0], local[0, 0]


@pytest.mark.parametrize(
    ("local", "offspring", "by_offspring", "by_elitist"),
    [
        (1, [3, 2, 4], (101, 2), (0, 1)),
        (5, [3, 2, 4], (101, 2), (101, 2)),
        (2, [3, 2, 2], (101, 2), (101, 2)),  # the local individual stays only if it is better
        (9, [3, 3, 3], (100, 3), (100, 3)),  # of equal offspring the first
        (INF, [INF, INF], (100, INF), (100, INF)),
        (1, [INF, INF], (100, INF), (0, 1)),
        (INF, [INF, 4], (101, 4), (101, 4)),
    ],
)
def test_the_best_offspring_takes_the_place_of_the_local_individual(local, offspring, by_offspring, by_elitist):
    assert replace_local(local, offspring, elitist=False) == by_offspring
    assert replace_local(local, offspring, elitist=True) == by_elitist


def test_rows_are_replaced_each_by_its_own():
    genomes, fitness = tagged(1, rows=3), np.array([[1.0], [5.0], [3.0]])
    offspring = tagged(2, start=100, rows=3)
    selection.replace_local(genomes, fitness, offspring, np.array([[2.0, 4.0], [6.0, 4.0], [3.0, INF]]), True)
    assert genomes[:, 0, 0].tolist() == [0, 101, 100]
    assert fitness[:, 0].tolist() == [1.0, 4.0, 3.0]


# Replacement by families ------------------------------------------------------------------------------------------
def replace_families(fitness, couples, offspring_fitness, *, elitist=False):
    genomes, deme = tagged(len(fitness)), np.array([fitness], dtype=float)
    offspring = tagged(len(offspring_fitness), start=100)
    children = np.array([offspring_fitness], dtype=float)
    selection.replace_families(genomes, deme, np.array([couples]), offspring, children, elitist)
    return list(zip(genomes[0, :, 0].tolist(), deme[0].tolist(), strict=True))


def test_each_couple_leaves_the_best_of_its_family():
    couples = [[0, 1], [1, 2], [2, 2]]
    after = replace_families([4, 5, 6], couples, [9, 3, 9, 9, 5, 6])
    assert after == [(101, 3), (1, 5), (104, 5)]


@pytest.mark.parametrize(
    ("couple", "offspring", "stays"),
    [
        ((0, 1), [7, 7], (0, 7)),  # a parent before an offspring, the first drawn parent before the second
        ((1, 0), [7, 7], (1, 7)),
        ((0, 1), [6, 6], (100, 6)),  # the first offspring before the second
        ((0, 1), [8, 7], (0, 7)),
        ((0, 1), [INF, INF], (0, 7)),
    ],
)
def test_of_an_equal_family_the_earlier_born_stays(couple, offspring, stays):
    after = replace_families([7, 7], [couple, couple], offspring * 2)
    assert after[0] == stays


def test_families_are_formed_of_the_old_deme_not_of_places_already_taken():
    after = replace_families([1, 5], [[1, 1], [0, 0]], [9, 9, 9, 9])
    assert after == [(1, 5), (0, 1)]


def test_without_elitism_the_best_may_be_lost():
    assert replace_families([1, 5, 6], [[1, 2], [1, 1], [2, 2]], [9] * 6) == [(1, 5), (1, 5), (2, 6)]


def test_with_elitism_the_best_takes_the_worst_place():
    after = replace_families([1, 5, 6], [[1, 2], [1, 1], [2, 2]], [9] * 6, elitist=True)
    assert after == [(1, 5), (1, 5), (0, 1)]


def test_with_elitism_nobody_is_replaced_if_somebody_as_good_was_left():
    couples = [[1, 2], [1, 1], [2, 2]]
    assert replace_families([1, 5, 6], couples, [1, 9, 9, 9, 9, 9], elitist=True) == [(100, 1), (1, 5), (2, 6)]


def test_infeasible_families_leave_somebody_infeasible():
    after = replace_families([INF, INF, 2], [[0, 1], [1, 0], [0, 0]], [INF] * 6, elitist=True)
    assert after == [(2, 2), (1, INF), (0, INF)]
    after = replace_families([INF, INF], [[0, 1], [1, 0]], [INF, INF, INF, 3], elitist=True)
    assert after == [(0, INF), (103, 3)]


@given(st.data(), st.integers(1, 3), st.integers(2, 7), st.booleans())
def test_families_leave_their_best_and_elitism_never_loses_the_best(data, rows, deme, elitist):
    before = data.draw(demes(rows, deme))
    children = data.draw(demes(rows, 2 * deme))
    couples = couples_by_rank(before, seed=data.draw(st.integers(0, 1000)))
    genomes, fitness = tagged(deme, rows=rows), before.copy()
    selection.replace_families(genomes, fitness, couples, tagged(2 * deme, 100, rows), children, elitist)
    for row in range(rows):
        of_families = [
            min(*before[row, couples[row, couple]], *children[row, 2 * couple : 2 * couple + 2])
            for couple in range(deme)
        ]
        if elitist:
            assert fitness[row].min() == min(before[row].min(), children[row].min())
            assert np.sum(fitness[row] != of_families) <= 1
        else:
            assert fitness[row].tolist() == of_families
        fitness_of = {**dict(enumerate(before[row])), **{100 + tag: value for tag, value in enumerate(children[row])}}
        assert [fitness_of[tag] for tag in genomes[row, :, 0].tolist()] == fitness[row].tolist()


# Replacement of the worst ------------------------------------------------------------------------------------------
def replace_worst(fitness, offspring_fitness, *, elitist=False):
    genomes, deme = tagged(len(fitness)), np.array([fitness], dtype=float)
    offspring = tagged(len(offspring_fitness), start=100)
    selection.replace_worst(genomes, deme, offspring, np.array([offspring_fitness], dtype=float), elitist)
    return list(zip(genomes[0, :, 0].tolist(), deme[0].tolist(), strict=True))


def test_offspring_take_the_places_of_the_worst_whatever_they_are_worth():
    assert replace_worst([4, 1, 3, 2], [9, 5]) == [(101, 5), (1, 1), (100, 9), (3, 2)]


def test_of_equal_worst_the_latest_born_are_replaced():
    assert replace_worst([4, 4, 1, 4], [5, 6]) == [(0, 4), (100, 5), (2, 1), (101, 6)]
    assert replace_worst([INF, 1, INF], [7]) == [(0, INF), (1, 1), (100, 7)]


def test_a_whole_generation_may_be_replaced():
    assert replace_worst([1, 2], [5, 6]) == [(100, 5), (101, 6)]


def test_with_elitism_the_best_of_a_generation_that_is_replaced_takes_the_worst_place():
    assert replace_worst([2, 1], [5, 6], elitist=True) == [(1, 1), (100, 5)]
    assert replace_worst([2, 1], [5, 1], elitist=True) == [(101, 1), (100, 5)]


@given(st.data(), st.integers(1, 3), st.integers(2, 8), st.booleans())
def test_who_is_not_among_the_worst_stays_and_elitism_never_loses_the_best(data, rows, deme, elitist):
    count = data.draw(st.integers(1, deme))
    before, children = data.draw(demes(rows, deme)), data.draw(demes(rows, count)).reshape(rows, count)
    genomes, fitness = tagged(deme, rows=rows), before.copy()
    selection.replace_worst(genomes, fitness, tagged(count, 100, rows), children, elitist)
    for row in range(rows):
        fitness_of = {**dict(enumerate(before[row])), **{100 + tag: value for tag, value in enumerate(children[row])}}
        tags = genomes[row, :, 0].tolist()
        assert [fitness_of[tag] for tag in tags] == fitness[row].tolist()
        kept = sorted(range(deme), key=lambda tag, row=row: (before[row, tag], tag))[: deme - count]
        expected = {*kept, *range(100, 100 + count)}
        if elitist and before[row].min() < min(fitness_of[tag] for tag in expected):
            assert fitness[row].min() == before[row].min()
            assert len(expected - set(tags)) == 1
        else:
            assert set(tags) == expected


# Compiled and in Python -------------------------------------------------------------------------------------------
def test_couples_are_the_same_compiled_and_in_python(monkeypatch):
    fitness = np.random.default_rng(3).choice([0.0, 1.0, 2.0, INF], (6, 17))
    expected = couples_by_rank(fitness, seed=(1 << 64) - 1, generation=(1 << 31) - 1)
    for module in (randomness, selection):
        for name, value in list(vars(module).items()):
            if hasattr(value, "py_func"):
                monkeypatch.setattr(module, name, value.py_func)
    # Python's argsort is stable by another name.
    couples = couples_by_rank(fitness, seed=(1 << 64) - 1, generation=(1 << 31) - 1)
    np.testing.assert_array_equal(couples, expected)
