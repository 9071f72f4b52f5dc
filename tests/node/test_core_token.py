"""One token and those who wait for it: processes that have inherited it, as nodes do."""

import copy
import mmap
import os
import time

from node.core_token import CoreToken, for_all_cores

PATIENCE = 60.0  # seconds; nobody waits for as long
AT_ONCE = 0.01
TURNS = 30


def fork(live):
    process = os.fork()
    if process == 0:
        status = 1
        try:
            live()
            status = 0
        finally:
            os._exit(status)
    return process


def test_one_has_it_at_a_time_and_each_in_turn():
    core_token, shared = CoreToken(PATIENCE), mmap.mmap(-1, 4)  # who has it; and how many turns each of three has had
    told, tell = os.pipe()

    def live(number):
        os.write(tell, b"!")
        while max(shared[1:]) < TURNS:
            assert core_token.take()
            assert shared[0] == 0
            shared[0] = number
            shared[number] += 1
            time.sleep(2e-3)  # whoever might come in between has the time to do so
            assert shared[0] == number
            shared[0] = 0
            core_token.hand_on()

    assert core_token.take()
    processes = [fork(lambda number=number: live(number)) for number in (1, 2, 3)]
    for _ in processes:
        assert os.read(told, 1) == b"!"
    core_token.hand_on()
    assert [os.waitstatus_to_exitcode(os.waitpid(each, 0)[1]) for each in processes] == [0, 0, 0]
    turns = shared[1:]
    assert max(turns) == TURNS
    assert min(turns) >= TURNS / 3  # nobody is passed over for long, whoever was there first
    os.close(told)
    os.close(tell)


def test_only_a_crowd_has_some(monkeypatch):
    monkeypatch.setattr("node.cpu_affinity.CORES", [2, 3])
    monkeypatch.setattr("node.core_token.CORES", [2, 3])
    assert for_all_cores(15) == {}
    assert for_all_cores(16).keys() == {2, 3}


def test_who_is_killed_with_it_keeps_the_others_waiting_no_longer_than_their_patience():
    core_token = CoreToken(AT_ONCE)
    os.waitpid(fork(core_token.take), 0)
    assert not core_token.take()
    core_token.hand_on()
    assert core_token.take()


def test_one_that_was_only_late_is_dropped():
    late = CoreToken(AT_ONCE)
    patient = copy.copy(late)  # of another node: the same sockets, and what it has seen
    third = copy.copy(late)
    assert late.take()
    assert not patient.take()
    late.hand_on()
    patient.hand_on()
    assert patient.take()  # the newer one
    assert not third.take()  # there is no other
