"""The exchange message: there and back, and everything that is refused on the way."""

import dataclasses
import math
import struct
import tracemalloc
from collections import Counter

import msgpack
import pytest
from exchanges import (
    BITS,
    LIMITS,
    MESSAGE,
    MOST,
    REALS,
    Emigrant,
    Exchange,
    anything,
    bit_genomes,
    decode,
    exchanges,
    limits_of,
    read_slowly,
    real_genomes,
)
from hypothesis import given
from hypothesis import strategies as st

from wire.champion import Champion
from wire.exchange import REASONS, VERSION
from wire.strict import Rejected


def fields_of(message=MESSAGE):
    """The message as lists that can be spoilt."""
    return msgpack.unpackb(message.encode())


def spoilt(place, value):
    """The message with another value at a place, such as (5, 0, 1)."""
    fields = fields_of()
    inner = fields
    for index in place[:-1]:
        inner = inner[index]
    inner[place[-1]] = value
    return msgpack.packb(fields)


def reason(payload, limits=LIMITS):
    with pytest.raises(Rejected) as caught:
        decode(payload, limits)
    assert str(caught.value) == caught.value.reason
    return caught.value.reason


# There and back -------------------------------------------------------------------------------------------------------
@given(st.integers(1, 3).flatmap(lambda emigrants: exchanges(bit_genomes, emigrants, 16)))
def test_a_message_of_bits_comes_back_as_it_was(message):
    limits = limits_of(BITS, len(message.emigrants))
    payload = message.encode()
    assert len(payload) <= limits.most_bytes
    assert decode(payload, limits) == message


@given(exchanges(real_genomes, 2, 1))
def test_a_message_of_numbers_comes_back_as_it_was(message):
    assert decode(message.encode(), limits_of(REALS, 2, cells=1)) == message


def test_the_parts_of_a_message_have_their_types():
    message = decode(MESSAGE.encode(), LIMITS)
    assert message == MESSAGE
    assert isinstance(message.emigrants, tuple)
    assert [type(each) for each in message.emigrants] == [Emigrant, Emigrant]
    assert type(message.champion) is Champion


def test_the_layout_is_that_of_the_protocol():
    assert fields_of() == [
        VERSION,
        3,
        1,
        300,
        70_000,
        [[b"\x12\x34", 1.5], [b"\xff\xfe", math.inf]],
        [0.25, 17, 15, b"\x80\x02"],
        [301, 2408],
    ]


@pytest.mark.parametrize("genome_bytes", [1, 8, 300, 70_000])
@pytest.mark.parametrize("emigrants", [1, 20, 300])
def test_the_longest_message_is_no_longer_than_the_limit(genome_bytes, emigrants):
    limits = anything(genome_bytes, emigrants, 1 << 20)
    genome = bytes(genome_bytes)
    emigrant = Emigrant(genome, 1e300)
    champion = Champion(1e300, MOST, (1 << 20) - 1, genome)
    message = Exchange(MOST, MOST, MOST, MOST, (emigrant,) * emigrants, champion, MOST, MOST)
    assert len(message.encode()) <= limits.most_bytes
    assert decode(message.encode(), limits) == message


# What is refused ------------------------------------------------------------------------------------------------------
SCALARS = [
    ((1,), "job"),
    ((2,), "epoch"),
    ((3,), "generation"),
    ((4,), "stop_at"),
    ((7, 0), "sent"),
    ((7, 1), "evaluations"),
]
COUNTS = [*SCALARS, ((6, 1), "champion's generation"), ((6, 2), "champion's cell")]
FITNESSES = [((5, 0, 1), "emigrant's fitness"), ((6, 0), "champion's fitness")]
GENOMES = [((5, 1, 0), "emigrant's genome"), ((6, 3), "champion's genome")]


def named(place):
    return place if isinstance(place, str) else None


@pytest.mark.parametrize("version", [0, 2, -1, VERSION + 0.0, True, "1", None, [1], b"\x01"])
def test_another_version_is_refused(version):
    assert reason(spoilt((0,), version)) == "other version"


@pytest.mark.parametrize("value", [True, False, 1.0, "1", b"1", [], [1], math.nan])
@pytest.mark.parametrize(("place", "name"), COUNTS, ids=named)
def test_what_is_no_integer_is_no_count(place, name, value):
    assert reason(spoilt(place, value)) == "wrong type"


@pytest.mark.parametrize("value", [-1, 1 << 62, (1 << 64) - 1, -(1 << 63)])
@pytest.mark.parametrize(("place", "name"), COUNTS, ids=named)
def test_counts_have_bounds(place, name, value):
    assert reason(spoilt(place, value)) == "out of bounds"


@pytest.mark.parametrize(("place", "name"), [pair for pair in COUNTS if pair[1] != "stop_at"], ids=named)
def test_nothing_is_no_count(place, name):
    assert reason(spoilt(place, None)) == "wrong type"


def test_nobody_need_have_proposed_a_stop_and_there_need_be_no_champion():
    message = dataclasses.replace(MESSAGE, stop_at=None, champion=None)
    assert decode(message.encode(), LIMITS) == message


def test_a_champion_that_is_infeasible_stands_for_none():
    infeasible = dataclasses.replace(MESSAGE, champion=Champion(math.inf, 17, 15, bytes([0x80, 0x02])))
    none = dataclasses.replace(MESSAGE, champion=None)
    assert infeasible.encode() == none.encode()
    assert decode(spoilt((6, 0), math.inf), LIMITS) == none


@pytest.mark.parametrize(("cell", "right"), [(0, True), (15, True), (16, False), (1 << 20, False)])
def test_a_champion_comes_from_a_cell_that_there_is(cell, right):
    if right:
        assert decode(spoilt((6, 2), cell), LIMITS).champion.cell == cell
    else:
        assert reason(spoilt((6, 2), cell)) == "out of bounds"


@pytest.mark.parametrize("value", [1, 0, True, "1.0", None, [1.0], b""])
@pytest.mark.parametrize(("place", "name"), FITNESSES, ids=named)
def test_what_is_no_float_is_no_fitness(place, name, value):
    assert reason(spoilt(place, value)) == "wrong type"


@pytest.mark.parametrize("value", [math.nan, -math.nan, -math.inf])
@pytest.mark.parametrize(("place", "name"), FITNESSES, ids=named)
def test_a_fitness_is_finite_or_infeasible(place, name, value):
    assert reason(spoilt(place, value)) == "not finite"


@pytest.mark.parametrize("value", ["ab", 3, None, [], True, [0x12, 0x34]])
@pytest.mark.parametrize(("place", "name"), GENOMES, ids=named)
def test_a_genome_is_bytes(place, name, value):
    assert reason(spoilt(place, value)) == "wrong type"


@pytest.mark.parametrize(
    ("genome", "why"),
    [
        (b"\x00\x01", "no such genome"),  # a bit beyond the length
        (b"\x00\x00\x00", "genome too long"),
        (bytes(200), "genome too long"),
    ],
)
@pytest.mark.parametrize(("place", "name"), GENOMES, ids=named)
def test_a_genome_is_one_of_the_coding(place, name, genome, why):
    assert reason(spoilt(place, genome)) == why


@pytest.mark.parametrize("genome", [b"", b"\x12", b"\x12\x00"])
@pytest.mark.parametrize(("place", "name"), GENOMES, ids=named)
def test_zeros_at_the_end_of_a_genome_need_not_travel(place, name, genome):
    message = decode(spoilt(place, genome), LIMITS)
    read = message.champion.genome if name.startswith("champion") else message.emigrants[place[1]].genome
    assert read == genome.ljust(2, b"\0")


@pytest.mark.parametrize("genes", [(math.nan, 0.0), (0.0, math.inf), (1.5, 0.0)])
def test_genes_are_finite_and_within_their_bounds(genes):
    message = dataclasses.replace(MESSAGE, emigrants=(Emigrant(struct.pack("2d", *genes), 1.0),), champion=None)
    assert reason(message.encode(), limits_of(REALS, 1)) == "no such genome"


@pytest.mark.parametrize("emigrants", [0, 1, 3, 8])
def test_the_number_of_emigrants_is_exact(emigrants):
    assert reason(spoilt((5,), fields_of()[5][:1] * emigrants)) == "wrong shape"


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ((5,), None),
        ((5,), 2),
        ((5,), "ab"),
        ((5,), {}),
        ((5, 0), None),
        ((5, 0), [b"\x12\x34"]),
        ((5, 0), [b"\x12\x34", 1.0, 1.0]),
        ((6,), []),
        ((6,), 0),
        ((6,), [0.25, 17, 15]),
        ((6,), [0.25, 17, 15, b"\x80\x02", 0]),
        ((7,), []),
        ((7,), [1]),
        ((7,), [1, 2, 3]),
        ((7,), None),
    ],
)
def test_the_shape_of_a_message_is_exact(place, value):
    assert reason(spoilt(place, value)) == "wrong shape"


@pytest.mark.parametrize("fields", [[], [VERSION], fields_of()[:-1]])
def test_a_message_has_no_fewer_than_eight_fields(fields):
    assert reason(msgpack.packb(fields)) == "wrong shape"


def test_a_message_has_no_more_than_nine_fields():
    assert reason(msgpack.packb([*fields_of(), b"", 0])) == "wrong shape"
    assert reason(msgpack.packb([*fields_of(), b"", 0]), limits_of(BITS, emigrants=9)) == "wrong shape"


@pytest.mark.parametrize("value", [0, None, "text", [b"state"], 1.5])
def test_a_ninth_field_is_bytes(value):
    assert reason(msgpack.packb([*fields_of(), value])) == "wrong type"


def test_a_ninth_field_reaches_to_the_end():
    whole = msgpack.packb([*fields_of(), b"state"])
    assert decode(whole, LIMITS) == MESSAGE
    assert reason(whole[:-1]) == reason(whole + b"\0") == "not msgpack"


@pytest.mark.parametrize("value", [None, 3, "abc", b"abc", 1.5, True, {}])
def test_a_message_is_an_array(value):
    assert reason(msgpack.packb(value)) == "not an array"


@pytest.mark.parametrize(
    ("payload", "why"),
    [
        (b"", "not msgpack"),
        (b"\xc1", "not msgpack"),  # never used by msgpack
        (MESSAGE.encode()[:-1], "not msgpack"),
        (MESSAGE.encode() + b"\x00", "not msgpack"),
        (MESSAGE.encode() * 2, "not msgpack"),
        (msgpack.packb([{"a": 1}]), "wrong shape"),
        (msgpack.packb([msgpack.ExtType(5, b"abc")]), "wrong shape"),
        (msgpack.packb([msgpack.Timestamp(0, 1)]), "wrong shape"),
        (b"\x92\xa2\xff\xfe\x00", "wrong shape"),  # text that is not UTF-8
        (b"\x91" * 300 + b"\x00", "wrong shape"),
        (b"\x91" * 310, "wrong shape"),
        (b"\xdd\xff\xff\xff\xff", "wrong shape"),  # four billion elements
        (b"\xdc\xff\xff", "wrong shape"),
        (b"\xdd\x00\x00\x00", "not msgpack"),
        (b"\xc6\xff\xff\xff\xff", "not an array"),  # four gigabytes
        (b"\xdb\xff\xff\xff\xff", "not an array"),
        (b"\xdf\xff\xff\xff\xff", "not an array"),
        (b"\xc9\xff\xff\xff\xff\x00", "not an array"),
    ],
    ids=lambda value: value[:8].hex() if isinstance(value, bytes) else None,
)
def test_what_is_not_msgpack_or_beyond_its_limits_is_refused(payload, why):
    assert reason(payload) == why


def test_the_length_is_looked_at_before_anything_else():
    assert reason(bytes(LIMITS.most_bytes)) == "not an array"
    assert reason(bytes(LIMITS.most_bytes + 1)) == "too long"
    assert reason(MESSAGE.encode().ljust(LIMITS.most_bytes + 1, b"\0")) == "too long"


BILLIONS = b"\xff" * 4
START = msgpack.packb(fields_of())[: len(msgpack.packb(fields_of()[:5]))]
FIRST = msgpack.packb(fields_of()[5])
CHAMPION = msgpack.packb(fields_of()[6])


@pytest.mark.parametrize(
    ("payload", "why"),
    [
        (b"\xdd" + BILLIONS, "wrong shape"),
        (START + b"\xdd" + BILLIONS, "wrong shape"),
        (START + b"\x92\xdd" + BILLIONS, "wrong shape"),
        (START + b"\x92\x92\xc6" + BILLIONS, "not msgpack"),
        (START + FIRST + b"\xdd" + BILLIONS, "wrong shape"),
        (START + FIRST + CHAMPION[:-4] + b"\xc6" + BILLIONS, "not msgpack"),
        (START + FIRST + CHAMPION + b"\xdd" + BILLIONS, "wrong shape"),
    ],
)
def test_what_is_announced_is_not_made_room_for(payload, why):
    tracemalloc.start()
    try:
        assert reason(payload + bytes(100)) == why
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 1 << 16


# Fuzzing --------------------------------------------------------------------------------------------------------------
def some_value(rng, depth=0):
    """Any value that msgpack can hold, nested here and there."""
    flat = [
        lambda: rng.choice((0, 1, -1, 15, 16, 1 << 62, (1 << 64) - 1, -(1 << 63), rng.getrandbits(20))),
        lambda: rng.choice((0.0, -1.5, math.nan, math.inf, -math.inf, 5e-324)),
        lambda: rng.choice((True, False, None)),
        lambda: rng.choice(("", "abc", "\0", "é" * 5)),
        lambda: rng.randbytes(rng.choice((0, 1, 2, 2, 2, 3, 16))),
        lambda: msgpack.ExtType(rng.randrange(128), rng.randbytes(rng.randrange(5))),
    ]
    nested = [
        lambda: [some_value(rng, depth + 1) for _ in range(rng.choice((0, 1, 2, 2, 4, 8)))],
        lambda: {rng.choice("abc"): some_value(rng, depth + 1) for _ in range(rng.randrange(3))},
    ]
    return rng.choice(flat + nested if depth < 4 else flat)()


def cut(rng, message, _):
    return message[: rng.randrange(len(message))]


def flipped(rng, message, _):
    bits = bytearray(message)
    for _ in range(rng.choice((1, 1, 2, 8))):
        bits[rng.randrange(len(bits))] ^= 1 << rng.randrange(8)
    return bytes(bits)


def spliced(rng, message, other):
    return message[: rng.randrange(len(message))] + other[rng.randrange(len(other)) :]


def stuffed(rng, message, _):
    place = rng.randrange(len(message) + 1)
    return message[:place] + rng.randbytes(rng.choice((1, 2, 400))) + message[place:]


def refilled(rng, message, _):
    fields = msgpack.unpackb(message)
    inner = rng.choice([fields, fields, *(field for field in fields if isinstance(field, list) and field)])
    inner[rng.randrange(len(inner))] = some_value(rng)
    if rng.random() < 0.1:
        del inner[rng.randrange(len(inner))]
    return msgpack.packb(fields)


def made_up(rng, *_):
    return msgpack.packb(some_value(rng))


def noise(rng, *_):
    return rng.randbytes(rng.randrange(80))


SPOILERS = (cut, flipped, flipped, spliced, stuffed, refilled, refilled, made_up, noise)


def valid_messages(rng, count=50):
    def genome():
        return BITS.encode([[rng.randrange(32) for _ in range(3)]])[0].tobytes()

    for _ in range(count):
        champion = Champion(rng.random(), rng.randrange(300), rng.randrange(16), genome())
        yield Exchange(
            job=rng.randrange(3),
            epoch=0,
            generation=rng.choice((0, 5, 200, 70_000, 1 << 40)),
            stop_at=rng.choice((None, 100)),
            emigrants=(Emigrant(genome(), rng.random()), Emigrant(genome(), math.inf)),
            champion=rng.choice((None, champion)),
            sent=rng.randrange(1000),
            evaluations=rng.randrange(100_000),
        ).encode()


def test_a_hundred_thousand_bad_messages_are_refused_or_make_sense_and_leave_nothing_behind(random_source):
    rng = random_source
    valid = list(valid_messages(rng))
    seen = Counter()

    def play(rounds):
        for _ in range(rounds):
            payload = rng.choice(SPOILERS)(rng, rng.choice(valid), rng.choice(valid))
            expected = read_slowly(payload, LIMITS)
            try:
                message = decode(payload, LIMITS)
            except Rejected as error:
                seen[error.reason] += 1
                assert expected is None
            else:
                seen["accepted"] += 1
                assert message == expected
                again = message.encode()
                assert decode(again, LIMITS) == message
                assert len(again) <= LIMITS.most_bytes

    play(5_000)
    tracemalloc.start()
    try:
        play(5_000)
        before, _ = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        play(5_000)
        after, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    play(85_000)
    assert seen.total() == 100_000
    assert seen.keys() == {*REASONS.values(), "accepted"}, "every reason occurs, and no other"
    assert min(seen.values()) >= 10
    assert after - before < 10_000
    assert peak - before < 400_000, "more than the 256 kB that packing takes"
