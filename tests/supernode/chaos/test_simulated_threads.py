"""Simulated threads keep the promises of real ones, whatever order is drawn; time passes only while all wait."""

import queue
import threading
from itertools import count

import pytest

from supernode.chaos.simulated.thread_types import ThreadTypes
from supernode.chaos.simulated.world import Process, World

SEEDS = range(20)


class Trial:
    """A world with one process."""

    def __init__(self, seed):
        self.errors = []
        self.exited = []
        self.world = World(seed, lambda process, name, error: self.errors.append(error), self.exited.append)
        self.types = ThreadTypes(self.world)
        self.process = Process(self.world, "process")

    def run(self, *lives, until=1000.0):
        tasks = [self.process.start(live, f"task {number}") for number, live in zip(count(), lives, strict=False)]
        self.world.run(lambda: all(task.is_done for task in tasks), until)
        if self.errors:
            raise self.errors[0]
        return [task.is_done for task in tasks]


@pytest.fixture(params=SEEDS)
def trial(request):
    return Trial(request.param)


@pytest.mark.parametrize("kind", ["Lock", "RLock"])
def test_a_lock_is_held_by_one(trial, kind):
    lock, inside, order = getattr(trial.types.threading, kind)(), [], []

    def live():
        for _ in range(30):
            with lock:
                assert not inside
                inside.append(1)
                trial.world.spend(1e-4)
                inside.pop()
            order.append(1)

    assert trial.run(live, live, live) == [True] * 3
    assert len(order) == 90


def test_a_lock_can_be_tried_and_waited_for_for_a_while(trial):
    lock, held = trial.types.threading.Lock(), trial.types.threading.Event()

    def hold():
        with lock:
            held.set()
            trial.types.time.sleep(2.0)

    def try_it():
        held.wait()
        assert not lock.acquire(False)
        began = trial.types.time.monotonic()
        assert not lock.acquire(timeout=1.0)
        assert 0.999 <= trial.types.time.monotonic() - began < 1.2
        assert lock.acquire(timeout=5.0)

    assert trial.run(hold, try_it) == [True, True]


def test_a_queue_gives_everything_once_and_in_order(trial):
    line, got = trial.types.queue.SimpleQueue(), []

    def give():
        for number in range(50):
            line.put(number)
            trial.world.spend(1e-5)

    def take():
        while len(got) < 50:
            try:
                got.append(line.get(timeout=0.01))
            except queue.Empty:
                continue

    assert trial.run(give, take, take) == [True] * 3
    assert got == sorted(got)
    assert sorted(got) == list(range(50))


def test_a_condition_wakes_those_who_wait(trial):
    changed, ready, woken = trial.types.threading.Condition(), [], []

    def wait():
        with changed:
            assert changed.wait_for(lambda: ready, 5.0)
        woken.append(1)

    def notify():
        trial.types.time.sleep(1.0)
        with changed:
            ready.append(1)
            changed.notify_all()

    def wait_in_vain():
        with changed:
            assert not changed.wait_for(lambda: False, 0.5)

    assert trial.run(wait, wait, wait_in_vain, notify) == [True] * 4
    assert len(woken) == 2


def test_threads_can_be_joined_and_sleep_as_long_as_they_ask(trial):
    def live():
        began = trial.types.time.monotonic()
        thread = trial.types.threading.Thread(target=trial.types.time.sleep, args=(3.0,))
        thread.start()
        thread.join(1.0)
        assert thread.is_alive()
        thread.join()
        assert 2.999 <= trial.types.time.monotonic() - began < 3.1
        assert not thread.is_alive()

    assert trial.run(live) == [True]


def test_a_killed_process_does_nothing_more_and_runs_no_other_one_down(trial):
    other, done, lock = Process(trial.world, "other"), [], trial.types.threading.Lock()

    def live():
        try:
            with lock:
                trial.types.time.sleep(10.0)
                done.append("slept")
        finally:
            trial.types.time.sleep(1.0)  # a wait after the end ends at once
            done.append("went on")

    other.start(live, "main")
    trial.world.at(1.0, other.kill)
    trial.run(lambda: trial.types.time.sleep(20.0))
    assert done == []
    assert not other.alive


def test_a_stopped_process_goes_on_later(trial):
    other, woke = Process(trial.world, "other"), []

    def live():
        trial.types.time.sleep(1.0)
        woke.append(trial.world.now)

    other.start(live, "main")
    trial.world.at(0.5, lambda: other.stop(4.0))
    trial.run(lambda: trial.types.time.sleep(20.0))
    assert 4.5 <= woke[0] < 4.7


def test_an_error_of_a_task_is_told(trial):
    def fail():
        raise KeyError("x")

    with pytest.raises(KeyError):
        trial.run(fail, lambda: trial.types.time.sleep(1.0))


def test_a_signal_is_handled_and_an_exit_is_told(trial):
    handled = []

    def live():
        trial.process.handlers[12] = lambda *_: handled.append(trial.world.now)
        trial.types.time.sleep(2.0)
        trial.process.exit(7)

    trial.world.at(1.0, lambda: trial.process.signal(12))
    trial.process.start(live, "main")
    trial.world.run(lambda: bool(trial.exited), 10.0)
    assert trial.exited == [trial.process]
    assert (trial.process.status, len(handled)) == (7, 1)


def test_real_threads_stay_as_they_are():
    trial = Trial(1)
    assert trial.types.threading.Lock is not threading.Lock
    assert threading.Thread.__module__ == "threading"
