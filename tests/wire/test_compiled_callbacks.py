"""Objects from compiled code: what it returns, keeps, gives back and raises."""

import sys
from types import SimpleNamespace

import numba
import pytest

from lowlevel.c_api import (
    CALLBACK,
    PAYLOAD_NAME,
    BuiltIn,
    addresses,
    append,
    call,
    call_without,
    content,
    decref,
    forget_exception,
    integer,
    item_of_list,
    length,
    message_of,
    new_ref,
    pair,
    payload_of,
    remove_first,
    tuple_item,
)


@numba.cfunc(CALLBACK)  # not kept on disk, as a `c_function` is
def _second(own, argument):
    """Its own second object, and the argument, in a tuple."""
    return pair(tuple_item(own, 1), argument)


@numba.cfunc(CALLBACK)
def _reversed(own, sample):
    """The payload of a sample, backwards."""
    payload = payload_of(sample, tuple_item(own, 0))
    if payload == 0:
        return payload
    backwards = content(payload)[::-1].copy()
    decref(payload)
    return message_of(backwards)


@numba.cfunc(CALLBACK)
def _calls(own, argument):
    """What the first returns for the argument; if that fails, what the second returns."""
    result = call(tuple_item(own, 0), argument)
    if result == 0:
        forget_exception()
        return call_without(tuple_item(own, 1))
    return result


@numba.cfunc(CALLBACK)
def _shorten(own, numbers):
    """Take as many items from a list as its first says, and put its length there."""
    remove_first(numbers, integer(item_of_list(numbers, 0)))
    append(tuple_item(own, 0), numbers)
    return new_ref(numbers) if length(numbers) > 0 else new_ref(tuple_item(own, 0))


SECOND, REVERSED, CALLS, SHORTEN = (
    BuiltIn(name, code)
    for name, code in (("second", _second), ("reversed", _reversed), ("calls", _calls), ("shorten", _shorten))
)


def test_each_function_has_its_own_object():
    functions = [SECOND.of((b"any", f"number {number}")) for number in range(5)]
    assert [function("x") for function in functions] == [(f"number {number}", "x") for number in range(5)]
    assert "second" in repr(functions[0])
    with pytest.raises(TypeError, match="one argument"):
        functions[0]()


def test_a_function_keeps_its_own_object_and_nothing_else():
    one, argument = object(), object()
    before = sys.getrefcount(one), sys.getrefcount(argument)
    function = SECOND.of((None, one))
    for _ in range(100):
        function(argument)
    kept = function(argument)
    assert (sys.getrefcount(one), sys.getrefcount(argument)) == (before[0] + 2, before[1] + 1)
    del kept, function
    assert (sys.getrefcount(one), sys.getrefcount(argument)) == before


def test_a_payload_is_what_its_bytes_are():
    function = REVERSED.of((PAYLOAD_NAME,))
    for payload in (b"", b"a", bytes(range(256)) * 40):
        sample = SimpleNamespace(payload=payload)
        before = sys.getrefcount(payload)
        assert function(sample) == payload[::-1]
        assert sys.getrefcount(payload) == before
    assert function(SimpleNamespace(payload=bytearray(b"ab"))) == b"ba"


def test_an_exception_goes_to_the_caller():
    function = REVERSED.of((PAYLOAD_NAME,))
    with pytest.raises(AttributeError, match="payload"):
        function(object())
    with pytest.raises(TypeError):
        function(SimpleNamespace(payload=None))


def test_an_exception_may_be_forgotten():
    function = CALLS.of((len, lambda: "no length"))
    assert [function(each) for each in ([1, 2], 7, "abc")] == [2, "no length", 3]
    with pytest.raises(ZeroDivisionError):
        CALLS.of((len, lambda: 1 // 0))(7)


def test_lists():
    seen, numbers = [], [2, 3, 4, 5]
    function = SHORTEN.of((seen,))
    assert function(numbers) is numbers
    assert numbers == [4, 5]
    assert function(numbers) is seen
    assert numbers == []
    assert seen == [[], []]
    assert all(each is numbers for each in seen)


def test_addresses_are_those_of_the_objects():
    one = object()
    assert addresses(one, None).tolist() == [id(one), id(None)]
