"""What machines ask a dashboard, and what it says when the cluster is away."""

import gzip
import json
import urllib.request

import pytest
from live_service import until

import supernode
from supernode.dashboard import shared
from wire import jobs as wire
from wire.news import Improvement

PROBLEM = {"file": 'kind = "function"\nname = "onemax"\ndimension = 8\n', "id": "mine"}


def test_health_follows_the_cluster(shown, service):
    assert until(lambda: shown.ask("GET", "/healthz")[0] == 200)
    service.stop()
    text = until(lambda: (told := shown.ask("GET", "/healthz"))[0] == 503 and told[2])
    assert text == "the cluster does not answer\n", "strangers may read it, so it says nothing else"
    service.start()
    assert until(lambda: shown.ask("GET", "/healthz")[0] == 200)


def test_metrics_are_of_the_cluster(shown, service):
    text = until(lambda: (found := shown.ask("GET", "/metrics")[2]) and "supernode_up 1.0" in found and found)
    assert "supernode_nodes_alive 0.0" in text
    assert "# TYPE supernode_evaluations_total counter" in text
    assert "python_info" not in text


def test_a_form_hands_in_a_job(shown, service):
    form = "file=kind+%3D+%22function%22%0Aname+%3D+%22onemax%22%0Adimension+%3D+8&id=mine&seconds=1.5&seed="
    headers = {"Content_Type": "application/x-www-form-urlencoded"}
    status, _, text = until(lambda: (told := shown.ask("POST", "/api/jobs", form, **headers))[0] != 503 and told)
    assert (status, text) == (201, '{"job":"mine"}')
    assert list(service.jobs) == ["mine"]


def test_each_kind_has_a_page_to_start_from(shown):
    status, _, text = shown.ask("GET", "/api/templates/arm-ik")
    assert (status, 'kind = "arm-ik"' in text) == (200, True)
    assert shown.ask("GET", "/api/templates/nothing")[0] == 400


def submitted(shown):
    until(lambda: shown.post("/api/jobs", PROBLEM)[0] == 201)
    until(lambda: [job["job"] for job in shown.dashboard.view.jobs] == ["mine"])


def of_mine(shown):
    status, _, text = shown.ask("GET", "/api/jobs/mine")
    assert status == 200
    return json.loads(text)


def test_a_job_is_asked_for_once_for_all_who_look_and_again_once_there_is_news(shown, service, monkeypatch):
    monkeypatch.setattr(shared, "_SHOW_AGAIN", 1000.0)
    submitted(shown)
    assert of_mine(shown)["problem"]["name"] == "onemax"
    asked = service.asked.count("show")
    for _ in range(20):
        assert of_mine(shown)["status"] == "queued"
    assert service.asked.count("show") == asked
    service.tell("mine", "running")
    service.improve("mine", 3.0)
    until(lambda: of_mine(shown)["best"] is not None)
    service.end("mine")
    until(lambda: shown.dashboard.view.jobs[0]["status"] == "solved")
    assert of_mine(shown)["status"] == "solved", "it is never older than the list"


@pytest.fixture
def running(shown, service, file):
    """A job that the coordinator says to run."""
    service.submitted(wire.Submit(supernode.load(file).to_json(), "mine", 0))
    service.tell("mine", "running")
    until(lambda: [job["status"] for job in shown.dashboard.view.jobs] == ["running"])


@pytest.mark.usefixtures("running")
def test_an_improvement_is_shown_before_the_coordinator_has_it_and_without_asking_it_again(shown, service, monkeypatch):
    monkeypatch.setattr(shared, "_SHOW_AGAIN", 1000.0)
    assert of_mine(shown)["best"] is None
    publish_and_see(shown, service, 3.0)  # the first improvement of the epoch
    asked = service.asked.count("show")
    publish_and_see(shown, service, 2.0)
    assert service.asked.count("show") == asked


def publish_and_see(shown, service, fitness):
    """The spy finds something better; the coordinator does not hear of it."""
    better = Improvement(1, 0, 0.1, 3, 2, fitness, True, {"bits": [1] * 8})
    service.publish(service.keys.best, better.encode())
    until(lambda: of_mine(shown)["fitness"] == fitness)
    assert of_mine(shown)["best"] == vars(better)


@pytest.mark.usefixtures("running")
def test_an_improvement_is_decoded_once(shown, service, monkeypatch):
    decoded, decode = [], Improvement.decode
    monkeypatch.setattr(Improvement, "decode", staticmethod(lambda payload: decoded.append(payload) or decode(payload)))
    service.improve("mine", 3.0)
    until(shown.dashboard.view.improvements)
    service.tell("mine", "waiting")  # what comes after it has been received, too
    until(lambda: shown.dashboard.view.jobs[0]["status"] == "waiting")
    assert len(decoded) == 1


def test_an_answer_that_cannot_be_read_is_said_and_asked_for_again(shown, service, monkeypatch):
    until(lambda: shown.ask("GET", "/healthz")[0] == 200)
    value = service.value
    monkeypatch.setattr(
        service, "value", lambda request: [{}] if isinstance(request, wire.ListJobs) else value(request)
    )
    until(lambda: "cannot be read" in (shown.dashboard.view.trouble or ""))
    assert shown.ask("GET", "/healthz")[0] == 503
    monkeypatch.setattr(service, "value", value)
    until(lambda: shown.ask("GET", "/healthz")[0] == 200)


def test_scripts_are_sent_small(shown):
    for path in ("static/plotly.min.js", "static/job.js"):
        asked = urllib.request.Request(f"http://127.0.0.1:{shown.port}/{path}", headers={"Accept-Encoding": "gzip"})
        with urllib.request.urlopen(asked) as answer:
            small = answer.read()
        assert gzip.decompress(small).decode() == shown.ask("GET", f"/{path}")[2]
