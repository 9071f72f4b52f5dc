"""A flood of requests of one kind shuts out no other."""

from coordinator.service.waiting_room import Queue, WaitingRoom

ALL, ONE, OTHER = Queue("all", 5, 1000), Queue("one", 3, 100), Queue("other", 3, 100)


def test_so_many_wait_and_no_more_until_one_leaves():
    room = WaitingRoom()
    assert [room.enter((ALL, ONE), 1) for _ in range(4)] == [None, None, None, ONE]
    assert room.enter((ALL, OTHER), 1) is None
    assert room.enter((OTHER,), 1) is None
    room.leave((ALL, ONE), 1)
    assert room.enter((ALL, ONE), 1) is None


def test_who_is_not_let_into_one_queue_waits_in_none():
    room = WaitingRoom()
    for _ in range(3):
        assert room.enter((ONE,), 1) is None
    assert [room.enter((ALL, ONE), 1) for _ in range(10)] == [ONE] * 10
    assert [room.enter((ALL,), 1) for _ in range(6)] == [None] * 5 + [ALL]


def test_so_many_bytes_wait_but_one_request_may_be_larger():
    room = WaitingRoom()
    assert room.enter((ONE,), 500) is None
    assert room.enter((ONE,), 1) is ONE
    room.leave((ONE,), 500)
    assert [room.enter((ONE,), 40) for _ in range(3)] == [None, None, ONE]
