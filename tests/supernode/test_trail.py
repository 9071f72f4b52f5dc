"""What a client makes of news that are lost, repeated, late, or of other jobs."""

import dataclasses

import pytest

from supernode.trail import LOOK_EVERY, MOST_KEPT, Trail, improvement_in
from wire.jobs import JobState
from wire.news import Improvement


def better(fitness, job=1, epoch=0):
    return Improvement(job, epoch, 0.5, 4, 3, float(fitness), True, {})


def view(best=None, status="running", number=1):
    return {"job": "a", "number": number, "status": status, "best": best}


def state(status, job="a", number=1):
    return JobState(job, number, status, None, None, 0.0)


def fitnesses(trail):
    return [each.fitness for each in trail.improvements]


@pytest.fixture
def trail():
    return Trail("a", 0.0)


def test_what_came_before_the_number_was_known_is_kept_in_order(trail):
    for each in (better(9), better(5, job=2), better(7)):
        trail.hear_best(each, 0.0)
    assert fitnesses(trail) == []
    trail.hear_state(state("running", job="b", number=2), 0.0)
    assert fitnesses(trail) == []
    trail.hear_state(state("running"), 0.0)
    assert fitnesses(trail) == [9.0, 7.0]


def test_the_first_view_comes_at_its_place_among_the_early_ones(trail):
    trail.hear_best(better(5), 0.0)
    trail.hear_view(view(better(7)), 0.0)
    assert fitnesses(trail) == [7.0, 5.0]


def test_repeated_and_late_ones_are_dropped(trail):
    trail.hear_view(view(better(7)), 0.0)
    for fitness in (7, 5, 6, 5, 4):
        trail.hear_best(better(fitness), 0.0)
    assert fitnesses(trail) == [7.0, 5.0, 4.0]


def test_of_very_many_the_latest_are_kept_and_read_on_from_any(trail):
    trail.hear_state(state("running"), 0.0)
    for epoch in range(3 * MOST_KEPT):
        trail.hear_best(better(5, epoch=epoch), 0.0)
    assert [each.epoch for each in trail.improvements] == list(range(2 * MOST_KEPT, 3 * MOST_KEPT))
    assert trail.after(None).epoch == trail.after(better(1, epoch=7)).epoch == 2 * MOST_KEPT
    assert trail.after(better(5, epoch=2 * MOST_KEPT)).epoch == 2 * MOST_KEPT + 1
    assert trail.after(trail.improvements[-1]) is None


def test_a_later_epoch_begins_anew(trail):
    trail.hear_view(view(better(1)), 0.0)
    trail.hear_best(better(8, epoch=1), 0.0)
    trail.hear_best(better(0, epoch=0), 0.0)
    assert fitnesses(trail) == [1.0, 8.0]
    assert trail.best(1).fitness == 8.0
    assert trail.best(2) is None


def test_an_answer_is_one_that_the_check_accepts(trail):
    trail.hear_view(view(better(9)), 0.0)
    trail.hear_best(better(7, epoch=1), 0.0)
    trail.hear_best(dataclasses.replace(better(3, epoch=1), feasible=False), 0.0)
    assert [trail.best(1).fitness, trail.answer(1).fitness, trail.answer(0).fitness] == [3.0, 7.0, 7.0]
    trail.hear_best(dataclasses.replace(better(8, epoch=2), feasible=False), 0.0)
    assert trail.answer(2) is None


def test_a_job_that_searches_has_begun(trail):
    for status in ("running", "searching", "waiting"):
        trail.hear_state(state(status), 0.0)
    assert trail.begun == 2


def test_a_view_after_the_end_is_the_end_and_brings_what_was_lost(trail):
    trail.hear_view(view(better(7)), 0.0)
    trail.hear_state(state("solved"), 0.2)
    assert trail.end is None
    assert trail.look_at == 0.2
    trail.hear_view(view(better(0), "solved"), 0.3)
    assert trail.end["status"] == "solved"
    assert fitnesses(trail) == [7.0, 0.0]


def test_news_put_off_the_next_look(trail):
    trail.hear_view(view(), 5.0)
    assert trail.look_at == 5.0 + LOOK_EVERY
    trail.hear_best(better(3), 5.5)
    assert trail.look_at == 5.5 + LOOK_EVERY
    trail.hear_best(better(2, job=2), 5.9)
    assert trail.look_at == 5.5 + LOOK_EVERY


def test_an_improvement_of_show():
    told = vars(better(2)) | {"fitness": None, "more": 1}
    assert improvement_in(told).fitness == float("inf")
    with pytest.raises((KeyError, TypeError)):
        improvement_in({"fitness": 1.0})
