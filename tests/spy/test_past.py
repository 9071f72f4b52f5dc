"""What epochs that have ended come to: nothing is lost by adding them up, and it does not grow for ever."""

from dataclasses import replace

import pytest

from problems import ProblemFile, Run
from spy import past as of_past
from spy.judgement import Judgement
from spy.past import Lived, Past
from spy.result import Clocks, result_of
from wire.champion import Champion
from wire.report import Report, Staleness


def report(cell=0, generation=9, staleness=(0, 0, 0, 0)):
    return Report(
        cell=cell,
        generation=generation,
        digest=bytes([cell, generation]) * 16,
        evaluations=73,
        sent=9,
        received=36,
        lost=0,
        rejected=1,
        staleness=Staleness(*staleness),
        champion=None,
        proposals=(),
        births=(),
        deme=b"",
        state=b"",
        error=None,
    )


def knowing(fitness, cell=0, generation=7):
    return replace(report(cell), champion=Champion(fitness, generation, cell, b"\x2a"))


def lived(number=0, reports=None, mode="lockstep"):
    file = ProblemFile("x", {"kind": "x:Y"}, Run(topology="torus 1x2", mode=mode), "")
    return Lived(file, [report(1), report(0)] if reports is None else reports, number)


def update(number):
    return {"do": "update", "fields": {"goal": number}}


RETRY = {"do": "retry", "attempt": 1, "seed": 9, "fields": {"commands": 9}}
REWIRE = {"do": "rewire", "topology": "ring 2"}


def result(epoch, past=None):
    judgement = Judgement("stalled", False, None, None)
    return result_of("1", epoch.file.run, past or Past(), epoch, judgement, {}, Clocks(1.0, 2.0, 3.0))


def test_generations_evaluations_and_messages_are_added_up_and_directives_say_how_it_went_on():
    past = Past().and_then(lived(0), update(1)).and_then(lived(1, [report(0, 4), report(1, 4)]), update(2))
    assert (past.epochs, past.generations, past.evaluations) == (2, 13, 4 * 73)
    assert (past.messages.sent, past.messages.received, past.messages.rejected) == (36, 144, 4)
    assert [(each["epoch"], each["generation"]) for each in past.directives] == [(1, 9), (2, 4)]
    last = result(lived(2), past)
    assert (last.generations, last.evaluations, len(last.directives)) == (22, 6 * 73, 2)


def test_the_history_is_that_of_all_epochs_whatever_the_order_of_reports():
    one = Past().and_then(lived(0, [report(0), report(1)]), update(1))
    other = Past().and_then(lived(0, [report(1), report(0)]), update(1))
    assert one.history == other.history
    other = Past().and_then(lived(0, [report(0, 8), report(1, 8)]), update(1))
    assert len({one.history, one.and_then(lived(1)).history, other.history, None}) == 4


MISSING = [lived(0, [report(0)]), lived(0, []), lived(1), lived(0, [report(0, 9), report(1, 8)])]


@pytest.mark.parametrize("epoch", MISSING, ids=["a cell", "all", "an epoch", "one that halted on the way"])
def test_a_history_that_lacks_something_is_none(epoch):
    past = Past().and_then(epoch, update(epoch.number + 1))
    assert past.history is None
    assert result(lived(past.epochs), past).history_sha256 is None


def test_an_epoch_that_a_node_died_in_counts_from_the_furthest_and_is_no_part_of_the_history():
    past = Past().and_then(lived(0, [report(0, 9), report(1, 11)]), {"do": "replace"})
    assert (past.generations, past.history) == (11, "")


def test_it_comes_back_from_json_whole_but_for_the_directives():
    past = Past().and_then(lived(0, [knowing(0.5), report(1, 9, (3, 2, 1, 0))]), REWIRE)
    assert past.champion.genome == b"\x2a"
    again = Past.from_json(past.to_json())
    assert again != past
    assert again.led_on(past.directives[0]) == past


def test_the_best_of_epochs_of_one_problem_is_known_until_it_changes():
    past = Past().and_then(lived(0, [knowing(0.5), knowing(0.25, 1)]), REWIRE)
    assert (past.champion.fitness, past.champion.cell) == (0.25, 1)
    assert past.or_better(lived(1, [knowing(0.3)])) == past.champion._replace(generation=0)
    assert past.or_better(lived(1, [knowing(0.25)])).generation == 7, "who has it now comes first"
    assert past.or_better(lived(1, [knowing(0.1)])).fitness == 0.1
    assert past.and_then(lived(1, [knowing(0.1)]), {"do": "replace"}).champion == past.champion
    assert past.and_then(lived(1, [knowing(0.1)]), update(2)).champion is None
    assert past.and_then(lived(1, [knowing(0.1)]), RETRY).champion is None, "it may be coded otherwise"


def test_many_directives_are_put_together_and_what_they_come_to_is_kept(monkeypatch):
    monkeypatch.setattr(of_past, "MOST_BYTES", 2000)
    past = Past()
    for number in range(200):
        past = past.and_then(lived(number), update(number + 1) | {"fields": {"goal": number, f"only {number % 3}": 1}})
        assert past.text_bytes == sum(len(text) for text in past.texts) <= 2000
    assert past.generations == sum(each["generation"] for each in past.directives) == 200 * 9
    assert past.directives[0]["do"] == "several"
    merged = {}
    for directive in past.directives:
        merged |= directive["fields"]
    assert merged == {"goal": 199, "only 0": 1, "only 1": 1, "only 2": 1}
    assert [each["epoch"] for each in past.directives[1:]] == list(range(201 - len(past.directives) + 1, 201))


def test_what_attempts_change_is_not_put_together_with_updates(monkeypatch):
    monkeypatch.setattr(of_past, "MOST_BYTES", 600)
    past = Past().and_then(lived(0), update(1))
    for number in range(1, 20):
        past = past.and_then(lived(number), RETRY)
    together = past.directives[0]
    assert (together["do"], together["fields"]) == ("several", {"goal": 1})


def test_staleness_is_over_all_immigrants_of_all_cells():
    reports = [report(0, 9, (30, 15, 7, 3)), report(1, 9, (10, 5, 4, 7))]
    assert result(lived(0, reports, "async")).staleness == {"mean": 0.5, "max": 7, "again": 0.25}


@pytest.mark.parametrize("reports", [[], [report()]])
def test_without_immigrants_there_is_none(reports):
    assert result(lived(0, reports, "async")).staleness is None


def test_an_epoch_without_reports_stopped_at_once():
    assert of_past.stopped_after(()) == 0
    assert of_past.lived_for((), halted=False) == of_past.lived_for((), halted=True) == 0
