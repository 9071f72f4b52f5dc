"""What the dispatcher tells is written, then published, in order, whatever happens to the database meanwhile."""

import io
import json
import threading
import time
from pathlib import Path

import pytest
from places import until
from stub_dispatcher import result

import supernode
from coordinator.jobs.job import JobSpec
from coordinator.log_lines import LogLines
from coordinator.store import recorder as module
from coordinator.store.database import StoreFailed, sqlite_url
from coordinator.store.job_store import Store
from coordinator.store.record_book import Keep, RecordBook
from coordinator.store.recorder import Recorder, log_record
from coordinator.store.stored_job import Submission
from problems import BadInput
from wire.news import Improvement, Statistics

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "arm-ik.toml"
NEW = Submission("file", "digest", "arm-ik", "ring 4", 4)


class Bench:
    def __init__(self, path):
        self.store = Store(sqlite_url(path / "jobs.sqlite"))
        self.said = io.StringIO()
        self.published = []
        self.forgotten = []
        self.recorder = Recorder(
            self.store,
            RecordBook(self.store, Keep()),
            LogLines("c1", file=self.said),
            self.publish,
            self.forgotten.append,
        )

    def publish(self, state):
        assert self.store.at(state.number).status == state.status or state.status not in ("failed", "solved")
        self.published.append((state.job, state.status))

    def settled(self):
        self.recorder.close()
        return self.published


@pytest.fixture
def bench(tmp_path):
    bench = Bench(tmp_path)
    yield bench
    bench.recorder.close()
    bench.store.close()


def better(number, fitness):
    return Improvement(number, 0, 0.1, 3, 1, fitness, True, {"x": 1.0})


def test_states_are_published_in_their_order(bench):
    for name in "ab":
        bench.store.add(NEW, name)
    with bench.recorder.paused():
        for status in ("preparing", "running"):
            for number in (1, 2):
                bench.recorder.changed(number, status, (number,))
        bench.recorder.ended(1, BadInput("not like that"))
        assert bench.published == []
    assert bench.settled() == [
        ("a", "preparing"),
        ("b", "preparing"),
        ("a", "running"),
        ("b", "running"),
        ("a", "failed"),
    ]
    assert bench.forgotten == [1]
    assert bench.store.show("a").message == "not like that"
    assert bench.store.show("b").nodes == (2,)


def test_what_cannot_follow_is_dropped_and_told(bench):
    bench.store.add(NEW, "a")
    bench.recorder.ended(1, KeyError("x"))
    bench.recorder.ended(1, BadInput("again"))
    bench.recorder.changed(1, "running", ())
    bench.recorder.changed(7, "running", ())
    assert bench.settled() == [("a", "failed")]
    assert bench.store.show("a").message == "KeyError: 'x'"
    said = [json.loads(line) for line in bench.said.getvalue().splitlines()]

    def about(words):
        return [line.get("job") for line in said if words in line["event"]]

    assert set(about("job failed")) == set(about("after 'failed' comes nothing more")) == {"a"}
    assert set(about("there is no job of number 7")) == {None}


def test_the_same_state_again_is_no_news_but_other_nodes_are_kept(bench):
    bench.store.add(NEW, "a")
    bench.recorder.changed(1, "queued", ())
    bench.recorder.changed(1, "preparing", (1, 2))
    bench.recorder.changed(1, "preparing", (1, 3))
    assert bench.settled() == [("a", "preparing")]
    assert bench.store.show("a").nodes == (1, 3)


def test_the_best_is_kept_and_not_every_one_on_the_way(bench, monkeypatch):
    bench.store.add(NEW, "a")
    written = []
    note = bench.store.note_best
    monkeypatch.setattr(bench.store, "note_best", lambda *each: (written.append(each), note(*each)))
    with bench.recorder.paused():
        for step in range(100):
            bench.recorder.improved(1, better(1, 100.0 - step))
    bench.settled()
    assert bench.store.show("a").fitness == 1.0
    assert bench.store.show("a").best["solution"] == {"x": 1.0}
    assert len(written) <= 2  # one may have been taken before the rest came


def test_it_waits_for_a_database_that_is_away(bench, monkeypatch):
    monkeypatch.setattr(module, "_TRY_AGAIN", 0.01)
    bench.store.add(NEW, "a")
    change, failures = bench.store.change, []

    def fail_twice(*arguments, **options):
        if len(failures) < 2:
            failures.append(1)
            raise StoreFailed("store: away", passing=True)
        return change(*arguments, **options)

    monkeypatch.setattr(bench.store, "change", fail_twice)
    bench.recorder.changed(1, "preparing", ())
    until = time.monotonic() + 10
    while not bench.published and time.monotonic() < until:
        time.sleep(0.01)
    assert bench.settled() == [("a", "preparing")]
    assert bench.said.getvalue().count("store: away") == 1


def test_while_the_database_is_away_each_line_of_the_log_is_shown_once(bench, monkeypatch):
    monkeypatch.setattr(module, "_TRY_AGAIN", 0.01)
    transaction, away = bench.store.transaction, threading.Event()
    away.set()

    def fail_while_away():
        if away.is_set():
            raise StoreFailed("store: away", passing=True)
        return transaction()

    monkeypatch.setattr(bench.store, "transaction", fail_while_away)
    for line in ("first line", "second line"):
        bench.recorder.logged(log_record("info", line))
        until(lambda line=line: line in bench.said.getvalue())
    away.clear()
    until(lambda: len(RecordBook(bench.store, Keep()).log(None, None, 0)["rows"]) == 2)
    assert [bench.said.getvalue().count(each) for each in ("first line", "second line", "store: away")] == [1, 1, 1]
    stored = RecordBook(bench.store, Keep()).log(None, None, 0)
    assert [row[stored["columns"].index("text")] for row in stored["rows"]] == ["first line", "second line"]


def test_nodes_keep_their_job_until_its_end_is_written(bench, monkeypatch):
    monkeypatch.setattr(module, "_TRY_AGAIN", 0.01)
    bench.store.add(NEW, "a")
    end, known, dropped = bench.store.end, [], threading.Event()
    failures = iter([StoreFailed("the disk is full", passing=True)] * 2)

    def fail_twice(*arguments, **options):
        known.append("tried")
        if (error := next(failures, None)) is not None:
            raise error
        return end(*arguments, **options)

    monkeypatch.setattr(bench.store, "end", fail_twice)
    bench.recorder.ended(1, BadInput("over"), lambda: (known.append(bench.store.show("a").status), dropped.set()))
    assert dropped.wait(20)
    assert known == ["tried", "tried", "tried", "failed"]


def test_an_end_whose_result_cannot_be_written_is_an_end_all_the_same(bench, monkeypatch):
    bench.store.add(NEW, "a")
    end = bench.store.end

    def refuse_results(number, status, result, **options):
        if result is not None:
            raise StoreFailed("store: too large")
        return end(number, status, result, **options)

    monkeypatch.setattr(bench.store, "end", refuse_results)
    bench.recorder.changed(1, "preparing", ())
    bench.recorder.ended(1, result(JobSpec(1, supernode.load(EXAMPLE)), "solved"))
    assert bench.settled()[-1] == ("a", "failed")
    assert "too large" in bench.store.show("a").message


def test_one_that_cannot_be_written_does_not_stop_the_others(bench, monkeypatch):
    for name in "abc":
        bench.store.add(NEW, name)
    change = bench.store.change

    def fail_for_two(number, *arguments, **options):
        if number == 2:
            raise StoreFailed("store: no such thing")
        return change(number, *arguments, **options)

    monkeypatch.setattr(bench.store, "change", fail_for_two)
    with bench.recorder.paused():
        for number in (1, 2, 3):
            bench.recorder.changed(number, "preparing", ())
    assert bench.settled() == [("a", "preparing"), ("c", "preparing")]
    assert bench.store.counts() == {"preparing": 2, "queued": 1}
    assert "no such thing" in bench.said.getvalue()


def test_how_a_job_was_at_its_end_is_written_though_a_second_has_not_gone_by(bench):
    bench.store.add(NEW, "a")
    for generation in (1, 2, 3):
        values = dict.fromkeys(Statistics._fields, 0) | {"job": 1, "generation": generation}
        bench.recorder.measured(Statistics(**values))
    bench.recorder.ended(1, BadInput("over"))
    bench.settled()
    page = RecordBook(bench.store, Keep()).page("statistics", "a", 0)
    generations = [row[page["columns"].index("generation")] for row in page["rows"]]
    assert generations == [1, 3]
