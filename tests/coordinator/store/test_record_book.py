"""What happened in jobs: written, read page by page, and forgotten in time."""

import math

import pytest

from coordinator.store import record_book as module
from coordinator.store.database import sqlite_url
from coordinator.store.job_store import Store
from coordinator.store.record_book import Keep, RecordBook
from coordinator.store.stored_job import Submission, UnknownJob
from problems import BadInput
from spy.improvement_records import ImprovementRecord
from wire.news import Improvement, LogRecord, Statistics

DAY = 86400.0


@pytest.fixture
def store(tmp_path):
    store = Store(sqlite_url(tmp_path / "jobs.sqlite"))
    for job in ("a", "b"):
        store.add(Submission("{}", job, "function", "torus 2x2", 4), job)
    yield store
    store.close()


@pytest.fixture
def book(store):
    return RecordBook(store, Keep(days=2.0, rows=5))


def improvement(job=1, fitness=2.0, generation=3):
    return Improvement(job, 0, 0.5, generation, 7, fitness, True, {"x": 1.0})


def statistics(job=1, generation=3, best=1.0):
    return Statistics(job, 1, generation, 40, 16, 64, 0, 1, 4, 8.0, best, 2.0, math.inf, 2, 0.75, 0.01)


def record(generation, fitness, epoch=0):
    return ImprovementRecord(epoch, generation, 3, 16 * generation, fitness)


def rows(book, kind, job="a", after=0):
    page = book.page(kind, job, after)
    assert not page["more"]
    return [dict(zip(page["columns"], row, strict=True)) for row in page["rows"]]


def test_what_was_noted_is_there(book):
    book.note_improvement(100.0, improvement())
    book.note_statistics(101.0, statistics())
    (found,) = rows(book, "improvements")
    assert found.pop("id") > 0
    assert found == {
        "at": 100.0,
        "seconds": 0.5,
        "epoch": 0,
        "generation": 3,
        "cell": 7,
        "fitness": 2.0,
        "feasible": True,
    }
    (found,) = rows(book, "statistics")
    assert found.pop("id") > 0
    told = statistics()._asdict() | {"at": 101.0, "worst": None}
    assert found == {name: value for name, value in told.items() if name != "job"}
    assert rows(book, "statistics", "b") == []


def test_the_history_of_an_epoch_has_no_time_and_is_written_once(book):
    for records in ([record(0, 3.0)], [record(0, 3.0), record(4, 2.0)]):
        book.note_history(100.0, 1, 0, records)
    book.note_history(101.0, 1, 1, [record(2, 1.0, epoch=1)])
    found = rows(book, "history")
    assert all(each.pop("id") > 0 for each in found)
    assert found == [each._asdict() for each in (record(0, 3.0), record(4, 2.0), record(2, 1.0, epoch=1))]
    assert rows(book, "history", "b") == []


def test_page_by_page_nothing_is_missing_or_twice(book, monkeypatch):
    monkeypatch.setattr(module, "_PAGE", 3)
    for generation in range(8):
        book.note_statistics(float(generation), statistics(1 + generation % 2, generation))
    seen, after, more = [], 0, True
    while more:
        page = book.page("statistics", "a", after)
        assert len(page["rows"]) <= 3
        seen += [row[page["columns"].index("generation")] for row in page["rows"]]
        after, more = page["rows"][-1][0], page["more"]
    assert seen == [0, 2, 4, 6]


def test_what_is_not_there(book):
    with pytest.raises(UnknownJob):
        book.page("statistics", "c", 0)
    with pytest.raises(BadInput, match="kind: expected one of improvements, history, statistics, found 'gossip'"):
        book.page("gossip", "a", 0)


def test_more_than_is_to_be_kept_is_forgotten_oldest_first(book, monkeypatch):
    monkeypatch.setattr(module, "_LOOK_AFTER", 4)
    for generation in range(9):
        book.note_statistics(DAY + generation, statistics(generation=generation))
        book.note_improvement(DAY + generation, improvement(generation=generation))
    book.forget_the_old(DAY + 10)
    assert [row["generation"] for row in rows(book, "statistics")] == [4, 5, 6, 7, 8]
    assert [row["generation"] for row in rows(book, "improvements")] == [4, 5, 6, 7, 8]


def test_what_is_too_old_is_forgotten_and_jobs_that_ended_then(book, store):
    store.change(1, "cancelled")
    ended = store.summary("a").ended
    book.note_statistics(ended, statistics())
    book.note_statistics(ended + 1.5 * DAY, statistics(2))
    book.forget_the_old(ended + 2.5 * DAY)
    with pytest.raises(UnknownJob):
        store.show("a")
    assert store.summary("b").status == "queued", "it has not ended"
    assert len(rows(book, "statistics", "b")) == 1


def test_it_looks_only_now_and_then(book):
    book.forget_the_old(0.0)
    for generation in range(9):
        book.note_statistics(0.0, statistics(generation=generation))
    book.forget_the_old(0.0)
    assert len(rows(book, "statistics")) == 9


def test_the_log_of_all_of_a_job_and_of_a_node(book):
    book.note_log(LogRecord("warning", "node 3", "bad\0message", 100.0, 3, 4, 1, 7))
    book.note_log(LogRecord("error", "coordinator", "job failed", 101.0, job=2))
    book.note_log(LogRecord("warning", "coordinator", "a process has died", 102.0, node=3))
    book.note_log(LogRecord("warning", "node 5", "of a job that nobody kept", 103.0, 5, 0, 77, 0))

    def told(**of):
        page = book.log(**({"job": None, "node": None, "after": 0} | of))
        return [dict(zip(page["columns"], row, strict=True)) for row in page["rows"]]

    first, second, *others = told()
    assert (first["text"], first["job"], first["node"], first["cell"]) == ("bad\\0message", "a", 3, 4)
    assert (first["generation"], first["at"], first["level"], first["process"]) == (7, 100.0, "warning", "node 3")
    assert (second["job"], second["node"]) == ("b", None)
    assert [each["job"] for each in others] == [None, None]
    assert told(job="a") == [first]
    assert [each["at"] for each in told(node=3)] == [100.0, 102.0]
    assert told(after=second["id"]) == others
    with pytest.raises(UnknownJob):
        told(job="c")


def test_the_log_is_forgotten_too(book):
    for number in range(7):
        book.note_log(LogRecord("info", "spy", str(number), DAY))
    book.forget_the_old(DAY)
    assert [row[4] for row in book.log(None, None, 0)["rows"]] == ["2", "3", "4", "5", "6"]


def test_the_file_of_large_jobs_does_not_grow_for_ever(store, tmp_path):
    book, sizes = RecordBook(store, Keep(bytes=1 << 20)), []
    for number in range(300):
        job, _ = store.add(Submission("x" * 50_000, str(number), "function", "torus 2x2", 4))
        with store.transaction():
            store.end(job.number, "cancelled", None)
            book.forget_the_old(job.submitted)
        sizes.append(sum(file.stat().st_size for file in tmp_path.iterdir()))
    kept = [job.number for job in store.newest() if job.ended is not None]
    assert kept == list(range(303 - len(kept), 303)), "the latest"
    assert 19 <= len(kept) <= 22
    assert sizes[-1] <= 1.1 * sizes[100], "what is free is used again"
