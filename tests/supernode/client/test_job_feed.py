"""What a client makes of news that are lost, repeated, late, or of other jobs."""

import dataclasses

import pytest

from supernode.client.job_feed import LOOK_EVERY, MOST_KEPT, JobFeed, improvement_in
from wire.jobs import JobState
from wire.news import Improvement


def better(fitness, job=1, epoch=0):
    return Improvement(job, epoch, 0.5, 4, 3, float(fitness), True, {})


def view(best=None, status="running", number=1):
    return {"job": "a", "number": number, "status": status, "best": best}


def state(status, job="a", number=1):
    return JobState(job, number, status, None, None, 0.0)


def fitnesses(feed):
    return [each.fitness for each in feed.improvements]


@pytest.fixture
def feed():
    return JobFeed("a", 0.0)


def test_what_came_before_the_number_was_known_is_kept_in_order(feed):
    for each in (better(9), better(5, job=2), better(7)):
        feed.hear_best(each, 0.0)
    assert fitnesses(feed) == []
    feed.hear_state(state("running", job="b", number=2), 0.0)
    assert fitnesses(feed) == []
    feed.hear_state(state("running"), 0.0)
    assert fitnesses(feed) == [9.0, 7.0]


def test_the_first_view_comes_at_its_place_among_the_early_ones(feed):
    feed.hear_best(better(5), 0.0)
    feed.hear_view(view(better(7)), 0.0)
    assert fitnesses(feed) == [7.0, 5.0]


def test_repeated_and_late_ones_are_dropped(feed):
    feed.hear_view(view(better(7)), 0.0)
    for fitness in (7, 5, 6, 5, 4):
        feed.hear_best(better(fitness), 0.0)
    assert fitnesses(feed) == [7.0, 5.0, 4.0]


def test_of_very_many_the_latest_are_kept_and_read_on_from_any(feed):
    feed.hear_state(state("running"), 0.0)
    for epoch in range(3 * MOST_KEPT):
        feed.hear_best(better(5, epoch=epoch), 0.0)
    assert [each.epoch for each in feed.improvements] == list(range(2 * MOST_KEPT, 3 * MOST_KEPT))
    assert feed.after(None).epoch == feed.after(better(1, epoch=7)).epoch == 2 * MOST_KEPT
    assert feed.after(better(5, epoch=2 * MOST_KEPT)).epoch == 2 * MOST_KEPT + 1
    assert feed.after(feed.improvements[-1]) is None


def test_a_later_epoch_begins_anew(feed):
    feed.hear_view(view(better(1)), 0.0)
    feed.hear_best(better(8, epoch=1), 0.0)
    feed.hear_best(better(0, epoch=0), 0.0)
    assert fitnesses(feed) == [1.0, 8.0]
    assert feed.best(1).fitness == 8.0
    assert feed.best(2) is None


def test_an_answer_is_one_that_the_check_accepts(feed):
    feed.hear_view(view(better(9)), 0.0)
    feed.hear_best(better(7, epoch=1), 0.0)
    feed.hear_best(dataclasses.replace(better(3, epoch=1), feasible=False), 0.0)
    assert [feed.best(1).fitness, feed.answer(1).fitness, feed.answer(0).fitness] == [3.0, 7.0, 7.0]
    feed.hear_best(dataclasses.replace(better(8, epoch=2), feasible=False), 0.0)
    assert feed.answer(2) is None


def test_a_job_that_searches_has_begun(feed):
    for status in ("running", "searching", "waiting"):
        feed.hear_state(state(status), 0.0)
    assert feed.begun == 2


def test_a_view_after_the_end_is_the_end_and_brings_what_was_lost(feed):
    feed.hear_view(view(better(7)), 0.0)
    feed.hear_state(state("solved"), 0.2)
    assert feed.end is None
    assert feed.look_at == 0.2
    feed.hear_view(view(better(0), "solved"), 0.3)
    assert feed.end["status"] == "solved"
    assert fitnesses(feed) == [7.0, 0.0]


def test_news_put_off_the_next_look(feed):
    feed.hear_view(view(), 5.0)
    assert feed.look_at == 5.0 + LOOK_EVERY
    feed.hear_best(better(3), 5.5)
    assert feed.look_at == 5.5 + LOOK_EVERY
    feed.hear_best(better(2, job=2), 5.9)
    assert feed.look_at == 5.5 + LOOK_EVERY


def test_an_improvement_of_show():
    told = vars(better(2)) | {"fitness": None, "more": 1}
    assert improvement_in(told).fitness == float("inf")
    with pytest.raises((KeyError, TypeError)):
        improvement_in({"fitness": 1.0})
