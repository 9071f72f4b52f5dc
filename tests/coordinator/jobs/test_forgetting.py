"""When nodes and spy are told to forget a job: at once if it has failed, else once its end is stored."""

import contextlib
import queue
import tempfile
from functools import partial
from pathlib import Path

import pytest
from places import until
from stub_dispatcher import result

from coordinator.errors import ClusterFailed
from coordinator.jobs.forgetting import Forgetting
from coordinator.jobs.job import JobSpec
from problems import load
from wire import control, sessions
from wire.callbacks import direct
from wire.control import Drop
from wire.keys import Keys
from wire.seal import Seal

ROOT = Path(__file__).resolve().parents[3]
KEYS = Keys("c1")
SPEC = JobSpec(1, load(ROOT / "examples" / "rastrigin.toml"))
GOOD, BAD = result(SPEC, "solved"), result(SPEC, "failed")
SECRET = bytes(range(32))
PATIENCE = 30.0  # seconds


class Processes:
    """A node and a spy that note which jobs they are told to forget; ready once the other session can reach them."""

    def __init__(self, session, other):
        self._told = queue.SimpleQueue()
        seals = Seal(SECRET), Seal(SECRET)  # each process has one, which opens a command once
        self._kept = [
            session.declare_queryable(key, direct(partial(self._take, key, seal)))
            for key, seal in zip((KEYS.control(0), KEYS.spy_control), seals, strict=True)
        ]
        self._token = session.liveliness().declare_token(KEYS.node(0))
        until(lambda: list(other.liveliness().get(KEYS.node(0))))

    def _take(self, key, seal, query):
        with query:
            command = control.decode(seal.open(str(query.key_expr), query.payload.to_bytes()))
            assert isinstance(command, Drop)
            self._told.put((key, command.job))

    def next_two(self):
        return {self._told.get(timeout=PATIENCE) for _ in range(2)}


@pytest.fixture
def sessions_of_both():
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        endpoint = sessions.unix_socket(Path(folder), "r")
        with (
            contextlib.closing(sessions.router([endpoint])),
            contextlib.closing(sessions.client(endpoint)) as processes,
            contextlib.closing(sessions.client(endpoint)) as coordinator,
        ):
            yield processes, coordinator


def both(job):
    return {(KEYS.control(0), job), (KEYS.spy_control, job)}


def test_a_job_is_remembered_until_its_end_is_stored(sessions_of_both):
    processes, forgetting = Processes(*sessions_of_both), Forgetting(sessions_of_both[1], KEYS, Seal(SECRET))
    forget = forgetting.after(1, GOOD)
    forgetting.after(2, GOOD)
    assert forgetting.remembered == {1, 2}
    forget()
    assert processes.next_two() == both(1), "job 1 is the first that anybody is told of"
    assert forgetting.remembered == {2}


@pytest.mark.parametrize("outcome", [ClusterFailed("out of paper"), BAD])
def test_a_job_that_failed_is_forgotten_at_once(sessions_of_both, outcome):
    processes, forgetting = Processes(*sessions_of_both), Forgetting(sessions_of_both[1], KEYS, Seal(SECRET))
    forget = forgetting.after(3, outcome)
    assert processes.next_two() == both(3)
    forget()
    assert forgetting.remembered == set()


def test_without_a_session_nobody_is_told(sessions_of_both):
    forgetting = Forgetting(sessions_of_both[1], KEYS, Seal(SECRET))
    forget = forgetting.after(4, GOOD)
    sessions_of_both[1].close()
    forget()
    assert forgetting.remembered == set()
