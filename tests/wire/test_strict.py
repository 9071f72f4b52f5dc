"""What every message is read by."""

import math

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wire import strict
from wire.strict import MOST_BYTES, MOST_ELEMENTS, Rejected, count, fields, fitness, of, pack, unpack

plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(1 << 63), (1 << 64) - 1)
    | st.floats(allow_nan=False)
    | st.text()
    | st.binary(),
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=20,
)


def reason(function, *arguments):
    with pytest.raises(Rejected) as caught:
        function(*arguments)
    return caught.value.reason


@given(st.lists(plain))
def test_an_array_comes_back_as_it_was(value):
    assert unpack(pack(value)) == value


@given(st.binary(max_size=200))
def test_random_bytes_are_an_array_or_rejected(payload):
    try:
        outcome = type(unpack(payload)).__name__
    except Rejected as error:
        outcome = error.reason
    assert outcome in ("list", "not msgpack", "not an array")


def test_the_length_is_looked_at_first():
    assert reason(unpack, pack([1, 2, 3]), 3) == "too long"
    assert unpack(pack([1, 2, 3]), 4) == [1, 2, 3]
    assert reason(unpack, bytes(MOST_BYTES + 1)) == "too long"


def test_arrays_have_a_limit_of_their_own():
    assert unpack(pack([1] * MOST_ELEMENTS)) == [1] * MOST_ELEMENTS
    assert reason(unpack, pack([1] * (MOST_ELEMENTS + 1))) == "not msgpack"
    assert unpack(pack([1, [2, 3]]), most_elements=2) == [1, [2, 3]]
    assert reason(unpack, pack([1, [2, 3, 4]]), MOST_BYTES, 2) == "not msgpack"


def test_deep_arrays_break_nothing():
    assert unpack(b"\x91" * 3 + b"\x01") == [[[1]]]
    for depth in (5_000, 100_000, 1_000_000):
        assert reason(unpack, b"\x91" * depth + b"\x01") == "not msgpack"


def test_memory_that_cannot_be_had_is_a_rejection(monkeypatch):
    def no_room(*args, **kwargs):
        raise MemoryError

    monkeypatch.setattr(strict.msgpack, "unpackb", no_room)
    assert reason(unpack, b"\x90") == "not msgpack"


@pytest.mark.parametrize("value", [{}, {"a": 1}, msgpack.ExtType(1, b"x"), msgpack.Timestamp(5)])
def test_neither_maps_nor_extensions_travel(value):
    assert reason(unpack, pack(value)) in ("not msgpack", "not an array")
    if value != {}:
        assert reason(unpack, pack([value])) == "not msgpack"


def test_fields_are_exactly_as_many():
    assert fields([1, 2], 2) == [1, 2]
    for wrong in ([1], [1, 2, 3], (1, 2), "ab", None, {}):
        assert reason(fields, wrong, 2) == "wrong shape"


@pytest.mark.parametrize(
    ("kind", "right", "wrong"),
    [
        (int, 1, [True, 1.0, "1", None]),
        (str, "a", [b"a", 1, None, ["a"]]),
        (bytes, b"a", ["a", bytearray(b"a"), None]),
        (float, 1.0, [1, True]),
        (list, [], [(), "", None]),
    ],
)
def test_types_are_exact(kind, right, wrong):
    assert of(kind, right) == right
    assert {reason(of, kind, each) for each in wrong} == {"wrong type"}


def test_counts():
    assert [count(each) for each in (0, 1, (1 << 62) - 1)] == [0, 1, (1 << 62) - 1]
    assert count(4, 5) == 4
    assert {reason(count, each) for each in (-1, 1 << 62)} == {"out of bounds"}
    assert reason(count, 5, 5) == "out of bounds"
    assert {reason(count, each) for each in (True, False, 1.0, "1", None)} == {"wrong type"}


def test_fitness():
    assert [fitness(each) for each in (0.0, -1.5, math.inf, 5e-324)] == [0.0, -1.5, math.inf, 5e-324]
    assert {reason(fitness, each) for each in (math.nan, -math.inf)} == {"not finite"}
    assert {reason(fitness, each) for each in (1, True, "1.0", None)} == {"wrong type"}
