"""What the roster says of a node: whether it still reports, beside how old its process is."""

import contextlib
import math
import tempfile
import time
from pathlib import Path

import pytest

from coordinator.service.roster import Roster
from wire import sessions
from wire.keys import Keys
from wire.news import Counters

KEYS = Keys("c1")
PATIENCE = 30.0  # seconds


@pytest.fixture
def session():
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        endpoint = sessions.unix_socket(Path(folder), "r")
        with (
            contextlib.closing(sessions.router([endpoint])),
            contextlib.closing(sessions.client(endpoint)) as session,
        ):
            yield session


def counters(node, generation):
    return Counters(node, 5, 1, 2, generation, 0, 40, 160, 0, 0, math.inf, math.inf, math.inf, math.inf, 0, 0, 0.1)


def until(roster, condition, job="a"):
    """Return the nodes 0 and 1 once the condition holds for them."""
    end = time.monotonic() + PATIENCE
    while not condition(shown := roster.nodes([0, 1], lambda _: job)):
        assert time.monotonic() < end, shown
        time.sleep(0.01)
    return shown


def test_it_says_when_the_latest_counters_of_a_node_came(session):
    roster = Roster(session, KEYS, lambda _: None)
    life = session.liveliness().declare_token(KEYS.life(0, 4711))
    waiting, absent = until(roster, lambda shown: shown[0]["process"] == 4711)
    assert (waiting["reported"], waiting["generation"]) == (None, None)
    assert (absent["seconds"], absent["reported"]) == (None, None)

    session.put(KEYS.spy_counters, *Counters.encode_all([counters(0, 7)]))
    first, _ = until(roster, lambda shown: shown[0]["generation"] == 7)
    assert (first["cell"], first["epoch"], first["sent"], first["received"]) == (5, 2, 40, 160)
    assert 0.0 <= first["reported"] <= first["seconds"]
    later, _ = until(roster, lambda shown: shown[0]["reported"] > first["reported"])  # grows without a report
    assert later["generation"] == 7

    idle, _ = roster.nodes([0, 1], lambda _: None)
    assert (idle["job"], idle["generation"], idle["reported"], idle["sent"]) == (None, None, None, 40)
    life.undeclare()


def test_a_token_of_no_process_is_ignored(session):
    complaints = []
    roster = Roster(session, KEYS, lambda *those: complaints.append(those))
    liveliness = session.liveliness()
    strange = [liveliness.declare_token(key) for key in (f"{KEYS.node(0)}/life/x", f"{KEYS.spy}/life/x")]
    roster.look()  # sees the tokens in this thread, where an error would end the test
    life = liveliness.declare_token(KEYS.life(1, 4711))
    absent, _ = until(roster, lambda shown: shown[1]["process"] == 4711)
    assert (absent["process"], roster.spy, complaints) == (None, None, [])
    for token in (*strange, life):
        token.undeclare()


def test_a_look_for_some_nodes_tells_of_no_other_and_of_none_that_is_known(session):
    """Else each look would disturb the jobs of all nodes."""
    arrived, told = [], []
    roster = Roster(session, KEYS, lambda *those: told.append(those), arrived=arrived.append, returned=told.append)
    for subscriber in roster._declared:  # so that it knows only what it looks for
        subscriber.undeclare()
    lives = [session.liveliness().declare_token(KEYS.life(node, 4711 + node)) for node in (0, 1)]
    end = time.monotonic() + PATIENCE
    while not arrived:  # Zenoh may not tell of a token at once
        roster.look_for({1, 2})
        assert time.monotonic() < end
    roster.look_for({1, 2})
    assert (arrived, told) == ([1], [])
    for life in lives:
        life.undeclare()
