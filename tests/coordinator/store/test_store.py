"""What must outlive the coordinator does so: in SQLite, and in PostgreSQL."""

import json
import os
import random
import signal
import sqlite3
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path

import postgres
import pytest

from coordinator.jobs.job import Placement
from coordinator.jobs.states import WrongTransition
from coordinator.store import database
from coordinator.store.database import StoreFailed, sqlite_url
from coordinator.store.job_store import Store
from coordinator.store.stored_job import IdTaken, Submission, UnknownJob
from problems import ProblemFile
from problems.run import Run
from spy.past import Lived, Past

FILE = Submission('["a.toml", {"kind": "arm-ik"}, {}, "/"]', "d1", "arm-ik", "torus 4x4", 16)
OTHER = Submission('["b.toml", {"kind": "terrain"}, {}, "/"]', "d2", "terrain", "torus 2x2", 4, 5)
BEST = {"fitness": 0.5, "solution": {"angles": [0.1, 0.2], "text": "\u0000é"}}


@pytest.fixture(scope="session")
def postgres_server():
    with postgres.server() as running:
        yield running


@pytest.fixture(params=["sqlite", "postgres"])
def url(request, tmp_path):
    if request.param == "sqlite":
        return sqlite_url(tmp_path / "jobs.sqlite")
    return request.getfixturevalue("postgres_server").url()


@pytest.fixture
def store(url):
    store = Store(url)
    yield store
    store.close()


@pytest.fixture
def reopened(url):
    """Closes a store, and opens it anew as the next coordinator does."""
    opened = []

    def reopen(store):
        store.close()
        opened.append(Store(url))
        return opened[-1]

    yield reopen
    for each in opened:
        each.close()


def added(store, new=FILE, job=None):
    return store.add(new, job)[0]


def live(store, number, *states):
    for state in states:
        store.change(number, state)


# Submitting -----------------------------------------------------------------------------------------------------------
def test_a_job_is_kept_as_it_was_submitted(store, reopened):
    before = time.time()
    summary, new = store.add(OTHER, "my-job")
    assert new
    assert (summary.job, summary.number, summary.status, summary.priority) == ("my-job", 1, "queued", 5)
    assert before <= summary.submitted <= time.time()
    shown = reopened(store).show("my-job")
    assert shown.file == shown.file_now == OTHER.file
    assert (shown.kind, shown.cells, shown.topology) == ("terrain", 4, "torus 2x2")
    assert shown.submitted == summary.submitted
    assert (shown.best, shown.result, shown.nodes, shown.epoch) == (None, None, (), 0)
    assert (shown.fitness, shown.started, shown.ended, shown.message) == (None, None, None, None)


def test_jobs_without_an_id_get_one_each(store):
    ids = {added(store).job for _ in range(20)}
    assert len(ids) == 20
    assert [job.number for job in store.newest()] == list(range(1, 21))
    assert store.next_number == 21


def test_the_same_job_again_is_the_same_job(store, reopened):
    first = added(store, job="a")
    live(store, first.number, "preparing")
    again, new = reopened(store).add(FILE, "a")
    assert (again.number, again.status, new) == (first.number, "preparing", False)


def test_another_file_under_the_same_id_is_refused(store):
    added(store, job="a")
    with pytest.raises(IdTaken, match=r"^another problem file was submitted as job 'a' before$"):
        store.add(OTHER, "a")
    assert len(store.newest()) == 1


def test_a_withdrawn_job_is_gone_and_its_number_not_given_again(store):
    first = added(store, job="a")
    store.withdraw(first.number)
    assert store.newest() == []
    assert store.transitions(first.number) == []
    second, new = store.add(OTHER, "a")
    assert new
    assert second.number == 2


def test_numbers_go_on_where_the_last_coordinator_stopped(store, reopened):
    for _ in range(3):
        added(store)
    assert added(reopened(store)).number == 4


# What happens to a job ------------------------------------------------------------------------------------------------
def test_a_life_is_written_down(store, reopened):
    job = added(store, job="a")
    store.change(1, "preparing", nodes=(3, 1, 2))
    started = store.change(1, "running", at=job.submitted + 1.0)
    assert started.started == job.submitted + 1.0
    store.note_best(1, 0.5, BEST)
    assert store.newest()[0].fitness == 0.5
    ended = store.end(1, "solved", {"fitness": 0.25, "solution": {}}, message="well done")
    assert (ended.status, ended.fitness, ended.message) == ("solved", 0.25, "well done")
    store = reopened(store)
    shown = store.show("a")
    assert (shown.status, shown.nodes, shown.best) == ("solved", (3, 1, 2), BEST)
    assert shown.result == {"fitness": 0.25, "solution": {}}
    assert shown.ended >= shown.submitted
    states = [state for state, _ in store.transitions(1)]
    assert states == ["submitted", "queued", "preparing", "running", "solved"]


def test_a_state_that_cannot_follow_changes_nothing(store):
    added(store, job="a")
    with pytest.raises(WrongTransition):
        store.change(1, "solved", nodes=(1,), message="no")
    with pytest.raises(WrongTransition):
        store.end(1, "running", {"fitness": 1.0})
    shown = store.show("a")
    assert (shown.status, shown.nodes, shown.message, shown.result) == ("queued", (), None, None)
    assert len(store.transitions(1)) == 2


def test_a_job_ends_once(store):
    added(store, job="a")
    store.end(1, "cancelled", {"fitness": None})
    with pytest.raises(WrongTransition, match="nothing more"):
        store.end(1, "failed", {"fitness": 7.0})
    assert store.show("a").result == {"fitness": None}


def large(digest, size=10_000):
    return Submission("x" * size, digest, "terrain", "torus 2x2", 4)


def test_of_large_jobs_those_that_ended_first_are_forgotten(store, reopened):
    for job in "abcdef":
        added(store, large(job), job)
    for number, job in enumerate("badc"):  # b ends first; e runs, f waits
        store.end("abcd".index(job) + 1, "cancelled", {"solution": "y" * 1000 * number})
    live(store, 5, "preparing", "running")
    assert 44_000 < store.bytes_ended < 56_000
    store.forget_beyond(60_000)
    assert {job.job for job in store.newest()} == set("abcdef"), "there is room for all"
    store = reopened(store)
    store.forget_beyond(28_000)
    assert {job.job for job in store.newest()} == set("cdef")
    store.forget_beyond(10)
    assert {job.job for job in store.newest()} == set("cef"), "the latest stays, however large it is"
    assert store.transitions(2) == []
    with pytest.raises(UnknownJob):
        store.show("b")


def test_the_epochs_of_a_job_that_has_ended_have_a_size_too(store):
    added(store, FILE, "a")
    live(store, 1, "preparing", "running")
    file = ProblemFile("a.toml", {"kind": "arm-ik"}, Run(topology="ring 4"), Path("/"))
    for epoch in (1, 2, 3):
        update = {"do": "update", "fields": {"goal": "x" * 10_000}}
        store.note_placing(1, Placement(epoch, file, (0, 1, 2, 3), 7, update))
    store.end(1, "solved", None)
    assert 30_000 < store.bytes_ended < 40_000


def test_a_job_that_starts_over_has_no_nodes_and_has_not_started(store):
    added(store, job="a")
    store.change(1, "preparing", nodes=(1, 2))
    live(store, 1, "running")
    over = store.change(1, "queued", message="its nodes were lost")
    assert (over.nodes, over.started, over.message) == ((), None, "its nodes were lost")


def test_epochs_are_numbered_and_the_file_is_that_of_the_latest(store, reopened):
    added(store, job="a")
    live(store, 1, "preparing", "running")
    file = ProblemFile("a.toml", {"kind": "arm-ik"}, Run(topology="ring 4"), Path("/"))
    store.note_placing(1, Placement(0, file, (0, 1, 2, 3), 7))
    assert (store.epochs(1), store.past(1)) == ([], (Past(), {}))
    update, rewire = {"do": "update", "fields": {"goal": [1, 2]}}, {"do": "rewire", "topology": "complete 4"}
    store.note_placing(1, Placement(1, file, (0, 1, 2, 3), 7, update))
    rewired = file.with_run(topology="complete 4")
    past = Past(1, generations=9, history="abcd").led_on({"epoch": 1, "generation": 9, **update})
    store.note_placing(1, Placement(2, rewired, (4, 5, 6, 7), 8, rewire, past))
    again = reopened(store)
    assert again.past(1) == (past, rewire)
    shown, epochs = again.show("a"), again.epochs(1)
    assert (shown.epoch, shown.file, shown.topology, shown.wiring) == (2, FILE.file, "complete 4", 8)
    assert (shown.file_now, shown.nodes) == (rewired.to_json(), (4, 5, 6, 7))
    assert [(epoch["epoch"], epoch["generation"]) for epoch in epochs] == [(1, 9), (2, None)]
    assert epochs[0]["fields"] == {"goal": [1, 2]}


def test_of_many_epochs_the_latest_are_told(store, monkeypatch):
    added(store, job="a")
    live(store, 1, "preparing", "running")
    file = ProblemFile("a.toml", {"kind": "arm-ik"}, Run(topology="ring 4"), Path("/"))
    for epoch in range(1, 8):
        store.note_placing(1, Placement(epoch, file, (0, 1, 2, 3), 7, {"do": "update", "fields": {"goal": "x" * 100}}))
    assert [each["epoch"] for each in store.epochs(1)] == [1, 2, 3, 4, 5, 6, 7]
    monkeypatch.setattr("coordinator.store.job_reader._MOST_DIRECTIVE_BYTES", 300)
    assert [each["epoch"] for each in store.epochs(1)] == [6, 7]
    monkeypatch.setattr("coordinator.store.job_reader._MOST_DIRECTIVE_BYTES", 10)
    assert [each["epoch"] for each in store.epochs(1)] == [7]


def test_a_job_that_lives_for_days_does_not_fill_the_store(store, monkeypatch):
    monkeypatch.setattr("spy.past.MOST_BYTES", 2000)
    monkeypatch.setattr("coordinator.store.job_reader._FIRST_STATES", 3)
    monkeypatch.setattr("coordinator.store.job_reader._LATEST_STATES", 20)
    monkeypatch.setattr("coordinator.store.job_store._TIDY_EVERY", 10)
    added(store, job="a")
    live(store, 1, "preparing", "running")
    file = ProblemFile("a.toml", {"kind": "arm-ik"}, Run(topology="ring 4"), Path("/"))
    past = Past()
    for epoch in range(1, 101):
        why = {"do": "update", "fields": {"goal": "x" * 100, "epoch": epoch}}
        past = past.and_then(Lived(file, number=epoch - 1), why)
        store.note_placing(1, Placement(epoch, file, (0, 1, 2, 3), 7, why, past))
        live(store, 1, "waiting", "running")
    rows = store.epochs(1)
    assert len(rows) < 40
    assert rows[0]["do"] == "several"
    assert [row["epoch"] for row in rows[1:]] == list(range(rows[0]["epoch"] + 1, 101))
    found, latest = store.past(1)
    assert found.directives == past.directives
    assert latest == why
    states = [state for state, _ in store.transitions(1)]
    assert states[:4] == ["submitted", "queued", "preparing", "waiting"]
    assert len(states) <= 3 + 20


def test_the_states_of_a_job_are_kept_but_for_those_in_the_middle(store, monkeypatch):
    added(store, job="a")
    added(store, job="b")
    live(store, 2, "preparing", "running")
    live(store, 1, "preparing", "running", *["waiting", "running"] * 10)
    monkeypatch.setattr("coordinator.store.job_reader._FIRST_STATES", 2)
    monkeypatch.setattr("coordinator.store.job_reader._LATEST_STATES", 3)
    monkeypatch.setattr("coordinator.store.job_store._TIDY_EVERY", 1)
    file = ProblemFile("a.toml", {"kind": "arm-ik"}, Run(topology="ring 4"), Path("/"))
    store.note_placing(1, Placement(1, file, (0, 1, 2, 3), 7, {"do": "update", "fields": {}}))
    monkeypatch.setattr("coordinator.store.job_reader._LATEST_STATES", 1000)
    assert [state for state, _ in store.transitions(1)] == ["submitted", "queued", "running", "waiting", "running"]
    assert len(store.transitions(2)) == 4


def test_what_was_an_answer_before_an_update_is_none_after_it(store):
    added(store, job="a")
    live(store, 1, "preparing", "running")
    file = ProblemFile("a.toml", {"kind": "arm-ik"}, Run(topology="ring 4"), Path("/"))
    store.note_best(1, 0.5, BEST)
    store.note_placing(1, Placement(1, file, (0, 1, 2, 3), 7, {"do": "rewire", "topology": "complete 4"}))
    assert (store.answer("a").best, store.answer("a").fitness) == (BEST, 0.5)
    store.note_placing(1, Placement(2, file, (0, 1, 2, 3), 7, {"do": "update", "fields": {}}))
    assert (store.answer("a").best, store.answer("a").fitness) == (None, None)


def test_a_job_may_get_other_nodes(store):
    added(store, job="a")
    assert store.note_nodes(1, (4, 5)).nodes == (4, 5)


def test_messages_hold_whatever_a_problem_says(store):
    added(store, job="a")
    assert store.change(1, "failed", message="\0 \ud800 ü").message == "\\0 ? ü"
    assert store.show("a").message == "\\0 ? ü"


def test_what_is_written_in_one_transaction_is_written_at_once_or_not_at_all(store):
    added(store, job="a")
    with store.transaction():
        store.change(1, "preparing")
        store.change(1, "running")
    assert store.show("a").status == "running"

    def write():
        with store.transaction():
            store.note_best(1, 0.5, BEST)
            raise KeyError

    with pytest.raises(KeyError):
        write()
    assert store.show("a").best is None


# Asking ---------------------------------------------------------------------------------------------------------------
def test_unended_jobs_come_in_the_order_of_coming(store):
    for number in range(1, 7):
        added(store, job=f"j{number}")
    store.end(2, "cancelled", None)
    live(store, 3, "preparing", "running")
    live(store, 5, "preparing", "running", "waiting")
    live(store, 6, "preparing", "deadline")
    assert [(job.job, job.status) for job in store.unended()] == [
        ("j1", "queued"),
        ("j3", "running"),
        ("j4", "queued"),
        ("j5", "waiting"),
        ("j6", "deadline"),  # its nodes have not stopped
    ]
    assert store.counts() == {"queued": 2, "cancelled": 1, "running": 1, "waiting": 1, "deadline": 1}
    store.end(6, "deadline", None)
    assert [job.job for job in store.unended()] == ["j1", "j3", "j4", "j5"]
    assert store.counts()["deadline"] == 1


def test_the_newest_come_last(store):
    for number in range(1, 6):
        added(store, job=f"j{number}")
    assert [job.job for job in store.newest(2)] == ["j4", "j5"]
    assert len(store.newest()) == 5
    assert store.newest(0) == []


def test_an_unknown_job_is_named(store):
    for ask in (store.show, store.summary):
        with pytest.raises(UnknownJob, match=r"^there is no job 'nobody'$"):
            ask("nobody")
    with pytest.raises(UnknownJob):
        store.change(7, "preparing")


def test_any_thread_may_write_and_read(store):
    def work(first):
        for number in range(10):
            job = added(store, job=f"{first}-{number}")
            store.change(job.number, "preparing")
            assert store.show(job.job).status == "preparing"

    threads = [threading.Thread(target=work, args=(first,)) for first in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert store.counts() == {"preparing": 40}
    assert sorted(job.number for job in store.newest()) == list(range(1, 41))


# One coordinator, that may die ----------------------------------------------------------------------------------------
def test_a_second_coordinator_is_refused(store, url, monkeypatch):
    monkeypatch.setattr(database, "_CLAIM_WITHIN", 0.2)
    with pytest.raises(StoreFailed, match="another coordinator uses it"):
        Store(url)
    store.close()
    Store(url).close()


WRITER = """
import sys
from coordinator.store.job_store import Store
from coordinator.store.stored_job import Submission
store = Store(sys.argv[1])
for number in range(200):
    job, _ = store.add(Submission("file", "digest", "arm-ik", "ring 4", 4), f"j{number}")
    print(job.job, flush=True)
"""


@pytest.mark.parametrize("seed", [1, 2])
def test_every_acknowledged_job_survives_a_kill_in_the_middle(url, seed):
    writer = subprocess.Popen([sys.executable, "-c", WRITER, url], stdout=subprocess.PIPE, text=True)
    acknowledged = []
    for line in writer.stdout:
        acknowledged.append(line.strip())
        if len(acknowledged) == random.Random(seed).randint(50, 150):
            time.sleep(random.Random(seed).random() * 0.01)
            writer.kill()
    assert writer.wait() == -signal.SIGKILL
    store = Store(url)
    kept = [job.job for job in store.unended()]
    assert 50 <= len(acknowledged) < 200
    assert kept[: len(acknowledged)] == acknowledged
    assert len(kept) <= len(acknowledged) + 1
    assert added(store, job="next").number > len(kept)
    store.close()


def test_adding_takes_milliseconds(store):
    took = []
    for _ in range(100):
        before = time.perf_counter()
        added(store)
        took.append(time.perf_counter() - before)
    assert statistics.median(took) < 0.05  # a few, but machines may be busy


def test_a_postgres_that_comes_back_is_used_again(postgres_server):
    store = Store(postgres_server.url())
    added(store, job="a")
    postgres_server.stop()
    try:
        with pytest.raises(StoreFailed) as caught:
            store.newest()
        assert caught.value.passing
    finally:
        postgres_server.start()
    assert [job.job for job in store.newest()] == ["a"]
    added(store, job="b")
    store.close()


# What is refused ------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("jobs.sqlite", "expected a URL such as"),
        ("mysql+pymysql://host/name", "found mysql"),
        ("sqlite://", "in memory"),
        ("sqlite:////nowhere/at/all/jobs.sqlite", "No such file or directory"),
    ],
)
def test_other_databases_are_refused_in_a_line(url, expected):
    with pytest.raises(StoreFailed, match=expected) as caught:
        Store(url)
    assert "\n" not in str(caught.value)


def test_a_password_is_not_told(monkeypatch):
    pytest.importorskip("psycopg")
    with pytest.raises(StoreFailed) as caught:
        Store("postgresql://ada:secret@/name?host=/nowhere")
    assert "secret" not in str(caught.value)
    assert "ada:***" in str(caught.value)
    assert caught.value.passing


def test_a_file_that_is_no_store_is_refused(tmp_path):
    (tmp_path / "jobs.sqlite").write_text("something else, of whatever length it may be" * 100)
    with pytest.raises(StoreFailed, match="file is not a database"):
        Store(sqlite_url(tmp_path / "jobs.sqlite"))


def test_a_store_of_another_version_is_refused(tmp_path):
    url = sqlite_url(tmp_path / "jobs.sqlite")
    Store(url).close()
    with sqlite3.connect(tmp_path / "jobs.sqlite") as connection:
        connection.execute("update meta set schema = 7")
    connection.close()
    with pytest.raises(StoreFailed, match="expected a store of version 6, found 7"):
        Store(url)


def test_a_sqlite_file_is_private_and_synced(tmp_path):
    store = Store(sqlite_url(tmp_path / "jobs.sqlite"))
    added(store)
    assert {path.stat().st_mode & 0o077 for path in Path(tmp_path).iterdir()} == {0}
    with store._database.engine.connect() as connection:
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "wal"
        assert connection.exec_driver_sql("PRAGMA synchronous").scalar() == 2
    store.close()


def test_what_is_kept_is_plain_json(store):
    added(store, job="a")
    live(store, 1, "preparing", "running")
    store.note_best(1, None, json.loads(json.dumps(BEST)))
    assert store.show("a").fitness is None
    assert os.linesep not in json.dumps(store.show("a").best)
