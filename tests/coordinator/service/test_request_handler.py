"""What the request handler answers, what it keeps, what it hands over, and what it publishes, in which order."""

import io
import json
import sys
import threading
import time
from functools import partial
from pathlib import Path

import pytest
from stub_dispatcher import StubDispatcher

import supernode
from coordinator.jobs.client_limits import ClientLimits
from coordinator.log_lines import LogLines
from coordinator.service.checking import Checker
from coordinator.service.request_handler import RequestHandler
from coordinator.store.database import StoreFailed, sqlite_url
from coordinator.store.job_store import Store
from coordinator.store.record_book import Keep, RecordBook
from coordinator.store.recorder import Recorder
from spy.past import Past
from wire.jobs import Cancel, Done, Down, ListJobs, Refused, Rewire, Show, Status, Submit, Update
from wire.news import Improvement

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
OFFICE = supernode.load(EXAMPLES / "mobile-robot.toml")

MANUAL = partial(StubDispatcher, manual=True)


def file(topology="ring 4", example="arm-ik", **run):
    return supernode.load(EXAMPLES / f"{example}.toml").with_run(topology=topology, **run).to_json()


class Office:
    """A request handler with all that belongs to it."""

    def __init__(self, path, make=MANUAL, nodes=16, checker=None):
        self.published = []
        self.store = Store(sqlite_url(path / "jobs.sqlite"))
        self.book = RecordBook(self.store, Keep())
        self.said = io.StringIO()
        lines = LogLines("c1", file=self.said)
        self.recorder = Recorder(self.store, self.book, lines, self.published.append, self.forget)
        self.dispatcher = make(None, None, nodes, self.recorder)
        checker = checker or Checker()
        self.request_handler = RequestHandler(
            "c1", self.store, self.book, self.recorder, self.dispatcher, checker, self.published.append
        )

    def forget(self, number):
        self.request_handler.forget(number)

    def ask(self, request):
        """The value of the answer."""
        answer = self.request_handler.answer(request)
        assert isinstance(answer, Done), answer
        return answer.value

    def refusal(self, request, blame="input"):
        """The words of the refusal."""
        answer = self.request_handler.answer(request)
        assert isinstance(answer, Refused), answer
        assert answer.blame == blame
        return answer.message

    def until(self, job, status, holds=lambda shown: True):
        """Wait until the store says that a job has come so far, and this holds of it."""
        for _ in range(1000):
            if self.store.summary(job).status == status and holds(shown := self.ask(Show(job))):
                return shown
            time.sleep(0.005)
        raise AssertionError(f"{job} is {self.store.summary(job).status}")

    def states(self, job):
        return [state.status for state in self.published if state.job == job]

    def close(self):
        self.recorder.close()
        self.dispatcher.close()
        self.store.close()


@pytest.fixture
def office(tmp_path):
    office = Office(tmp_path)
    yield office
    office.close()


@pytest.fixture
def offices(tmp_path):
    """Opens one office after another on the same store."""
    opened = []

    def open_one(**options):
        if opened:
            opened[-1].close()
        opened.append(Office(tmp_path, **options))
        return opened[-1]

    yield open_one
    if opened:
        opened[-1].close()


# A job's way ----------------------------------------------------------------------------------------------------------
def test_a_job_from_submit_to_its_result(office):
    assert office.ask(Submit(file(), "a", 3)) == {"job": "a", "status": "queued"}
    shown = office.until("a", "running")
    assert (shown["kind"], shown["cells"], shown["topology"], shown["priority"]) == ("arm-ik", 4, "ring 4", 3)
    assert (shown["nodes"], shown["number"]) == ([0, 1, 2, 3], 1)
    spec = office.dispatcher.orders[1]
    assert (spec.job, spec.priority, spec.file.kind) == ("a", 3, "arm-ik")
    office.dispatcher.end(1)
    shown = office.until("a", "solved")
    assert shown["fitness"] == 0.25
    assert shown["result"]["job"] == "a"
    assert shown["best"]["solution"] == {"x": [None]}
    assert json.loads(shown["file"])[1]["kind"] == "arm-ik"
    states = ["submitted", "queued", "preparing", "running", "solved"]
    assert [state for state, _ in shown["states"]] == states
    assert office.states("a") == states
    assert office.published[-1].fitness == 0.25
    (listed,) = office.ask(ListJobs())
    assert listed == {name: shown[name] for name in listed}
    assert set(listed) >= {"job", "kind", "status", "fitness", "submitted", "started", "ended", "cells", "message"}


def test_what_is_answered_is_plain(office):
    office.ask(Submit(file(), "a"))
    office.until("a", "running")
    for request in (ListJobs(), Show("a"), Status(), Cancel("a"), Down()):
        json.dumps(office.ask(request), allow_nan=False)


def test_the_same_submit_again_is_the_same_job(office):
    first = office.ask(Submit(file(), "a"))
    office.until("a", "running")
    assert office.ask(Submit(file(), "a")) == first | {"status": "running"}
    assert office.dispatcher.asked == [("submit", 1)]
    assert office.refusal(Submit(file(seed=2), "a")) == (
        "this problem was submitted as job 'a' before with other settings (seed not given, now 2); give it another id"
    )


def test_many_at_once_with_one_id_are_one_job(office):
    answers = []
    ask = partial(office.ask, Submit(file(), "a"))
    threads = [threading.Thread(target=lambda: answers.append(ask())) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {answer["job"] for answer in answers} == {"a"}
    assert office.dispatcher.asked == [("submit", 1)]


def test_seconds_run_from_the_acceptance(office):
    before = time.monotonic()
    office.ask(Submit(file(), "a"))
    assert before - 0.01 <= office.dispatcher.orders[1].submitted <= time.monotonic()


def test_cancelling(office):
    office.ask(Submit(file("torus 4x4"), "a"))
    office.ask(Submit(file("torus 4x4"), "b"))
    office.until("a", "running")
    assert office.ask(Cancel("b")) == {"job": "b", "status": "queued"}
    office.until("b", "cancelled")
    office.ask(Cancel("a"))
    office.until("a", "cancelled")
    assert office.ask(Cancel("a")) == {"job": "a", "status": "cancelled"}
    assert office.states("b") == ["submitted", "queued", "cancelled"]


def test_the_status_of_the_cluster(office):
    office.ask(Submit(file(), "a"))
    office.until("a", "running")
    status = office.ask(Status())
    assert (status["cluster"], status["protocol"], status["jobs"]) == ("c1", 1, {"running": 1})
    assert len(status["nodes"]) == 16


def test_the_newest_jobs_are_listed(office):
    for number in range(5):
        office.ask(Submit(file(), f"j{number}"))
    assert [job["job"] for job in office.ask(ListJobs(2))] == ["j3", "j4"]


# What is refused ------------------------------------------------------------------------------------------------------
def test_unknown_jobs(office):
    for request in (Show("x"), Cancel("x"), Update("x", "{}"), Rewire("x", "ring 4")):
        assert office.refusal(request) == "there is no job 'x'"


def test_a_job_larger_than_the_cluster_leaves_no_trace(office):
    expected = "the job asks for 64 cells (torus 8x8), the cluster has 16 nodes"
    assert office.refusal(Submit(file("torus 8x8"), "a")) == expected
    assert office.ask(ListJobs()) == []
    assert office.published == []
    assert office.ask(Submit(file(), "a"))["job"] == "a"


def test_a_graph_that_the_cluster_cannot_have_is_refused_before_it_is_built(robot, monkeypatch):
    monkeypatch.setitem(sys.modules, "networkx", None)  # whoever imports it fails
    name, fields, run, folder = json.loads(file())
    huge = json.dumps([name, fields, run | {"topology": "random-regular 16000 254 seed 5"}, folder])
    asks = "the job asks for 16000 cells (random-regular 16000 254 seed 5), the cluster has 16 nodes"
    assert robot.refusal(Submit(huge)) == asks
    expected = "topology: expected one of 4 cells, as the job has, found 16000"
    assert robot.refusal(Rewire("r", "random-regular 16000 254 seed 6")) == expected


def test_a_full_queue(offices):
    office = offices(make=partial(StubDispatcher, manual=True, limits=ClientLimits(waiting=1)), nodes=4)
    for number in range(2):
        office.ask(Submit(file(), f"j{number}"))
    full = "the queue is full: 1 jobs wait, at most 1 may"
    assert office.refusal(Submit(file(), "j2"), "failure") == full
    assert len(office.ask(ListJobs())) == 2


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("nothing", "expected a problem file as JSON"),
        ('["x.toml", {"kind": "arm-ki"}, {}, "/"]', "x.toml: kind: expected one of arm-ik"),
        ('["x.toml", {"kind": "arm-ik"}, {}, "/"]', "x.toml: "),
        ('["x.toml", {"kind": "arm-ik"}, {"topology": "disc 4"}, "/"]', "x.toml: run: topology: expected a topology"),
    ],
)
def test_bad_problems(office, text, expected):
    assert office.refusal(Submit(text)).startswith(expected)
    assert office.ask(ListJobs()) == []


def test_a_store_that_fails_is_not_the_clients_fault(office, monkeypatch):
    def fail(*_):
        raise StoreFailed("store: disk full")

    monkeypatch.setattr(office.store, "add", fail)
    assert office.refusal(Submit(file(), "a"), "failure") == "store: disk full"


# Moving epochs --------------------------------------------------------------------------------------------------------
@pytest.fixture
def robot(office):
    """An office with a mobile robot under way, as job "r"."""
    office.ask(Submit(OFFICE.with_run(topology="ring 4").to_json(), "r"))
    office.until("r", "running")
    return office


def test_an_update_replaces_top_level_keys(robot):
    start = [OFFICE.fields["start"][0] + 0.1, *OFFICE.fields["start"][1:]]
    assert robot.ask(Update("r", json.dumps({"start": start}))) == {"job": "r", "epoch": 1}
    assert robot.dispatcher.asked[-1] == ("update", 1, {"start": start})
    assert robot.dispatcher.placings[1].file.fields == OFFICE.fields | {"start": start}
    assert robot.ask(Update("r", json.dumps({"goal": OFFICE.fields["goal"]})))["epoch"] == 2
    assert robot.dispatcher.placings[1].file.fields["start"] == start  # the second builds on the first
    epochs = robot.ask(Show("r"))["epochs"]
    assert [(epoch["epoch"], epoch["fields"]) for epoch in epochs] == [
        (1, {"start": start}),
        (2, {"goal": OFFICE.fields["goal"]}),
    ]


@pytest.mark.parametrize(
    ("patch", "expected"),
    [
        ({"start": [-50.0, 1.0, 0.0]}, "start: "),
        ({"strat": [1.0, 1.0, 0.0]}, "strat: unknown field, expected one of "),
        ({"kind": "terrain"}, "kind: expected 'mobile-robot' as before, found \"terrain\""),
        ({"run": {"seed": 2}}, "run: expected no [run]"),
        ({"start": "here"}, "start: "),
    ],
)
def test_a_wrong_update_is_refused_and_the_job_goes_on(robot, patch, expected):
    message = robot.refusal(Update("r", json.dumps(patch)))
    assert message.startswith(f"update of {OFFICE.name}: {expected}")
    assert "strat" not in patch or message.endswith("; did you mean 'start'?")
    shown = robot.ask(Show("r"))
    assert (shown["status"], shown["epochs"]) == ("running", [])
    assert robot.dispatcher.placings[1].epoch == 0


def test_an_update_that_codes_individuals_otherwise_is_refused(office):
    office.ask(Submit(file(), "a"))
    office.until("a", "running")
    assert "would change how individuals are coded" in office.refusal(Update("a", '{"bits": 9}'))
    assert office.ask(Update("a", '{"obstacles": []}'))["epoch"] == 1


def test_only_jobs_under_way_can_be_changed(office):
    office.ask(Submit(file("torus 4x4"), "a"))
    office.ask(Submit(file("torus 4x4"), "b"))
    office.until("a", "running")
    assert office.refusal(Update("b", "{}")) == "job 'b' does not run yet: it is queued"
    office.dispatcher.end(1)
    office.until("a", "solved")
    assert office.refusal(Rewire("a", "torus 4x4")) == "job 'a' has ended: it is solved"


def test_rewiring(robot):
    assert robot.ask(Rewire("r", "complete 4")) == {"job": "r", "epoch": 1}
    assert robot.dispatcher.asked[-1] == ("rewire", 1, "complete 4")
    assert robot.ask(Show("r"))["topology"] == "complete 4"
    assert robot.refusal(Rewire("r", "ring 5")) == "topology: expected one of 4 cells, as the job has, found 5"
    assert "expected a topology such as" in robot.refusal(Rewire("r", "knot 4"))


# Users' own problems --------------------------------------------------------------------------------------------------
def test_a_users_own_problem_is_refused_unless_allowed(office, own_problem):
    own = supernode.load(own_problem("size = 8")).with_run(topology="ring 4").to_json()
    assert "it was not started with --allow-module own_module" in office.refusal(Submit(own))


def test_an_allowed_module_is_taken_from_the_clusters_own_folder(offices, own_problem, tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "own_module", raising=False)  # another test's
    path = own_problem("size = 8")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "own_module.py").write_text("raise SystemExit('the wrong one')")
    office = offices(checker=Checker(["own_module"], tmp_path))
    own = supernode.load(path).with_run(topology="ring 4")
    evil = json.dumps([own.name, own.fields, {"topology": "ring 4"}, str(elsewhere)])
    assert office.ask(Submit(evil, "a"))["status"] == "queued"
    assert office.dispatcher.orders[1].file.folder == tmp_path
    bad = json.dumps([own.name, own.fields | {"size": "many"}, {}, "/"])
    assert office.refusal(Submit(bad)).startswith(f"{own.name}: size: ")
    assert "own_module" not in sys.modules


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("import os; os._exit(7)", "died: exit status 7"),
        ("print('hello'); raise SystemExit('no')", "cannot import"),
        ("import time; time.sleep(60)", "took longer than 2 s"),
    ],
)
def test_a_module_that_misbehaves_hurts_nobody(offices, tmp_path, monkeypatch, body, expected):
    from coordinator.service import checking

    if "sleep" in body:
        monkeypatch.setattr(checking, "_WITHIN", 2.0)
    (tmp_path / "own_module.py").write_text(body)
    office = offices(checker=Checker(["own_module"], tmp_path))
    assert expected in office.refusal(Submit('["x.toml", {"kind": "own_module:Mine"}, {}, "/"]'))


# Another coordinator --------------------------------------------------------------------------------------------------
def test_the_next_coordinator_goes_on(offices):
    office = offices(nodes=8)
    for name, priority in [("a", 0), ("b", 0), ("c", 0), ("d", 1)]:
        office.ask(Submit(file(), name, priority))
    office.until("b", "running")
    submitted = office.dispatcher.orders[3].submitted
    office = offices(nodes=8)
    office.request_handler.restore()
    assert office.dispatcher.asked == [
        ("adopt", 1, (0, 1, 2, 3), 0),
        ("adopt", 2, (4, 5, 6, 7), 0),
        ("submit", 3),
        ("submit", 4),
    ]
    assert office.dispatcher.scheduler.queued == (4, 3)
    assert office.dispatcher.orders[3].submitted == pytest.approx(submitted, abs=0.05)
    assert office.ask(Submit(file(), "c", 0)) == {"job": "c", "status": "queued"}
    office.dispatcher.end(1)
    office.until("a", "solved")
    office.until("d", "running")
    assert [state for state, _ in office.ask(Show("a"))["states"]].count("solved") == 1


def test_a_job_whose_nodes_have_forgotten_it_starts_over(offices):
    office = offices()
    office.ask(Submit(file(), "a"))
    office.until("a", "running")
    office = offices(make=partial(StubDispatcher, manual=True, lost=True))
    office.request_handler.restore()
    office.recorder.close()
    states = [state for state, _ in office.ask(Show("a"))["states"]]
    assert states == ["submitted", "queued", "preparing", "running", "queued", "preparing", "running"]


@pytest.mark.parametrize("lost", [False, True], ids=["goes on", "starts over"])
def test_a_cancel_that_was_answered_outlives_the_coordinator(offices, monkeypatch, lost):
    office = offices()
    office.ask(Submit(file(), "a"))
    office.until("a", "running")
    monkeypatch.setattr(office.dispatcher, "cancel", lambda number: None)  # it dies before the cells know
    assert office.ask(Cancel("a")) == {"job": "a", "status": "running"}
    office = offices(make=partial(StubDispatcher, manual=True, lost=lost))
    office.request_handler.restore()
    office.until("a", "cancelled")


def test_a_restored_job_is_in_the_epoch_that_it_had_reached(offices):
    office = offices()
    office.ask(Submit(file(), "a"))
    office.until("a", "running")
    office.ask(Update("a", '{"obstacles": []}'))
    office = offices()
    office.request_handler.restore()
    assert office.dispatcher.asked == [("adopt", 1, (0, 1, 2, 3), 1)]
    spec, placement = office.dispatcher.orders[1], office.dispatcher.placings[1]
    assert spec.file.fields["obstacles"], "as it was submitted"
    assert placement.file.fields["obstacles"] == []
    assert (placement.why["do"], placement.past.epochs) == ("update", 0)


def test_a_job_that_begins_again_keeps_its_past_and_its_answer(offices):
    office = offices()
    office.ask(Submit(file(), "a"))
    office.until("a", "running")
    office.ask(Update("a", '{"obstacles": []}'))
    assert office.ask(Show("a"))["best"] is None, "an answer in the old world"
    office.dispatcher.hooks.improved(1, Improvement(1, 1, 0.2, 4, 2, 0.25, True, {"x": [1.0]}))
    office.until("a", "running", lambda shown: shown["best"] is not None)
    office = offices(make=partial(StubDispatcher, manual=True, lost=True))
    office.request_handler.restore()
    spec = office.dispatcher.orders[1]
    assert (spec.best.epoch, spec.best.fitness, spec.past.epochs) == (1, 0.25, 2)
    assert [each["do"] for each in spec.past.directives] == ["update", "restart"]
    assert spec.past.directives[0]["fields"] == {"obstacles": []}
    assert spec.past.history is None
    office.recorder.close()
    assert "the job cannot go on from where it was: BadInput: they know nothing of it" in office.said.getvalue()


@pytest.mark.parametrize(
    ("epoch", "seconds", "expected"),
    [(0, 0.3, 0.125), (1, 0.3, 0.5), (1, 0.0, 0.125)],
    ids=["of its epoch", "of another epoch", "carried to another epoch"],
)
def test_an_answer_that_was_told_while_no_coordinator_lived_counts(offices, epoch, seconds, expected):
    office = offices()
    office.ask(Submit(file(), "a"))
    office.until("a", "running", lambda shown: shown["best"] is not None)
    office = offices(make=partial(StubDispatcher, manual=True, lost=True))
    office.dispatcher.told[1] = Improvement(1, epoch, seconds, 9, 2, 0.125, True, {"x": [2.0]})
    office.request_handler.restore()
    assert office.dispatcher.orders[1].best.fitness == expected


def test_a_job_that_never_left_its_first_epoch_begins_it_again(offices):
    office = offices()
    office.ask(Submit(file(), "a"))
    office.until("a", "running", lambda shown: shown["best"] is not None)
    office = offices(make=partial(StubDispatcher, manual=True, lost=True))
    office.request_handler.restore()
    spec = office.dispatcher.orders[1]
    assert (spec.past, spec.best.fitness) == (Past(), 0.5)


def test_in_brief_all_that_may_be_large_is_left_out(office):
    office.ask(Submit(file(), "a"))
    whole = office.until("a", "running")
    brief = office.ask(Show("a", brief=True))
    assert whole.keys() - brief.keys() == {"file", "file_now", "epochs", "states"}
    assert brief == {name: whole[name] for name in brief}


def test_a_job_that_cannot_run_any_more_ends_as_failed(offices):
    office = offices(nodes=16)
    office.ask(Submit(file("torus 4x4"), "a"))
    office.ask(Submit(file("torus 4x4"), "b"))
    office = offices(nodes=4)
    office.request_handler.restore()
    shown = office.until("b", "failed")
    assert shown["message"] == "the job asks for 16 cells (torus 4x4), the cluster has 4 nodes"


def test_a_job_that_was_kept_but_never_handed_over_is_so_when_it_is_submitted_again(office):
    office.ask(Submit(file(), "a"))
    office.until("a", "running")
    office.request_handler.forget(1)
    office.dispatcher.orders.clear()
    office.dispatcher.scheduler.free(1)
    office.ask(Submit(file(), "a"))
    assert office.dispatcher.asked == [("submit", 1), ("submit", 1)]
