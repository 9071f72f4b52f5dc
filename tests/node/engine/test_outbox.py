"""The latest messages by generation, and none that is older than there is room for."""

import numpy as np
import pytest

from lowlevel.compiled import kernel
from node.engine import ring
from node.engine.outbox import Outbox
from wire.limits import most_bytes


@kernel("void(uint8[::1], int64[:, ::1], int64[::1], uint8[::1], int64, int64)")
def write(room, entries, marks, message, most, generation):
    start = ring.begin(room, entries, marks, most)
    room[start : start + message.size] = message
    ring.end(entries, marks, start, message.size, generation)


def put(outbox, generation, message, most=100):
    """As compiled generations do."""
    write(outbox.room, outbox.entries, outbox.marks, np.frombuffer(bytearray(message), np.uint8), most, generation)


def test_before_the_first_message_there_is_none():
    outbox = Outbox(100, 100)
    assert (outbox.since(0), outbox.oldest, outbox.most_messages) == ([], None, 100)


def test_all_messages_since_one_that_is_kept():
    outbox = Outbox(100, 100)
    for number in range(10):
        put(outbox, 5 * number, bytes([number]))
    assert outbox.since(30) == [b"\6", b"\7", b"\x08", b"\x09"]
    assert outbox.since(31) == outbox.since(50) == []
    assert outbox.oldest == 0


def test_a_message_that_is_published_again_counts_once():
    outbox = Outbox(100, 100)
    for generation in (3, 4, 4, 5):
        put(outbox, generation, bytes([generation]))
    assert outbox.since(3) == [b"\3", b"\4", b"\5"]


@pytest.mark.parametrize("size", [10, 100, 1000])
def test_it_keeps_as_many_as_it_says(size):
    outbox = Outbox(size, size)
    for generation in range(1000):
        put(outbox, generation, bytes(size), size)
    kept = len(outbox.since(outbox.oldest))
    assert outbox.most_messages <= kept <= min(100, len(outbox.room) // size)


@pytest.mark.parametrize("emigrants", [1, 4])
@pytest.mark.parametrize("genome", [1, 8, 16, 80, 100, 242, 399, 2000])
def test_it_reaches_back_to_the_third_last_state(genome, emigrants):
    most = most_bytes(genome, emigrants)
    for size in (most, most - 100, most - 200, 20 + (emigrants + 1) * genome, 20 + emigrants * genome):
        outbox = Outbox(most, most)
        for generation in range(400):
            put(outbox, generation, bytes(size), most)
            if generation > 100:
                distance = outbox.messages_between_states(seconds=1e-6)
                kept = len(outbox.since(outbox.oldest))
                assert distance in (4, 8, 16, 32)
                assert kept >= max(outbox.most_messages, 3 * distance + 2)
