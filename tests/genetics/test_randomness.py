"""The generator against its published vectors, and the numbers made of it."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from genetics import randomness
from genetics.randomness import below, draw, normal, philox, unit

ALL_BITS = (1 << 64) - 1
PURPOSES = {
    name: value for name, value in vars(randomness).items() if name.isupper() and name[0] != "_" and type(value) is int
}

words = st.integers(0, (1 << 32) - 1)
bits64 = st.integers(0, ALL_BITS)


def from_hex(text):
    return [np.uint64(int(word, 16)) for word in text.split()]


def draws(count, *, seed=7, cell=3, generation=11, purpose=randomness.CROSS, index=0):
    return [draw(np.uint64(seed), cell, generation, purpose, index, number) for number in range(count)]


def chi_square(counts):
    """Pearson's statistic against equal chances, in standard deviations above what chance gives."""
    expected = np.sum(counts) / len(counts)
    freedom = len(counts) - 1
    return (np.sum((np.asarray(counts) - expected) ** 2) / expected - freedom) / math.sqrt(2 * freedom)


@pytest.fixture
def interpreted(monkeypatch):
    """The module's functions as plain Python, the inner ones too."""
    for name, value in list(vars(randomness).items()):
        if hasattr(value, "py_func"):
            monkeypatch.setattr(randomness, name, value.py_func)
    return randomness


# The known answers of the Random123 distribution (kat_vectors, philox4x32 10).
@pytest.mark.parametrize(
    ("counter", "key", "answer"),
    [
        ("00000000 00000000 00000000 00000000", "00000000 00000000", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
        ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff", "408f276d 41c83b0e a20bc7c6 6d5451fd"),
        ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0", "d16cfe09 94fdcceb 5001e420 24126ea1"),
    ],
)
def test_philox_gives_the_published_answers(counter, key, answer):
    assert list(philox(*from_hex(counter), *from_hex(key))) == [int(word) for word in from_hex(answer)]
    in_python = philox.py_func(*from_hex(counter), *from_hex(key))
    assert [int(word) for word in in_python] == [int(word) for word in from_hex(answer)]


def test_a_draw_is_two_words_of_philox_at_its_coordinates():
    seed, cell, generation, index, number = 0x299F31D0A4093822, 5, 77, 9, 12
    counter = [number, index, generation, cell * 8 + randomness.SELECT]
    high, low, *_ = philox(*(np.uint64(word) for word in (*counter, 0xA4093822, 0x299F31D0)))
    assert draw(np.uint64(seed), cell, generation, randomness.SELECT, index, number) == (high << 32) | low


@given(st.lists(words, min_size=6, max_size=6))
def test_philox_is_the_same_compiled_and_in_python(state):
    state = [np.uint64(word) for word in state]
    assert list(philox(*state)) == [int(word) for word in philox.py_func(*state)]


def test_draws_and_their_numbers_are_the_same_compiled_and_in_python(request):
    rng = np.random.default_rng(1992)
    coordinates = [
        (np.uint64(rng.integers(0, ALL_BITS, dtype=np.uint64, endpoint=True)), *map(int, rng.integers(0, limits)))
        for limits in [(1 << 20, 1 << 31, len(PURPOSES), 1 << 16, 1 << 31)] * 300
    ]
    raw = [draw(*each) for each in coordinates]
    units = [unit(np.uint64(bits)) for bits in raw]
    integers = [below(np.uint64(bits), 1 + bits % 1000) for bits in raw]
    normals = [normal(np.uint64(one), np.uint64(two)) for one, two in itertools.pairwise(raw)]
    python = request.getfixturevalue("interpreted")
    assert [int(python.draw(*each)) for each in coordinates] == raw
    assert [float(python.unit(np.uint64(bits))) for bits in raw] == units
    assert [int(python.below(np.uint64(bits), 1 + bits % 1000)) for bits in raw] == integers
    in_python = [float(python.normal(np.uint64(one), np.uint64(two))) for one, two in itertools.pairwise(raw)]
    np.testing.assert_allclose(in_python, normals, rtol=1e-13)  # the logarithm and cosine are those of two libraries


@pytest.mark.parametrize("count", [1, 15, 16, 33])
def test_words_are_all_bits_of_draws_in_a_row(count, request):
    coordinates = (np.uint64(0x299F31D0A4093822), 5, (1 << 32) - 1, randomness.CROSS, 9)
    first = (1 << 32) - count
    made, in_python = np.empty((4, count), np.uint32), np.empty((4, count), np.uint32)
    randomness.words(made, *coordinates, first)
    counters = [(first + place, 9, (1 << 32) - 1, 5 * 8 + randomness.CROSS) for place in range(count)]
    keys = np.uint64(0xA4093822), np.uint64(0x299F31D0)
    assert made.T.tolist() == [list(philox(*map(np.uint64, counter), *keys)) for counter in counters]
    one_by_one = [draw(*coordinates, first + place) for place in range(count)]
    assert [int(high) << 32 | int(low) for high, low, *_ in made.T] == one_by_one
    request.getfixturevalue("interpreted").words(in_python, *coordinates, first)
    np.testing.assert_array_equal(made, in_python)


def test_every_coordinate_makes_another_stream():
    coordinates = list(
        itertools.product(
            (0, 1, 1 << 32, ALL_BITS),
            (0, 1, 7, 8, (1 << 20) - 1),
            (0, 1, 2, (1 << 32) - 1),
            PURPOSES.values(),
            (0, 1, 5),
            (0, 1, 2, 3),
        )
    )
    values = {draw(np.uint64(seed), *rest) for seed, *rest in coordinates}
    assert len(values) == len(coordinates)


def test_purposes_are_distinct_and_fit_beside_the_cell():
    assert {"INITIAL", "SELECT", "CROSS", "MUTATE", "FLIP_ONE", "DELAY"} <= PURPOSES.keys()
    assert len(set(PURPOSES.values())) == len(PURPOSES)
    assert all(0 <= value < 8 for value in PURPOSES.values())


def test_streams_are_not_correlated():
    one = np.array([unit(np.uint64(bits)) for bits in draws(20_000)])
    for other in (
        draws(20_000, seed=8),
        draws(20_000, cell=4),
        draws(20_000, generation=12),
        draws(20_000, purpose=randomness.MUTATE),
        draws(20_000, index=1),
    ):
        their = np.array([unit(np.uint64(bits)) for bits in other])
        assert abs(np.corrcoef(one, their)[0, 1]) < 5 / math.sqrt(20_000)


def test_a_seed_and_a_generation_up_to_their_limits_are_taken_whole():
    assert len({draw(np.uint64(1 << bit), 0, 0, 0, 0, 0) for bit in range(64)}) == 64
    assert len({draw(np.uint64(1), 0, 1 << bit, 0, 0, 0) for bit in range(32)}) == 32


@given(bits64)
def test_unit_lies_in_the_half_open_interval(bits):
    assert unit(np.uint64(bits)) == (bits >> 11) / (1 << 53)
    assert 0.0 <= unit(np.uint64(bits)) < 1.0


def test_unit_at_its_ends():
    assert unit(np.uint64(0)) == 0.0
    assert unit(np.uint64(ALL_BITS)) == 1.0 - 2.0**-53


def test_unit_is_uniform():
    values = [unit(np.uint64(bits)) for bits in draws(50_000)]
    counts, _ = np.histogram(values, bins=100, range=(0, 1))
    assert abs(chi_square(counts)) < 5


@given(bits64, st.integers(1, (1 << 31) - 1))
def test_below_lies_in_its_range(bits, limit):
    assert below(np.uint64(bits), limit) == (bits >> 32) * limit >> 32
    assert 0 <= below(np.uint64(bits), limit) < limit


@pytest.mark.parametrize("limit", [1, 2, 3, 1000, (1 << 31) - 1, (1 << 16) * ((1 << 16) + 1) // 2])
def test_below_reaches_both_ends(limit):
    assert below(np.uint64(0), limit) == 0
    assert below(np.uint64(ALL_BITS), limit) == limit - 1


@pytest.mark.parametrize("limit", [2, 3, 10, 97])
def test_below_is_uniform(limit):
    counts = np.bincount([below(np.uint64(bits), limit) for bits in draws(30_000)], minlength=limit)
    assert len(counts) == limit
    assert abs(chi_square(counts)) < 5


def test_normal_numbers_have_the_moments_of_the_normal_law():
    pairs = zip(draws(50_000), draws(50_000, index=1), strict=True)
    values = np.array([normal(np.uint64(one), np.uint64(two)) for one, two in pairs])
    tolerance = 5 / math.sqrt(len(values))
    assert abs(values.mean()) < tolerance
    assert abs(values.var() - 1) < math.sqrt(2) * tolerance
    assert abs((values**3).mean()) < math.sqrt(15) * tolerance
    assert abs((values**4).mean() - 3) < math.sqrt(96) * tolerance
    assert abs((np.abs(values) < 1).mean() - 0.682689) < 0.47 * tolerance


@given(st.sampled_from([0, 1, ALL_BITS, ALL_BITS - 1, 1 << 63]), bits64)
def test_normal_numbers_are_finite(one, two):
    assert abs(normal(np.uint64(one), np.uint64(two))) < 9
