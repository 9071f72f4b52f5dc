"""Processes of a cluster are killed while a job begins anew again and again: it goes on, and none of it is lost."""

from dataclasses import replace
from pathlib import Path

import epochs
import pytest
from live_service import live, until
from stubborn import stubborn_file

import supernode
from node.replay import replay
from problems import BadInput
from problems.file import parse

pytestmark = pytest.mark.timeout(300)


def endless(**run):
    """Never solved, so it begins anew as often as it stalls."""
    fields = 'kind = "function"\nname = "onemax"\ndimension = 64\ncost_us = 200\n'
    return parse(fields, "restarts", Path()).with_run(topology="torus 2x3", target=-1.0, stall=20, **run)


def history(file, result):
    """What `spy.result` makes of all epochs in which nobody died, replayed in this process."""
    return epochs.history(replay(replace(file, fields=file.fields | {"cost_us": 0.0}), result.directives))


def retries(job):
    return [each for each in job.show()["epochs"] if each["do"] == "retry"]


def goes_on(job):
    """Wait until it has begun anew twice more: once it may have been about to."""
    known = len(retries(job))
    until(lambda: len(retries(job)) >= known + 2)


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    folder = tmp_path_factory.mktemp("restarts")
    stubborn_file(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)  # where modules are looked for
        with live(folder / "state", "torus 2x3", "--allow-module", "stubborn_module") as service:
            yield service


@pytest.mark.parametrize(
    "run", [{"restarts": 10**6}, {"keep_alive": True}, {"restarts": 10**6, "mode": "async"}], ids=str
)
def test_whatever_is_killed_it_begins_anew_again(service, run):
    file = endless(**run)
    with service.connect() as client:
        job = client.submit(file)
        goes_on(job)
        for victim in ("coordinator", "spy", "node 4", "router", "coordinator", "node 0"):
            service.kill(victim)
            goes_on(job)
        assert job.state() == ("searching" if "keep_alive" in run else "running")
        told = [each["attempt"] for each in retries(job)]
        job.cancel()
        result = job.result(60)
    assert (result.status, result.message) == ("cancelled", None)
    assert told == list(range(1, len(told) + 1)), "each attempt once"
    assert {"retry"} <= {each["do"] for each in result.directives} <= {"retry", "replace", "stop"}
    assert result.found_at is not None
    if file.run.mode == "lockstep":
        assert result.history_sha256 == history(file, result)


def test_who_takes_over_knows_what_attempts_have_changed(service, tmp_path):
    file = supernode.load(stubborn_file(tmp_path, hurdles=99)).with_run(topology="torus 2x3", restarts=10**6, stall=60)
    with service.connect() as client:
        job = client.submit(file)
        goes_on(job)
        service.kill("coordinator")
        goes_on(job)
        *_, latest = retries(job)
        job.cancel()
        result = job.result(60)
    assert latest["fields"] == {"size": 16 + 8 * latest["attempt"], "hurdles": 99 - latest["attempt"]}
    assert result.problem_sha256 == file.sha256
    assert result.history_sha256 == epochs.again(file, result)


def test_a_job_is_not_submitted_in_the_middle_of_its_attempts(service):
    with service.connect() as client, pytest.raises(BadInput, match="found one that was tried before"):
        client.submit(endless().next_attempt({}))


def test_an_answer_uses_its_time_while_the_job_searches(service, tmp_path):
    file = supernode.load(stubborn_file(tmp_path, hurdles=99))
    with service.connect() as client:
        job = client.submit(file, topology="torus 2x3", keep_alive=True, stall=25)
        until(lambda: job.state() == "searching")
        assert job.answer(1.0) is None, "nothing that the check accepts"
        job.update(hurdles=1)
        assert job.answer(60.0).fitness == 0.0
        assert job.state() == "waiting"
        job.cancel()
        assert job.result(30).feasible
