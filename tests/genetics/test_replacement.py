"""Who leaves a deme and who stays."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from genetics import randomness, replacement, selection

INF = math.inf
# Few values, so that ties are common; infeasible individuals too.
fitnesses = st.sampled_from([0.0, 1.0, 2.0, 3.0, INF])


def demes(rows, deme):
    row = st.lists(fitnesses, min_size=deme, max_size=deme)
    return st.lists(row, min_size=rows, max_size=rows).map(np.array)


def tagged(count, start=0, rows=1):
    """Genomes of one byte that tell who is who."""
    return np.tile(np.arange(start, start + count, dtype=np.uint8)[None, :, None], (rows, 1, 1)).copy()


def keys(rows, generation=1):
    """What ties of some rows are drawn by."""
    return np.uint64(1992), np.arange(rows), generation


def places_of(tag, rule):
    """Where that individual is after each of many generations."""
    return [[each for each, _ in rule(generation)].index(tag) for generation in range(3000)]


def assert_even(found, expected):
    """Each of the expected outcomes comes about as often, by a chi-square test, and no other comes."""
    assert set(found) == set(expected)
    each = len(found) / len(expected)
    chi_square = sum((found.count(outcome) - each) ** 2 / each for outcome in expected)
    freedom = len(expected) - 1
    assert chi_square < freedom + 5 * math.sqrt(2 * freedom)


# Immigrants -------------------------------------------------------------------------------------------------------
def admit(fitness, immigrant_fitness, generation=1):
    """The (tag, fitness) of each place afterwards; immigrants are tagged from 100 on."""
    return admit_of([immigrant_fitness], fitness, [1], generation=generation)


def admit_of(strangers, fitness, source_row, count=None, generation=1):
    """The same for any senders, of whom the cell itself, number 0, has emigrants of fitness -1 tagged 200."""
    genomes, fitness = tagged(len(fitness)), np.array([fitness], dtype=float)
    each = len(strangers[0])
    emigrants = tagged(len(strangers) * each, start=100).reshape(-1, each, 1)
    emigrants = np.concatenate([np.full((1, each, 1), 200, np.uint8), emigrants])
    emigrant_fitness = np.array([[-1.0] * each, *strangers], dtype=float)
    count = each if count is None else count
    replacement.admit(
        genomes, fitness, emigrants, emigrant_fitness, np.array([source_row]), count, *keys(1, generation)
    )
    return list(zip(genomes[0, :, 0].tolist(), fitness[0].tolist(), strict=True))


def test_an_immigrant_replaces_the_worst():
    assert admit([1, 5, 3], [2]) == [(0, 1), (100, 2), (2, 3)]


def test_immigrants_come_in_order_each_for_the_worst_of_its_time():
    assert admit([1, 5, 3], [2, 0, 1.5]) == [(0, 1), (102, 1.5), (101, 0)]


def test_an_immigrant_that_is_no_better_stays_out():
    assert admit([1, 5, 3], [5, 6, INF]) == [(0, 1), (1, 5), (2, 3)]


def test_of_equal_worst_each_leaves_as_often():
    assert_even(places_of(100, lambda generation: admit([4, 4, 4], [1], generation)), [0, 1, 2])
    assert_even(places_of(100, lambda generation: admit([INF, 2, INF], [7], generation)), [0, 2])


def test_immigrants_that_come_together_draw_for_themselves():
    def places(generation):
        after = admit_of([[1], [2]], [9] * 4, [1, 2], generation=generation)
        return 4 * after.index((100, 1)) + after.index((101, 2))

    assert_even(
        [places(generation) for generation in range(6000)], [4 * i + j for i in range(4) for j in range(4) if i != j]
    )


def test_on_a_plateau_islands_take_nothing_in():
    assert admit([INF, INF], [INF, INF]) == [(0, INF), (1, INF)]


def test_an_immigrant_may_be_replaced_by_the_next():
    assert admit([1, 5], [4, 3]) == [(0, 1), (101, 3)]


def test_immigrants_come_slot_by_slot():
    assert sorted(admit_of([[4, 6], [3, 7]], [5, 9, 9], [2, 1])) == [(0, 5), (100, 4), (102, 3)]
    assert sorted(admit_of([[4, 3], [2, 1]], [9, 9], [2, 1])) == [(102, 2), (103, 1)]


def test_only_the_first_emigrants_of_each_sender_come():
    tags = [tag for tag, _ in admit_of([[4, 3], [2, 1]], [9, 9, 9], [1, 2], count=1)]
    assert {100, 102} < set(tags)
    assert {101, 103}.isdisjoint(tags)


def test_who_is_north_and_south_comes_twice():
    assert admit_of([[4]], [1, 9, 9], [1, 1]) == [(0, 1), (100, 4), (100, 4)]


def test_an_island_takes_nothing_in_from_itself():
    assert admit_of([[4]], [1, 9, 8], [0, 1, 0, 0]) == [(0, 1), (100, 4), (2, 8)]


@given(st.data(), st.integers(1, 3), st.integers(1, 6), st.integers(0, 5))
def test_after_admission_the_fitness_is_never_worse_and_individuals_stay_whole(data, rows, deme, slots):
    before, immigrants = data.draw(demes(rows, deme)), data.draw(demes(rows, slots)).reshape(rows, slots)
    genomes, fitness = tagged(deme, rows=rows), before.copy()
    strangers = tagged(slots, start=100, rows=rows).reshape(rows * slots, 1, 1)
    emigrants = np.concatenate([np.zeros((rows, 1, 1), np.uint8), strangers])
    emigrant_fitness = np.concatenate([np.full((rows, 1), -1.0), immigrants.reshape(-1, 1)])
    source_row = rows + np.arange(rows * slots).reshape(rows, slots)
    replacement.admit(genomes, fitness, emigrants, emigrant_fitness, source_row, 1, *keys(rows))
    for row in range(rows):
        known = {(tag, value) for tag, value in enumerate(before[row])}
        known |= {(100 + tag, value) for tag, value in enumerate(immigrants[row])}
        now = set(zip(genomes[row, :, 0].tolist(), fitness[row], strict=True))
        assert len(now) == deme, "nobody is there twice"
        assert now <= known
        assert sorted(fitness[row]) == sorted([*before[row], *immigrants[row]])[:deme]


# Replacement of an individual alone -------------------------------------------------------------------------------
def replace_local(fitness, offspring_fitness, *, elitist, generation=1):
    genomes, local = tagged(1), np.array([[fitness]], dtype=float)
    offspring = tagged(len(offspring_fitness), start=100)
    children = np.array([offspring_fitness], dtype=float)
    replacement.replace_local(genomes, local, offspring, children, elitist, *keys(1, generation))
    return genomes[0, 0, 0], local[0, 0]


@pytest.mark.parametrize(
    ("local", "offspring", "by_offspring", "by_elitist"),
    [
        (1, [3, 2, 4], (101, 2), (0, 1)),
        (5, [3, 2, 4], (101, 2), (101, 2)),
        (2, [3, 2, 4], (101, 2), (101, 2)),  # the local individual stays only if it is better
        (INF, [INF], (100, INF), (100, INF)),
        (1, [INF], (100, INF), (0, 1)),
        (INF, [INF, 4], (101, 4), (101, 4)),
    ],
)
def test_the_best_offspring_takes_the_place_of_the_local_individual(local, offspring, by_offspring, by_elitist):
    assert replace_local(local, offspring, elitist=False) == by_offspring
    assert replace_local(local, offspring, elitist=True) == by_elitist


@pytest.mark.parametrize("elitist", [True, False])
def test_of_equal_offspring_each_takes_the_place_as_often(elitist):
    def winner(generation):
        return replace_local(3, [5, 3, 3, 4, 3], elitist=elitist, generation=generation)[0]

    assert_even([winner(generation) for generation in range(3000)], [101, 102, 104])


def test_rows_are_replaced_each_by_its_own():
    genomes, fitness = tagged(1, rows=3), np.array([[1.0], [5.0], [3.0]])
    offspring = tagged(2, start=100, rows=3)
    children = np.array([[2.0, 4.0], [6.0, 4.0], [3.0, INF]])
    replacement.replace_local(genomes, fitness, offspring, children, True, *keys(3))
    assert genomes[:, 0, 0].tolist() == [0, 101, 100]
    assert fitness[:, 0].tolist() == [1.0, 4.0, 3.0]


# Replacement by families ------------------------------------------------------------------------------------------
def replace_families(fitness, couples, offspring_fitness, *, elitist=False, generation=1):
    genomes, deme = tagged(len(fitness)), np.array([fitness], dtype=float)
    offspring = tagged(len(offspring_fitness), start=100)
    children = np.array([offspring_fitness], dtype=float)
    couples = np.array([couples])
    replacement.replace_families(genomes, deme, couples, offspring, children, elitist, *keys(1, generation))
    return list(zip(genomes[0, :, 0].tolist(), deme[0].tolist(), strict=True))


def test_each_couple_leaves_the_best_of_its_family():
    couples = [[0, 1], [1, 2], [2, 2]]
    after = replace_families([4, 5, 6], couples, [9, 3, 9, 9, 5, 6])
    assert after == [(101, 3), (1, 5), (104, 5)]


@pytest.mark.parametrize(
    ("couple", "offspring", "stays"),
    [
        ((0, 1), [7, 7], (100, 7)),  # an offspring before a parent, the first offspring before the second
        ((0, 1), [8, 7], (101, 7)),
        ((0, 1), [6, 6], (100, 6)),
        ((0, 1), [8, 9], (0, 7)),  # the first drawn parent before the second
        ((1, 0), [8, 9], (1, 7)),
        ((0, 1), [INF, INF], (0, 7)),
    ],
)
def test_of_an_equal_family_an_offspring_stays(couple, offspring, stays):
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
    after = replace_families([INF, INF], [[0, 1], [1, 0]], [INF, INF, INF, 3], elitist=True)
    assert after == [(100, INF), (103, 3)]


def test_with_elitism_a_drawn_one_of_the_best_takes_a_drawn_one_of_the_worst_places():
    def after(generation):
        couples = [[2, 3], [3, 2], [2, 2], [3, 3]]
        return replace_families([1, 1, 6, 6], couples, [9] * 8, elitist=True, generation=generation)

    for tag in (0, 1):
        kept = [found for found in map(after, range(3000)) if (tag, 1) in found]
        assert_even([found.index((tag, 1)) for found in kept], [0, 1, 2, 3])
        assert abs(len(kept) - 1500) < 5 * math.sqrt(750)


@given(st.data(), st.integers(1, 3), st.integers(2, 7), st.booleans())
def test_families_leave_their_best_and_elitism_never_loses_the_best(data, rows, deme, elitist):
    before = data.draw(demes(rows, deme))
    children = data.draw(demes(rows, 2 * deme))
    couples = selection.pairs(before, np.uint64(data.draw(st.integers(0, 1000))), np.arange(rows), 1, deme, False, 0)
    genomes, fitness = tagged(deme, rows=rows), before.copy()
    offspring = tagged(2 * deme, 100, rows)
    replacement.replace_families(genomes, fitness, couples, offspring, children, elitist, *keys(rows))
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
def replace_worst(fitness, offspring_fitness, *, elitist=False, generation=1):
    genomes, deme = tagged(len(fitness)), np.array([fitness], dtype=float)
    offspring = tagged(len(offspring_fitness), start=100)
    children = np.array([offspring_fitness], dtype=float)
    replacement.replace_worst(genomes, deme, offspring, children, elitist, *keys(1, generation))
    return list(zip(genomes[0, :, 0].tolist(), deme[0].tolist(), strict=True))


def test_offspring_take_the_places_of_the_worst_whatever_they_are_worth():
    assert replace_worst([4, 1, 3, 2], [9, 5]) == [(101, 5), (1, 1), (100, 9), (3, 2)]


def test_of_equal_worst_each_is_replaced_as_often():
    def stays(generation):
        tags = [tag for tag, _ in replace_worst([4, 4, 1, 4, 9], [5, 6, 7], generation=generation)]
        assert tags[2] == 2
        assert tags[4] >= 100
        (stayed,) = {0, 1, 3} & set(tags)
        return stayed

    assert_even([stays(generation) for generation in range(3000)], [0, 1, 3])


def test_any_of_equal_worst_may_leave_together():
    def leave(generation):
        after = replace_worst([INF] * 5, [7, 7], generation=generation)
        return sum(1 << place for place, (tag, _) in enumerate(after) if tag >= 100)

    assert_even(
        [leave(generation) for generation in range(6000)], [(1 << i) + (1 << j) for i in range(5) for j in range(i)]
    )


def test_with_elitism_any_of_several_best_may_be_kept_when_all_leave():
    def kept(generation):
        (tag,) = {tag for tag, _ in replace_worst([2, 3, 2], [5, 6, 4], elitist=True, generation=generation)} & {0, 2}
        return tag

    assert_even([kept(generation) for generation in range(2000)], [0, 2])


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
    replacement.replace_worst(genomes, fitness, tagged(count, 100, rows), children, elitist, *keys(rows))
    for row in range(rows):
        fitness_of = {**dict(enumerate(before[row])), **{100 + tag: value for tag, value in enumerate(children[row])}}
        tags = genomes[row, :, 0].tolist()
        assert [fitness_of[tag] for tag in tags] == fitness[row].tolist()
        kept = sorted(before[row])[: deme - count]
        children_kept = {*range(100, 100 + count)} & {*tags}
        if elitist and before[row].min() < min([*kept, *children[row]]):
            assert fitness[row].min() == before[row].min()
            assert len(children_kept) == count - 1
        else:
            assert len(children_kept) == count
            assert sorted(fitness_of[tag] for tag in tags if tag < 100) == kept


# Compiled and in Python -------------------------------------------------------------------------------------------
def replaced(fitness, children, immigrants):
    """What becomes of demes by each rule in turn."""
    rows, deme = fitness.shape
    by, couples = keys(rows, (1 << 31) - 1), selection.pairs(fitness, np.uint64(5), np.arange(rows), 1, deme, False, 0)
    genomes, now = tagged(deme, rows=rows), fitness.copy()
    offspring = tagged(2 * deme, 100, rows)
    yield genomes, now
    source_row = rows + np.arange(rows * 2).reshape(rows, 2)
    emigrants = np.concatenate([np.zeros((rows, 1, 1), np.uint8), tagged(2, 200, rows).reshape(-1, 1, 1)])
    emigrant_fitness = np.concatenate([np.zeros((rows, 1)), immigrants.reshape(-1, 1)])
    replacement.admit(genomes, now, emigrants, emigrant_fitness, source_row, 1, *by)
    yield genomes, now
    replacement.replace_worst(genomes, now, offspring[:, :5].copy(), children[:, :5].copy(), True, *by)
    yield genomes, now
    replacement.replace_families(genomes, now, couples, offspring, children, True, *by)
    yield genomes, now
    alone = genomes[:, :1].copy(), now[:, :1].copy()
    replacement.replace_local(*alone, offspring, children, True, *by)
    yield alone


def test_demes_are_the_same_compiled_and_in_python(monkeypatch):
    random = np.random.default_rng(3)
    drawn = [random.choice([0.0, 1.0, 2.0, INF], (6, count)) for count in (9, 18, 2)]
    expected = [(genomes.copy(), fitness.copy()) for genomes, fitness in replaced(*drawn)]
    for module in (randomness, selection, replacement):
        for name, value in list(vars(module).items()):
            if hasattr(value, "py_func"):
                monkeypatch.setattr(module, name, value.py_func)
    found = [(genomes.copy(), fitness.copy()) for genomes, fitness in replaced(*drawn)]
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])
