"""What the takeover benchmark measures, on tori small enough to check."""

import numpy as np
import pytest

from benchmarks.takeover import decay, distinct, entropy, selection_alone, soonest, takeover, trap


@pytest.mark.parametrize("shape", ["1x1", "1x7", "4x4", "3x8"])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_best_of_single_individuals_takes_over_a_link_a_generation(shape, seed):
    found = takeover(selection_alone(shape, seed))
    assert found.whole == soonest(shape, 1)
    assert found.shares == sorted(found.shares)
    assert found.shares[found.half] >= 0.5
    assert found.shares[-1] == 1.0


@pytest.mark.parametrize(("deme", "interval"), [(4, 1), (4, 5)])
def test_islands_take_over_no_sooner_than_news_can_travel(deme, interval):
    found = takeover(selection_alone("3x4", 1, deme, interval))
    assert soonest("3x4", interval) <= found.whole < soonest("3x4", interval) + 20


@pytest.mark.parametrize(
    ("shape", "interval", "generations"), [("1x1", 9, 0), ("1x2", 9, 1), ("4x4", 1, 4), ("4x4", 10, 31)]
)
def test_news_crosses_a_link_in_each_exchange(shape, interval, generations):
    assert soonest(shape, interval) == generations


def test_selection_alone_makes_no_new_names():
    seen = []
    found = decay(
        selection_alone("4x5", 3), lambda genomes: seen.append(set(map(bytes, genomes[:, 0]))) or 0.0, (1, 2, 3)
    )
    assert found == [0.0] * 3
    first, second, third = seen
    assert third < second < first


def test_diversity_is_told_at_the_marks():
    lineages = decay(selection_alone("4x4", 1), distinct, (0, 1, 4))
    assert lineages[0] == 1.0
    assert lineages[-1] == 1 / 16
    bits = decay(trap("4x4", 1), lambda genomes: entropy(genomes, 60), (0, 2))
    assert all(0.5 < value <= 1.0 for value in bits)


def test_entropy_is_that_of_each_bit_over_everybody():
    genomes = np.array([[[0b10100000]], [[0b10010000]], [[0b11000000]], [[0b11010000]]], np.uint8)
    of_a_quarter = 0.25 * np.log2(4.0) + 0.75 * np.log2(4.0 / 3.0)
    assert entropy(genomes, 4) == pytest.approx((0.0 + 1.0 + of_a_quarter + 1.0) / 4)
    assert entropy(genomes[:1], 4) == 0.0


def test_genomes_are_distinct_as_whole_bytes():
    assert distinct(np.array([[[1, 0]], [[1, 0]], [[0, 1]], [[1, 1]]], np.uint8)) == 0.75
