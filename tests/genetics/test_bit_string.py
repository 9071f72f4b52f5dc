"""Bit strings: what they code, and how they are drawn, crossed and mutated."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from genetics import BitString, Keys, Recipe, bit_kernels, randomness

codings = st.builds(BitString, st.integers(1, 7), st.integers(1, 62), st.booleans())


@st.composite
def coded(draw, rows=5):
    """A coding and some integers that it can hold."""
    coding = draw(codings)
    value = st.integers(0, (1 << coding.bits) - 1)
    row = st.lists(value, min_size=coding.parameters, max_size=coding.parameters)
    return coding, np.array(draw(st.lists(row, min_size=1, max_size=rows)), dtype=np.int64)


@st.composite
def keyed(draw, rows=4):
    """What random draws are keyed by."""
    cells = draw(st.lists(st.integers(0, (1 << 20) - 1), min_size=1, max_size=rows, unique=True))
    return Keys(np.array(cells), draw(st.integers(0, (1 << 64) - 1)), draw(st.integers(0, (1 << 31) - 1)))


def keys_of(rows=1, seed=1, generation=1):
    return Keys(np.arange(rows), seed, generation)


def bits_of(coding, genomes):
    """The bits, shape (..., length)."""
    return np.unpackbits(genomes, axis=-1)[..., : coding.length]


def admits(coding, genome):
    return coding.alphabet.admits(np.frombuffer(genome, np.uint8))


def has_clean_tail(coding, genomes):
    return not np.unpackbits(genomes, axis=-1)[..., coding.length :].any()


def couples_of(coding, keys, count):
    """Random couples, shape (rows, count, 2, bytes)."""
    return coding.random(keys, 2 * count).reshape(len(keys.cells), count, 2, coding.genome_bytes)


def parents_of(coding, couples):
    """The bits of the first and second parents, shape (rows, couples, length) each."""
    bits = bits_of(coding, couples)
    return bits[:, :, 0], bits[:, :, 1]


def children_of(coding, offspring):
    bits = bits_of(coding, offspring)
    return bits[:, 0::2], bits[:, 1::2]


# What a genome codes ------------------------------------------------------------------------------
@given(coded())
def test_integers_are_what_was_encoded(case):
    coding, values = case
    genomes = coding.encode(values)
    assert genomes.shape == (len(values), coding.genome_bytes)
    assert genomes.dtype == np.uint8
    np.testing.assert_array_equal(coding.integers(genomes), values)
    assert has_clean_tail(coding, genomes)
    assert all(coding.alphabet.admits(genome) for genome in genomes)


@given(codings, keyed(rows=1))
def test_every_genome_is_the_code_of_its_integers(coding, keys):
    genomes = coding.random(keys, 3)[0]
    np.testing.assert_array_equal(coding.encode(coding.integers(genomes)), genomes)


def test_the_most_significant_bit_comes_first():
    coding = BitString(parameters=2, bits=6)
    assert coding.length == 12
    assert coding.genome_bytes == 2
    np.testing.assert_array_equal(coding.encode([[0b100001, 0b011110]]), [[0b10000101, 0b11100000]])
    np.testing.assert_array_equal(coding.integers(np.array([[0b10000101, 0b11100000]], np.uint8)), [[33, 30]])


def test_gray_is_the_reflected_code():
    coding = BitString(1, 3, gray=True)
    genomes = coding.encode(np.arange(8)[:, None])
    assert (genomes[:, 0] >> 5).tolist() == [0b000, 0b001, 0b011, 0b010, 0b110, 0b111, 0b101, 0b100]


@given(st.integers(1, 62), st.data())
def test_neighbours_in_gray_code_differ_in_one_bit(bits, data):
    value = data.draw(st.integers(0, (1 << bits) - 2)) if bits > 1 else 0
    coding = BitString(1, bits, gray=True)
    one, other = coding.encode([[value], [value + 1]])
    assert np.unpackbits(one ^ other).sum() == 1


@pytest.mark.parametrize("gray", [False, True])
@pytest.mark.parametrize("bits", [1, 8, 31, 32, 33, 61, 62])
def test_the_ends_of_the_range_are_coded(bits, gray):
    coding = BitString(3, bits, gray)
    values = np.array([[0, (1 << bits) - 1, (1 << bits) // 2]])
    np.testing.assert_array_equal(coding.integers(coding.encode(values)), values)


@pytest.mark.parametrize("values", [[[-1, 0]], [[0, 16]], [[1 << 40, 0]]])
def test_integers_that_do_not_fit_are_refused(values):
    with pytest.raises(ValueError, match=r"expected integers from 0 to 15, found"):
        BitString(2, 4).encode(values)


def test_integers_are_read_from_any_array_of_genomes():
    coding = BitString(2, 10)
    genomes = coding.random(keys_of(), 6)[0]
    expected = coding.integers(genomes)
    read_only = np.frombuffer(genomes.tobytes(), np.uint8).reshape(genomes.shape)
    assert not read_only.flags.writeable
    np.testing.assert_array_equal(coding.integers(read_only), expected)
    np.testing.assert_array_equal(coding.integers(genomes[::2]), expected[::2])
    np.testing.assert_array_equal(coding.integers(np.asfortranarray(genomes)), expected)
    assert coding.integers(genomes[:0]).shape == (0, 2)


@given(codings, st.data())
def test_it_accepts_only_its_own_size_and_a_clean_tail(coding, data):
    whole = data.draw(st.binary(min_size=coding.genome_bytes, max_size=coding.genome_bytes))
    tail = np.unpackbits(np.frombuffer(whole, np.uint8))[coding.length :]
    assert admits(coding, whole) == (not tail.any())
    assert admits(coding, bytes(coding.genome_bytes))
    for wrong in (b"", bytes(coding.genome_bytes - 1), bytes(coding.genome_bytes + 1)):
        assert not admits(coding, wrong)


def test_every_single_bit_beyond_the_length_is_refused():
    coding = BitString(1, 3)
    assert [admits(coding, bytes([0x80 >> bit])) for bit in range(8)] == [True] * 3 + [False] * 5


@pytest.mark.parametrize(("parameters", "bits"), [(0, 4), (-1, 4), (2, 0), (2, 63), (2, -1)])
def test_impossible_codings_are_refused(parameters, bits):
    with pytest.raises(ValueError, match="found"):
        BitString(parameters, bits)


# Random demes -------------------------------------------------------------------------------------
@given(codings, keyed(), st.integers(1, 5))
def test_random_demes_are_genomes_keyed_by_their_cell(coding, keys, deme):
    genomes = coding.random(keys, deme)
    assert genomes.shape == (len(keys.cells), deme, coding.genome_bytes)
    assert has_clean_tail(coding, genomes)
    for row, cell in enumerate(keys.cells):
        alone = coding.random(Keys(np.array([cell]), keys.seed, 0), deme)
        np.testing.assert_array_equal(alone[0], genomes[row])


def test_random_bits_are_even_and_independent():
    coding = BitString(10, 13)
    bits = bits_of(coding, coding.random(keys_of(rows=50), 40)).reshape(2000, -1)
    assert np.abs(bits.mean(axis=0) - 0.5).max() < 5 * 0.5 / math.sqrt(2000)
    correlation = np.corrcoef(bits.T) - np.eye(coding.length)
    assert np.abs(correlation).max() < 6 / math.sqrt(2000)
    assert len(np.unique(bits, axis=0)) == 2000


def test_the_seed_decides_the_first_demes_and_the_generation_does_not():
    coding = BitString(4, 16)
    first = coding.random(keys_of(seed=1), 4)
    assert (first != coding.random(keys_of(seed=2), 4)).any()
    np.testing.assert_array_equal(first, coding.random(keys_of(seed=1, generation=9), 4))


# Crossover ----------------------------------------------------------------------------------------
@given(codings, keyed(), st.integers(1, 4))
def test_one_point_offspring_swap_what_lies_right_of_one_cut(coding, keys, count):
    couples = couples_of(coding, keys, count)
    offspring = coding.recombine(couples, Recipe("one-point"), keys)
    assert offspring.shape == (len(keys.cells), 2 * count, coding.genome_bytes)
    assert has_clean_tail(coding, offspring)
    firsts, seconds = parents_of(coding, couples)
    ones, others = children_of(coding, offspring)
    bits = (each.reshape(-1, coding.length) for each in (firsts, seconds, ones, others))
    for first, second, one, other in zip(*bits, strict=True):
        cuts = [
            cut
            for cut in range(1, max(2, coding.length))
            if (one == [*first[:cut], *second[cut:]]).all() and (other == [*second[:cut], *first[cut:]]).all()
        ]
        assert cuts, "the offspring are the parents with their right parts swapped"


def test_one_point_leaves_the_bytes_on_both_sides_of_the_cut_whole():
    coding = BitString(8, 8)
    keys = keys_of(rows=30)
    couples = couples_of(coding, keys, 4)
    couples[:, :, 0] = 0x0F
    couples[:, :, 1] = 0xF0
    ones, others = coding.recombine(couples, Recipe("one-point"), keys).reshape(120, 2, 8).transpose(1, 0, 2)
    np.testing.assert_array_equal(ones ^ others, np.full((120, 8), 0xFF))
    mixed = ~np.isin(ones, (0x0F, 0xF0))
    assert mixed.sum(axis=1).max() == 1
    for one, its_mixed in zip(ones, mixed, strict=True):
        kinds = one[~its_mixed]
        assert (np.diff((kinds == 0xF0).astype(int)) >= 0).all(), "left of the cut the first parent, then the second"


def test_every_cut_is_as_likely():
    coding = BitString(1, 11)
    keys = keys_of(rows=1000)
    couples = np.zeros((1000, 10, 2, 2), np.uint8)
    couples[:, :, 0] = coding.encode([[2047]])
    ones, _ = children_of(coding, coding.recombine(couples, Recipe("one-point"), keys))
    counts = np.bincount(ones.sum(axis=-1).ravel(), minlength=12)
    assert counts[0] == counts[11] == 0
    assert np.abs(counts[1:11] - 1000).max() < 5 * math.sqrt(1000)


@given(codings, keyed(), st.integers(1, 4))
def test_uniform_offspring_keep_the_bits_of_each_locus(coding, keys, count):
    couples = couples_of(coding, keys, count)
    offspring = coding.recombine(couples, Recipe("uniform"), keys)
    firsts, seconds = parents_of(coding, couples)
    ones, others = children_of(coding, offspring)
    np.testing.assert_array_equal(ones ^ others, firsts ^ seconds)
    np.testing.assert_array_equal(ones & others, firsts & seconds)
    assert has_clean_tail(coding, offspring)


def test_uniform_crossover_takes_each_bit_from_either_parent_with_even_chances():
    coding = BitString(10, 13)
    keys = keys_of(rows=200)
    couples = np.zeros((200, 10, 2, coding.genome_bytes), np.uint8)
    couples[:, :, 0] = coding.encode([[(1 << 13) - 1] * 10])
    ones, _ = children_of(coding, coding.recombine(couples, Recipe("uniform"), keys))
    ones = ones.reshape(2000, -1)
    assert np.abs(ones.mean(axis=0) - 0.5).max() < 5 * 0.5 / math.sqrt(2000)
    assert np.abs(np.corrcoef(ones.T) - np.eye(130)).max() < 6 / math.sqrt(2000)


def test_a_string_of_one_bit_is_left_as_it_is():
    coding = BitString(1, 1)
    keys = keys_of(rows=20)
    couples = couples_of(coding, keys, 3)
    offspring = coding.recombine(couples, Recipe("one-point"), keys)
    np.testing.assert_array_equal(offspring.reshape(couples.shape), couples)


@pytest.mark.parametrize("crossover", ["blend", "two-point", ""])
def test_crossovers_of_other_codings_are_refused(crossover):
    with pytest.raises(ValueError, match=f"found '{crossover}'"):
        BitString(1, 8).check(Recipe(crossover))


# Mutation -----------------------------------------------------------------------------------------
def mutated(coding, rate, rows=100, count=50, generation=1):
    """The bits that are flipped in the offspring of empty parents, shape (rows * 2 * count, length)."""
    couples = np.zeros((rows, count, 2, coding.genome_bytes), np.uint8)
    offspring = coding.recombine(couples, Recipe(mutation=rate), keys_of(rows, generation=generation))
    assert has_clean_tail(coding, offspring)
    return bits_of(coding, offspring).reshape(-1, coding.length)


@pytest.mark.parametrize("rate", [0.001, 0.02, 0.3, 0.5, 0.97])
def test_every_bit_is_flipped_at_the_rate(rate):
    coding = BitString(3, 13)
    flips = mutated(coding, rate)
    spread = math.sqrt(rate * (1 - rate))
    assert abs(flips.mean() - rate) < 5 * spread / math.sqrt(flips.size)
    assert np.abs(flips.mean(axis=0) - rate).max() < 5 * spread / math.sqrt(len(flips))
    # Bits flip independently, so the number in a genome has the binomial law's variance.
    assert flips.sum(axis=1).var() == pytest.approx(39 * rate * (1 - rate), rel=0.1)


def test_without_mutation_nothing_changes():
    assert not mutated(BitString(3, 13), 0.0).any()
    assert not mutated(BitString(3, 13), 1e-300).any()
    assert not mutated(BitString(3, 13), "one-bit").any(), "that mutation is a step of its own"


@pytest.mark.parametrize("coding", [BitString(1, 1), BitString(3, 13), BitString(2, 8)])
def test_mutation_of_certainty_flips_every_bit(coding):
    assert mutated(coding, 1.0, rows=3, count=2).all()


def test_generations_and_offspring_mutate_differently():
    coding = BitString(4, 16)
    one, other = (mutated(coding, 0.5, rows=2, count=5, generation=generation) for generation in (1, 2))
    assert len(np.unique(np.concatenate([one, other]), axis=0)) == 40


@given(codings, keyed(), st.sampled_from(["one-point", "uniform"]), st.floats(0, 1))
def test_no_recipe_sets_a_bit_beyond_the_length(coding, keys, crossover, rate):
    offspring = coding.recombine(couples_of(coding, keys, 2), Recipe(crossover, rate), keys)
    assert has_clean_tail(coding, offspring)
    assert all(coding.alphabet.admits(genome) for genome in offspring.reshape(-1, coding.genome_bytes))


@given(codings, keyed(), st.integers(1, 6))
def test_mutate_one_flips_one_bit_of_one_individual_of_each_row(coding, keys, deme):
    before = coding.random(keys, deme)
    after = before.copy()
    changed = coding.mutate_one(after, keys)
    assert changed.shape == keys.cells.shape
    flips = bits_of(coding, before ^ after).sum(axis=-1)
    expected = np.zeros((len(keys.cells), deme), int)
    expected[np.arange(len(keys.cells)), changed] = 1
    np.testing.assert_array_equal(flips, expected)
    assert has_clean_tail(coding, after)


def test_mutate_one_reaches_every_bit_of_every_individual_as_often():
    coding = BitString(1, 5)
    individuals = np.zeros((3000, 4, 1), np.uint8)
    coding.mutate_one(individuals, keys_of(rows=3000))
    counts = bits_of(coding, individuals).sum(axis=0, dtype=int)
    assert counts.sum() == 3000
    assert np.abs(counts - 150).max() < 5 * math.sqrt(150)


# Compiled and in Python ---------------------------------------------------------------------------
def everything(seed, gray):
    """What all kernels make of a seed, as one list of bytes."""
    coding = BitString(3, 13, gray)
    keys = Keys(np.array([0, 5, 1023]), seed, 7)
    couples = couples_of(coding, keys, 2)
    made = [couples]
    for recipe in (Recipe("one-point", 0.1), Recipe("uniform", 0.4), Recipe("one-point", 1.0), Recipe("uniform", 0.0)):
        made.append(coding.recombine(couples, recipe, keys))
    stray = made[1].copy()
    made += [coding.mutate_one(stray, keys), stray, coding.integers(stray.reshape(-1, coding.genome_bytes))]
    return [array.tobytes() for array in made]


@pytest.mark.parametrize("seed", [1, 1992, (1 << 64) - 1])
@pytest.mark.parametrize("gray", [False, True])
def test_kernels_make_the_same_bits_compiled_and_in_python(seed, gray, monkeypatch):
    expected = everything(seed, gray)
    for module in (randomness, bit_kernels):
        for name, value in list(vars(module).items()):
            if hasattr(value, "py_func"):
                monkeypatch.setattr(module, name, value.py_func)
    assert everything(seed, gray) == expected
