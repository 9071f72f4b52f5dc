"""What waits for what: only work of the same lane."""

import queue
import threading

from coordinator.service.lanes import Lanes

PATIENCE = 10.0  # seconds


def test_work_of_one_lane_is_done_in_its_order():
    lanes, done = Lanes(), queue.SimpleQueue()
    for number in range(1000):
        lanes.put("a", lambda number=number: done.put(number))
    assert [done.get(timeout=PATIENCE) for _ in range(1000)] == list(range(1000))


def test_many_lanes_that_wait_hold_no_other():
    lanes, done, go = Lanes(), queue.SimpleQueue(), threading.Event()
    for lane in range(50):
        lanes.put(f"slow {lane}", go.wait)
        lanes.put(f"slow {lane}", lambda lane=lane: done.put(lane))
    lanes.put("quick", lambda: done.put("quick"))
    assert done.get(timeout=PATIENCE) == "quick"
    assert done.empty()
    go.set()
    assert {done.get(timeout=PATIENCE) for _ in range(50)} == set(range(50))


def test_a_lane_without_work_leaves_no_thread():
    lanes, done, again = Lanes(), threading.Event(), threading.Event()
    lanes.put("once", done.set)
    assert done.wait(PATIENCE)
    for thread in [each for each in threading.enumerate() if each.name == "lane once"]:
        thread.join(PATIENCE)
        assert not thread.is_alive()
    lanes.put("once", again.set)
    assert again.wait(PATIENCE)
