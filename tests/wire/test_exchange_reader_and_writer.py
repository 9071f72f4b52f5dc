"""The compiled reader and writer of exchange messages against the msgpack library."""

import dataclasses
import math
import struct

import msgpack
import numpy as np
import pytest
from exchanges import (
    BITS,
    LIMITS,
    LISTS,
    MESSAGE,
    MOST,
    ORDERS,
    REALS,
    Emigrant,
    anything,
    bit_genomes,
    counts,
    decode,
    encoded,
    exchanges,
    limits_of,
    list_genomes,
    order_genomes,
    read_slowly,
    real_genomes,
    values_of,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from wire.champion import Champion
from wire.exchange import NEVER, REASONS, VERSION, Messages
from wire.exchange_layout import BIRTHPLACE, BORN, GENERATION
from wire.exchange_reader import hear_emigrants_only
from wire.strict import Rejected

OF_REALS = limits_of(REALS, 1)
OF_LISTS = limits_of(LISTS)
OF_ORDERS = limits_of(ORDERS)
messages = st.one_of(
    exchanges(bit_genomes, 2, 16).map(lambda message: (message, LIMITS)),
    exchanges(real_genomes, 1, 16).map(lambda message: (message, OF_REALS)),
    exchanges(list_genomes, 2, 16).map(lambda message: (message, OF_LISTS)),
    exchanges(order_genomes, 2, 16).map(lambda message: (message, OF_ORDERS)),
)
NUMBERS = dataclasses.replace(
    MESSAGE,
    emigrants=(Emigrant(struct.pack("2d", 0.5, -1.0), -2.0),),
    champion=Champion(-2.5, 3, 0, struct.pack("2d", 1.0, -0.0)),
)
PACKED = dataclasses.replace(
    MESSAGE,
    emigrants=(Emigrant(struct.pack("7H", 1, 9, 512, 0, 0, 0, 0), -2.0), Emigrant(bytes(14), math.inf)),
    champion=Champion(-2.5, 3, 0, struct.pack("7H", 3, 0, 1000, 1, 256, 2, 7)),
)
ORDERED = dataclasses.replace(
    MESSAGE,
    emigrants=(Emigrant(struct.pack("5H", 4, 2, 0, 3, 1), -2.0), Emigrant(struct.pack("5H", 4, 3, 2, 1, 0), math.inf)),
    champion=Champion(-2.5, 3, 0, struct.pack("5H", 4, 0, 1, 2, 3)),
)


# Writing --------------------------------------------------------------------------------------------------------------
@given(messages)
def test_a_message_is_written_byte_for_byte_as_the_library_writes_it(case):
    message, _ = case
    assert message.encode() == msgpack.packb(values_of(message))


@given(st.sampled_from([1, 2, 255, 256, 300, 65_535, 65_536]), st.sampled_from([1, 2, 15, 16, 20]), st.booleans())
def test_genomes_and_emigrants_of_any_number_are_written_as_the_library_does(genome_bytes, emigrants, champion):
    genome = bytes(place % 251 for place in range(genome_bytes))
    best = Champion(-0.5, 2, 3, genome[::-1]) if champion else None
    everyone = tuple(Emigrant(genome, float(number)) for number in range(emigrants))
    message = dataclasses.replace(MESSAGE, emigrants=everyone, champion=best)
    assert message.encode() == msgpack.packb(values_of(message))
    assert decode(message.encode(), anything(genome_bytes, emigrants)) == message


@pytest.mark.parametrize("emigrants", [65_535, 65_536])
def test_a_whole_large_deme_may_emigrate(emigrants):
    message = dataclasses.replace(MESSAGE, emigrants=(Emigrant(b"\x01", 0.5),) * emigrants, champion=None)
    payload = message.encode()
    assert payload == msgpack.packb(values_of(message))
    assert decode(payload, anything(1, emigrants)) == message


@given(exchanges(list_genomes, 2, 16))
def test_zeros_at_the_end_of_a_genome_do_not_travel(message):
    everyone = [each.genome for each in message.emigrants] + [message.champion.genome if message.champion else b""]
    payload = message.encode()
    beside = 112  # bytes, if every number is as long as can be
    assert len(payload) <= beside + sum(len(genome.rstrip(b"\0")) for genome in everyone)
    assert decode(payload, OF_LISTS) == message


@given(exchanges(bit_genomes, 2, 16))
def test_a_champion_may_be_kept_to_oneself(message):
    rows = Messages.room(3, 2, 2)
    assert rows.decode(1, message.encode(), LIMITS) is None
    out = np.empty(LIMITS.most_bytes, np.uint8)
    assert encoded(rows, 1, True, out) == message.encode()
    assert encoded(rows, 1, False, out) == dataclasses.replace(message, champion=None).encode()


# Reading --------------------------------------------------------------------------------------------------------------
def forms_of_count(value):
    """Every way to write an integer, the shortest first."""
    forms = [bytes([value])] if value < 1 << 7 else []
    for size in (1, 2, 4, 8):
        wide = value.to_bytes(8, "big")[-size:]
        forms += [bytes([0xCC + size.bit_length() - 1]) + wide] if value < 1 << 8 * size else []
        forms += [bytes([0xD0 + size.bit_length() - 1]) + wide] if value < 1 << 8 * size - 1 else []
    return forms


def forms_of_length(length):
    short = [bytes([0x90 | length])] if length < 16 else []
    return [*short, b"\xdc" + length.to_bytes(2, "big"), b"\xdd" + length.to_bytes(4, "big")]


def forms_of(value):
    """Every way to write a value of a message that is no array."""
    if value is None:
        return [b"\xc0"]
    if isinstance(value, int):
        return forms_of_count(value)
    if isinstance(value, bytes):
        sizes = [size for size in (1, 2, 4) if len(value) < 1 << 8 * size]
        return [bytes([0xC3 + size.bit_length()]) + len(value).to_bytes(size, "big") + value for size in sizes]
    with np.errstate(over="ignore"):
        single = float(np.float32(value))
    short = [b"\xca" + struct.pack(">f", value)] if single == value else []
    return [b"\xcb" + struct.pack(">d", value), *short]


def written(value, choose):
    """A value in msgpack, each part of it in a form that ``choose`` picks."""
    if not isinstance(value, list):
        return choose(forms_of(value))
    return choose(forms_of_length(len(value))) + b"".join(written(part, choose) for part in value)


def test_the_forms_are_what_the_library_reads_as_the_same_value():
    for value in (None, 0, 127, 128, 255, 256, 1 << 15, 1 << 31, 1 << 32, MOST, b"", b"ab", bytes(300), 0.5, 0.1):
        forms = forms_of(value)
        assert {type(msgpack.unpackb(form)) for form in forms} == {type(value)}
        assert {msgpack.unpackb(form) for form in forms} == {value}
    assert [len(forms_of(value)) for value in (0, 255, 256, MOST, b"", 0.5, 0.1)] == [9, 7, 6, 2, 3, 2, 1]
    assert [msgpack.unpackb(form + bytes(3)) for form in forms_of_length(3)] == [[0, 0, 0]] * 3


@given(messages, st.randoms(use_true_random=False))
def test_every_legal_form_of_a_message_is_read(case, rng):
    message, limits = case
    payload = written(values_of(message), rng.choice)
    assert decode(payload, limits) == message
    assert read_slowly(payload, limits) == message


@pytest.mark.parametrize(("genome_bytes", "emigrants"), [(1, 1), (2, 20), (300, 3)])
def test_the_longest_forms_of_the_longest_message_are_within_the_limit(genome_bytes, emigrants):
    genome = bytes(genome_bytes)
    emigrant, champion = Emigrant(genome, 1e300), Champion(1e300, MOST, 15, genome)
    message = dataclasses.replace(MESSAGE, stop_at=MOST, emigrants=(emigrant,) * emigrants, champion=champion)
    payload = written(values_of(message), lambda forms: max(forms, key=len))
    assert decode(payload, anything(genome_bytes, emigrants)) == message


@pytest.mark.parametrize(("tag", "code"), list(enumerate("BHIQbhiq", start=0xCC)))
def test_integers_of_every_width_keep_their_sign(tag, code):
    bits = 8 * struct.calcsize(f">{code}")
    least, past = (0, 1 << bits) if code.isupper() else (-1 << bits - 1, 1 << bits - 1)
    for job in (least, least // 2, -2, -1, 0, 1, past // 2 - 1, past // 2, past - 1):
        if job >= least:
            payload = bytes([0x98, VERSION, tag]) + struct.pack(f">{code}", job) + MESSAGE.encode()[3:]
            assert agrees(payload, LIMITS) == (None if 0 <= job <= MOST else "out of bounds")


@given(st.sampled_from([(MESSAGE, LIMITS), (NUMBERS, OF_REALS)]), st.floats(width=32), st.booleans())
def test_a_short_float_is_a_fitness_if_a_long_one_would_be(case, value, of_champion):
    message, limits = case
    values = values_of(message)
    if of_champion:
        values[6][0] = value
    else:
        values[5][-1][1] = value
    agrees(msgpack.packb(values, use_single_float=True), limits)


# Verdicts -------------------------------------------------------------------------------------------------------------
def verdict(payload, limits):
    """What the compiled reader makes of it: a message, or the reason why not."""
    try:
        return decode(payload, limits)
    except Rejected as error:
        return error.reason


def agrees(payload, limits):
    """The reader agrees with the slow one about ``payload``, and has a reason where it refuses. Returns that, or None.

    Compared by their text, for which a number is a number but not one of another type.
    """
    found, expected = verdict(payload, limits), read_slowly(payload, limits)
    if expected is None:
        assert found in REASONS.values(), payload.hex()
        return found
    assert repr(found) == repr(expected), payload.hex()
    return None


BASES = [
    pytest.param(MESSAGE, LIMITS, id="bits"),
    pytest.param(dataclasses.replace(MESSAGE, champion=None, stop_at=None), LIMITS, id="no champion"),
    pytest.param(NUMBERS, OF_REALS, id="numbers"),
    pytest.param(PACKED, OF_LISTS, id="lists"),
    pytest.param(ORDERED, OF_ORDERS, id="orders"),
]


@pytest.mark.parametrize(("message", "limits"), BASES)
def test_whatever_one_byte_is_changed_to_the_verdict_is_that_of_the_library(message, limits):
    payload = message.encode()
    seen = set()
    for place in range(len(payload)):
        for octet in range(256):
            seen.add(agrees(payload[:place] + bytes([octet]) + payload[place + 1 :], limits))
    assert seen >= {None, "not msgpack", "wrong shape", "wrong type", "other version", "no such genome", "not an array"}


@pytest.mark.parametrize(("message", "limits"), BASES)
def test_every_truncation_and_any_trailing_byte_is_refused(message, limits):
    for longest in (False, True):
        payload = written(values_of(message), max if longest else min)
        assert agrees(payload, limits) is None
        assert {agrees(payload[:end], limits) for end in range(len(payload))} == {"not msgpack"}
        assert {agrees(payload + bytes([octet]), limits) for octet in range(256)} == {"not msgpack"}


@pytest.mark.parametrize(("message", "limits"), BASES)
def test_whatever_byte_comes_in_or_is_left_out_the_verdict_is_that_of_the_library(message, limits):
    payload = written(values_of(message), lambda forms: forms[-1])
    for place in range(len(payload)):
        agrees(payload[:place] + payload[place + 1 :], limits)
        for octet in (0x00, 0x01, 0x7F, 0x90, 0xC0, 0xC1, 0xC4, 0xCA, 0xCB, 0xCC, 0xD3, 0xDC, 0xE0, 0xFF):
            agrees(payload[:place] + bytes([octet]) + payload[place:], limits)


@settings(max_examples=500)
@given(messages, st.randoms(use_true_random=False), st.integers(1, 8))
def test_whatever_bits_are_flipped_the_verdict_is_that_of_the_library(case, rng, flips):
    message, limits = case
    payload = bytearray(written(values_of(message), rng.choice))
    for _ in range(flips):
        payload[rng.randrange(len(payload))] ^= 1 << rng.randrange(8)
    agrees(bytes(payload), limits)


plain = st.none() | st.booleans() | st.integers(-(1 << 63), (1 << 64) - 1) | st.floats() | st.text() | st.binary()
strangers = st.one_of(
    plain, counts, bit_genomes, st.lists(plain, max_size=4), st.dictionaries(st.text(), plain, max_size=1)
)


@settings(max_examples=500)
@given(exchanges(bit_genomes, 2, 16), strangers, st.integers(0, 4), st.integers(0, 7))
def test_whatever_value_stands_in_a_place_the_verdict_is_that_of_the_library(message, stranger, part, place):
    values = values_of(message)
    inner = [values, values[5], values[5][1], values[6] or values, values[7]][part]
    inner[place % len(inner)] = stranger
    agrees(msgpack.packb(values), LIMITS)


@settings(max_examples=500)
@given(st.binary(max_size=LIMITS.most_bytes + 10))
def test_noise_is_refused(payload):
    assert agrees(payload, LIMITS) is not None


# Rows -----------------------------------------------------------------------------------------------------------------
@given(exchanges(bit_genomes, 2, 16), st.integers(0, 2))
def test_a_message_is_read_into_its_own_row_only(message, row):
    rows = Messages(np.full((3, 8), 7), np.full((3, 3, 2), 0xAA, np.uint8), np.full((3, 3), 7.0))
    before = rows.copy()
    assert rows.decode(row, message.encode(), LIMITS) is None
    for array, old in zip(rows, before, strict=True):
        np.testing.assert_array_equal(np.delete(array, row, 0), np.delete(old, row, 0))
    assert rows.champion(row) == message.champion
    if message.champion is None:
        assert rows.header[row, BORN] == NEVER
        assert rows.fitness[row, -1] == math.inf


def test_of_a_message_that_is_refused_nothing_outside_its_row_is_touched():
    rng = np.random.default_rng(1992)
    rows = Messages(np.full((3, 8), 7), np.full((3, 3, 2), 0xAA, np.uint8), np.full((3, 3), 7.0))
    before = rows.copy()
    payload = np.frombuffer(MESSAGE.encode(), np.uint8)
    for _ in range(3000):
        spoilt = payload.copy()
        spoilt[rng.integers(0, len(payload), 2)] = rng.integers(0, 256, 2)
        rows.decode(1, spoilt.tobytes(), LIMITS)
    for array, old in zip(rows, before, strict=True):
        np.testing.assert_array_equal(array[::2], old[::2])


@given(st.lists(exchanges(bit_genomes, 2, 16), min_size=1, max_size=4))
def test_under_the_papers_spy_the_best_emigrant_is_all_that_is_heard(several):
    rows = Messages.room(len(several), BITS.genome_bytes, 2)
    for row, message in enumerate(several):
        rows.decode(row, message.encode(), LIMITS)
    senders = np.arange(len(several)) + 5
    hear_emigrants_only(*rows, senders)
    for row, message in enumerate(several):
        best = message.emigrants[0]
        expected = Champion(best.fitness, message.generation, row + 5, best.genome)
        assert rows.champion(row) == (expected if best.fitness < math.inf else None)
        assert (rows.header[row, BORN], rows.header[row, BIRTHPLACE]) == (rows.header[row, GENERATION], row + 5)
