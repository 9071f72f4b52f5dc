"""No client holds up another."""

import threading
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coordinator.service.fair_queue import FairQueue, Shares


def drain(queue, count):
    return [queue.take() for _ in range(count)]


def test_clients_are_taken_in_turns():
    queue = FairQueue(100)
    for number in range(5):
        queue.put("flood", number)
    queue.put("other", "a")
    queue.put("other", "b")
    assert drain(queue, 7) == [0, "a", 1, "b", 2, 3, 4]


def test_a_client_that_comes_later_waits_for_one_item_of_each_other():
    queue = FairQueue(100)
    for number in range(50):
        queue.put("flood", number)
    assert drain(queue, 10) == list(range(10))
    queue.put("late", "x")
    assert "x" in drain(queue, 2)


def test_a_client_may_have_so_many_waiting_and_no_more():
    queue = FairQueue(2)
    assert [queue.put("flood", number) for number in range(4)] == [True, True, False, False]
    assert queue.put("other", "x")
    queue.take()
    assert queue.put("flood", 4)


@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers())))
def test_nothing_is_lost_doubled_or_reordered_for_a_client(items):
    queue = FairQueue(1000)
    for item in items:
        queue.put(item[0], item)
    taken = drain(queue, len(items))
    for client in "abc":
        assert [item for item in taken if item[0] == client] == [item for item in items if item[0] == client]


@pytest.fixture
def now(monkeypatch):
    """The time on the clock, and the processor time of the thread."""
    clock = [100.0, 0.0]
    fake = SimpleNamespace(monotonic=lambda: clock[0], thread_time=lambda: clock[1])
    monkeypatch.setattr("coordinator.service.fair_queue.time", fake)
    return clock


def limited():
    return FairQueue(100, shares=Shares(alone=0.5, beside=0.1), is_limited=lambda client: client != "trusted")


def test_who_has_used_up_its_share_waits_and_others_do_not(now):
    queue = limited()
    for number in range(3):
        queue.put("flood", number)
        queue.put("trusted", "t")
    queue.charge("flood", 0.3)
    queue.charge("trusted", 1000.0)
    assert drain(queue, 3) == ["t", "t", "t"]
    queue.put("other", "x")
    assert queue.take() == "x"
    now[0] += 1.01  # 0.3 s at a share of a tenth, of which 2 s were saved
    assert queue.take() == 0


def test_a_share_is_larger_while_nobody_else_asks(now):
    queue = limited()
    queue.put("other", "x")
    assert queue.take() == "x"
    now[0] += 5.0
    queue.put("busy", 1)
    queue.charge("busy", 1.0)  # 2 s at a share of a half, which were saved
    assert queue.take() == 1
    queue.put("other", "x")
    queue.put("busy", 2)
    queue.charge("busy", 0.1)
    assert queue.take() == "x"
    now[0] += 1.01
    assert queue.take() == 2


def test_nobody_waits_longer_than_ten_seconds(now):
    queue = limited()
    queue.charge("one", 1000.0)
    queue.put("one", 1)
    now[0] += 10.01
    assert queue.take() == 1


def test_so_many_bytes_of_a_client_may_wait_but_one_item_of_any_size():
    queue = FairQueue(10, 100)
    assert queue.put("one", 1, 1000)
    assert not queue.put("one", 2, 1)
    assert queue.put("other", 3, 60)
    assert not queue.put("other", 4, 41)
    assert drain(queue, 2) == [1, 3]
    assert queue.put("one", 5, 60)
    assert queue.put("one", 6, 40)


def test_what_a_thread_does_is_charged(now):
    queue = limited()
    with queue.charged("one"):
        now[1] += 1.1
    queue.put("one", 1)
    queue.put("other", 2)
    assert queue.take() == 2, "1.1 s at a share of a half are more than was saved"


def test_so_many_of_a_client_are_under_way_and_no_more():
    queue = FairQueue(10, most_at_once=2, is_limited=lambda client: client != "trusted")
    for number in range(4):
        queue.put("flood", number)
        queue.put("trusted", "x")
    assert drain(queue, 6) == [0, "x", 1, "x", "x", "x"]
    queue.put("other", "y")
    assert queue.take() == "y"
    taken = []
    thread = threading.Thread(target=lambda: taken.append(queue.take()))
    thread.start()
    with queue.charged("flood"):
        assert not taken
    thread.join(10)
    assert taken == [2]


def test_a_waiting_thread_gets_what_comes_and_learns_of_the_end():
    queue, taken = FairQueue(10), []
    thread = threading.Thread(target=lambda: taken.extend((queue.take(), queue.take())))
    thread.start()
    queue.put("a", 1)
    queue.close()
    thread.join()
    assert taken in ([1, None], [None, None])
    assert queue.take() is None
