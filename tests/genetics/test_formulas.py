"""The formulas of docs/algorithm.md, written a second time from that page, one draw after another."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from genetics import BitString, Keys, RealVector, Recipe, randomness, replacement, selection
from genetics.randomness import CROSS, FLIP_ONE, INITIAL, MUTATE, SELECT, TIE

keyed = st.tuples(st.integers(0, (1 << 64) - 1), st.integers(0, (1 << 20) - 1), st.integers(1, (1 << 31) - 1))


class Draws:
    """u64(purpose, index, number) of the page, for one cell and generation, and what is made of it."""

    def __init__(self, seed, cell, generation):
        self.seed, self.cell, self.generation = np.uint64(seed), cell, generation
        self.keys = Keys(np.array([cell]), np.uint64(seed), generation)

    def words(self, purpose, index, number):
        """The four 32-bit words of Philox, the first two of which are the high and low half of the 64 bits."""
        counter = (number, index, self.generation, 8 * self.cell + purpose)
        key = (int(self.seed) & 0xFFFFFFFF, int(self.seed) >> 32)
        return [int(word) for word in randomness.philox(*(np.uint64(each) for each in (*counter, *key)))]

    def bits(self, *coordinates):
        high, low, *_ = self.words(*coordinates)
        return high << 32 | low

    def unit(self, *coordinates):
        return unit(self.bits(*coordinates))


def unit(bits):
    return (bits >> 11) / 2**53


def below(bits, limit):
    return (bits >> 32) * limit >> 32


def below_again(bits, limit):
    """By the low half of the bits."""
    return (bits & 0xFFFFFFFF) * limit >> 32


def as_bits(genomes, length):
    return np.unpackbits(genomes, axis=-1)[..., :length]


# First demes ----------------------------------------------------------------------------------------------------------
@given(keyed, st.integers(1, 3))
def test_first_demes(key, dimension):
    draws = Draws(*key[:2], 0)
    coding = RealVector(dimension, -2.0, 5.0)
    genes = coding.genes(coding.random(draws.keys, 3)[0])
    expected = [[-2.0 + 7.0 * draws.unit(INITIAL, each, gene) for gene in range(dimension)] for each in range(3)]
    np.testing.assert_array_equal(genes, expected)


# Bit strings ----------------------------------------------------------------------------------------------------------
@given(keyed, st.integers(2, 80), st.sampled_from([0.0, 0.02, 0.3]), st.sampled_from(["one-point", "uniform"]))
def test_crossover_and_mutation_of_bit_strings(key, length, rate, crossover):
    draws, coding = Draws(*key), BitString(length, 1)
    parents = coding.random(draws.keys, 4).reshape(1, 2, 2, -1)
    offspring = as_bits(coding.recombine(parents, Recipe(crossover, rate), draws.keys)[0], length)
    for couple, (first, second) in enumerate(as_bits(parents[0], length)):
        if crossover == "one-point":
            cut = 1 + below(draws.bits(CROSS, couple, 0), length - 1)
            keep = np.arange(length) < cut
        else:
            # Bit i of the genome is decided by bit 7 − i mod 8 of byte ⌊i/8⌋ of the draws, the least byte first.
            keep = [
                draws.bits(CROSS, couple, bit // 64) >> (8 * (bit // 8 % 8) + 7 - bit % 8) & 1 for bit in range(length)
            ]
        for turn, child in enumerate((np.where(keep, first, second), np.where(keep, second, first))):
            place, number = -1, 0
            while rate > 0.0:
                gap = math.log1p(-draws.unit(MUTATE, 2 * couple + turn, number)) / math.log1p(-rate)
                place, number = place + 1 + math.floor(gap), number + 1
                if place >= length:
                    break
                child[place] ^= 1
            np.testing.assert_array_equal(offspring[2 * couple + turn], child)


@given(keyed, st.integers(1, 9))
def test_the_one_bit_rule(key, deme):
    draws, coding = Draws(*key), BitString(5, 7)
    before = coding.random(draws.keys, deme)
    after = before.copy()
    coding.mutate_one(after, draws.keys)
    individual, bit = below(draws.bits(FLIP_ONE, 0, 0), deme), below(draws.bits(FLIP_ONE, 0, 1), 35)
    expected = as_bits(before[0], 35)
    expected[individual, bit] ^= 1
    np.testing.assert_array_equal(as_bits(after[0], 35), expected)


# Real vectors -------------------------------------------------------------------------------------------------------
@given(keyed, st.integers(1, 30), st.sampled_from([0.0, 0.1, 1.0]), st.sampled_from(["blend", "uniform"]))
def test_crossover_mutation_and_clipping_of_real_vectors(key, dimension, rate, crossover):
    draws, low, high = Draws(*key), -2.0, 5.0
    coding = RealVector(dimension, low, high)
    parents = coding.random(draws.keys, 4).reshape(1, 2, 2, -1)
    offspring = coding.genes(coding.recombine(parents, Recipe(crossover, rate), draws.keys)[0])
    expected = []
    for couple, (first, second) in enumerate(coding.genes(parents[0].reshape(4, -1)).reshape(2, 2, dimension)):
        one, other = np.empty(dimension), np.empty(dimension)
        for gene in range(dimension):
            u, v = (share(draws, (2 * couple + turn) * dimension + gene) for turn in (0, 1))
            a, b = first[gene], second[gene]
            if crossover == "blend":
                one[gene], other[gene] = a + (2 * u - 0.5) * (b - a), b - (2 * v - 0.5) * (b - a)
            else:
                one[gene], other[gene] = (b, a) if u < 0.5 else (a, b)
        expected += [*one, *other]
    place = -1
    for number in range(len(expected) + 1 if rate > 0.0 else 0):
        gap = math.log1p(-draws.unit(MUTATE, 0, number)) / math.log1p(-rate) if rate < 1.0 else 0.0
        place += 1 + math.floor(gap)
        if place >= len(expected):
            break
        first, second, third, _ = draws.words(MUTATE, 1, number)
        z = math.sqrt(-2 * math.log(1 - first / 2**32)) * math.cos(2 * math.pi * second / 2**32)
        expected[place] += 0.3 * (high - low) * 10 ** (-4 * third / 2**32) * z
    np.testing.assert_allclose(offspring.ravel(), np.clip(expected, low, high), rtol=1e-12, atol=1e-12)


def share(draws, gene):
    """The number in (0, 1) of a gene: blocks of 64 genes take the four words of 16 draws, word by word."""
    block, place = divmod(gene, 64)
    word, number = divmod(place, 16)
    return (draws.words(CROSS, 0, 16 * block + number)[word] + 0.5) / 2**32


# Selection ----------------------------------------------------------------------------------------------------------
@given(keyed, st.lists(st.sampled_from([0.0, 1.0, 2.0, math.inf]), min_size=1, max_size=20), st.booleans())
def test_selection(key, fitness, better_half):
    draws, n = Draws(*key), len(fitness)
    chosen = selection.pairs(
        np.array([fitness]), draws.seed, np.array([draws.cell]), draws.generation, 5, better_half, 0
    )
    order = sorted(range(n), key=fitness.__getitem__)
    weights = [weight for weight in range(1, n + 1) for _ in range(weight)]  # of all tickets, one after another
    for couple in range(5):
        for number in (0, 1):
            bits = draws.bits(SELECT, couple, number)
            place = below(bits, (n + 1) // 2) if better_half else n - weights[below(bits, len(weights))]
            equals = [each for each in order if fitness[each] == fitness[order[place]]]
            assert chosen[0, couple, number] == equals[below_again(bits, len(equals))]


@pytest.mark.parametrize("n", [2, 5, 20])
def test_selection_pressure(n):
    """The best of n is chosen 2n/(n + 1) times as often as the mean; equals as often as their mean rank says."""
    fitness = np.tile([0.0, *[1.0] * (n - 1)], (100_000 // n, 1))
    chosen = selection.pairs(fitness, np.uint64(5), np.arange(len(fitness)), 1, n, False, 0)
    shares = np.bincount(chosen.ravel(), minlength=n) / chosen.size
    assert shares[0] * n == pytest.approx(2 * n / (n + 1), rel=0.02)
    np.testing.assert_allclose(shares[1:] * n, n / (n + 1), rtol=0.06)


# Ties ---------------------------------------------------------------------------------------------------------------
@given(keyed, st.lists(st.sampled_from([0.0, 1.0, math.inf]), min_size=1, max_size=9))
def test_the_best_offspring_of_a_single_cell(key, fitness):
    draws = Draws(*key)
    offspring = np.arange(len(fitness), dtype=np.uint8).reshape(1, -1, 1)
    local, cells = np.zeros((1, 1, 1), np.uint8), np.array([draws.cell])
    replacement.replace_local(
        local, np.ones((1, 1)), offspring, np.array([fitness]), False, draws.seed, cells, draws.generation
    )
    best = [child for child, its in enumerate(fitness) if its == min(fitness)]
    drawn = below(draws.bits(TIE, 1, 0), len(best)) if len(best) > 1 else 0
    assert local[0, 0, 0] == best[drawn]


# Numbers --------------------------------------------------------------------------------------------------------------
@given(st.integers(0, (1 << 64) - 1), st.integers(1, (1 << 31) - 1))
def test_what_is_made_of_64_bits(bits, limit):
    assert randomness.unit(np.uint64(bits)) == unit(bits)
    assert randomness.below(np.uint64(bits), limit) == below(bits, limit)
