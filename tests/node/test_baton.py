"""One baton and those who wait for it: processes that have inherited it, as nodes do."""

import copy
import mmap
import os

from node.baton import Baton

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
    baton, shared = Baton(), mmap.mmap(-1, 4)  # who has it; and how many turns each of three has had

    def live(number):
        while max(shared[1:]) < TURNS:
            assert baton.take(PATIENCE)
            assert shared[0] == 0
            shared[0] = number
            shared[number] += 1
            assert shared[0] == number
            shared[0] = 0
            baton.hand_on()

    assert baton.take(PATIENCE)
    processes = [fork(lambda number=number: live(number)) for number in (1, 2, 3)]
    baton.hand_on()
    assert [os.waitstatus_to_exitcode(os.waitpid(each, 0)[1]) for each in processes] == [0, 0, 0]
    turns = shared[1:]
    assert max(turns) == TURNS
    assert min(turns) >= TURNS / 2  # nobody is passed over for long, whoever was forked first


def test_who_is_killed_with_it_keeps_the_others_waiting_no_longer_than_their_patience():
    baton = Baton()
    os.waitpid(fork(lambda: baton.take(PATIENCE)), 0)
    assert not baton.take(AT_ONCE)
    baton.hand_on()
    assert baton.take(PATIENCE)


def test_one_that_was_only_late_is_dropped():
    late = Baton()
    patient = copy.copy(late)  # of another node: the same sockets, and what it has seen
    third = copy.copy(late)
    assert late.take(PATIENCE)
    assert not patient.take(AT_ONCE)
    late.hand_on()
    patient.hand_on()
    assert patient.take(PATIENCE)  # the newer one
    assert not third.take(AT_ONCE)  # there is no other
