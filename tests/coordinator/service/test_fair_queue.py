"""No client holds up another."""

import threading

from hypothesis import given
from hypothesis import strategies as st

from coordinator.service.fair_queue import FairQueue


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


def test_a_rate_holds_for_those_that_are_limited(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("coordinator.rate_limit.time.monotonic", lambda: now[0])
    queue = FairQueue(100, 2.0, lambda client: client != "trusted")
    for number in range(6):
        queue.put("flood", number)
        queue.put("trusted", "t")
    assert drain(queue, 8).count("t") == 6, "after two of the flood, only the trusted one's are taken"
    now[0] = 0.5
    assert queue.take() == 2
    now[0] = 10.0
    assert drain(queue, 2) == [3, 4], "it never saves more than a second's"


def test_a_waiting_thread_gets_what_comes_and_learns_of_the_end():
    queue, taken = FairQueue(10), []
    thread = threading.Thread(target=lambda: taken.extend((queue.take(), queue.take())))
    thread.start()
    queue.put("a", 1)
    queue.close()
    thread.join()
    assert taken in ([1, None], [None, None])
    assert queue.take() is None
