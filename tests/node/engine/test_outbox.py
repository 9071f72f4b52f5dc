"""The last two messages, and none that is older."""

import numpy as np

from node.engine.outbox import Outbox


def put(outbox, number, generation, payload):
    """As compiled code does; returns what is read of it."""
    outbox.room[number % 2, : len(payload)] = np.frombuffer(payload, np.uint8)
    outbox.said[number % 2] = generation, len(payload)
    return outbox.message(number)


def test_there_is_nothing_before_the_first_message():
    assert {Outbox(100).of(generation) for generation in range(-2, 3)} == {None}


def test_the_last_two_are_kept_whatever_their_lengths():
    outbox, payloads = Outbox(100), [bytes([number]) * (100 - 7 * number) for number in range(10)]
    for number, payload in enumerate(payloads, 1):
        generation = 5 * number
        assert put(outbox, number, generation, payload) == payload == outbox.of(generation)
        kept = {sent: outbox.of(5 * sent) for sent in range(1, 11) if outbox.of(5 * sent) is not None}
        assert kept == {each: payloads[each - 1] for each in (number - 1, number) if each >= 1}
        assert outbox.of(generation - 1) is None


def test_a_number_that_comes_again_takes_its_place():
    outbox = Outbox(10)
    put(outbox, 1, 3, b"first")
    put(outbox, 2, 4, b"taken back")
    put(outbox, 2, 5, b"second")
    assert (outbox.of(3), outbox.of(4), outbox.of(5)) == (b"first", None, b"second")
