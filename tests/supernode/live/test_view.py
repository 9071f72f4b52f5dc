"""What a dashboard makes of what it hears."""

import json
import math
from dataclasses import replace

import pytest

from supernode.live import view as module
from supernode.live.view import View, shape_of, wraps
from wire.keys import Keys
from wire.news import Counters, Improvement, LogRecord, Statistics

KEYS = Keys("c")


class Clock:
    now = 1000.0

    def monotonic(self):
        return self.now

    def time(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    return clock


@pytest.fixture
def view(clock):
    view = View()
    view.begin()
    for node in range(4):
        view.hear_life(KEYS.life(node, 100 + node), True)
    return view


def states(view):
    return view.snapshot()["nodes"]["state"]


def words(view):
    return [line["text"] for line in view.snapshot()["lines"]]


def counters(node, best=0.5):
    return Counters(node, node, 7, 0, 3, 40, 5, 6, 0, 1, best, 0.7, float("inf"), 0.25, 2, 99, 0.01)


def test_who_is_there_at_the_beginning_is_alive(view):
    assert states(view) == ["alive"] * 4


@pytest.mark.parametrize("token", [f"{KEYS.node(2)}/life/x", f"{KEYS.spy}/life/x", "supernode/c/node/x/life/7"])
def test_a_token_of_no_process_is_ignored(view, token):
    view.hear_life(token, True)
    view.hear_life(token, False)
    assert states(view) == ["alive"] * 4


def test_a_death_is_shown_though_the_node_is_replaced_at_once(view, clock):
    view.hear_life(KEYS.life(2, 102), False)
    view.hear_life(KEYS.life(2, 202), True)
    assert states(view)[2] == "dead"
    clock.now += module.SHOWN_FOR + 0.1
    assert states(view)[2] == "joining"
    clock.now += module.SHOWN_FOR
    assert states(view)[2] == "alive"
    assert words(view) == ["node 2 is dead", "node 2 is alive again"]


def test_the_order_of_tokens_does_not_matter(view):
    view.hear_life(KEYS.life(2, 202), True)
    view.hear_life(KEYS.life(2, 102), False)
    assert states(view)[2] == "dead"
    assert view.node(2)["process"] == "202"


def test_a_node_that_nobody_replaces_stays_dead(view, clock):
    view.hear_life(KEYS.life(2, 102), False)
    clock.now += 100
    assert states(view)[2] == "dead"
    assert view.alive() == 3


def test_tokens_that_dropped_with_the_router_were_no_deaths(view):
    for node in range(4):
        view.hear_life(KEYS.life(node, 100 + node), False)
    assert states(view) == ["dead"] * 4
    for node in range(4):
        view.hear_life(KEYS.life(node, 100 + node), True)
    assert view.node(0)["deaths"] == 0
    assert "dead" not in states(view)


def test_a_node_that_comes_later_is_joining(view, clock):
    clock.now += 60
    view.hear_life(KEYS.life(4, 104), True)
    assert states(view)[4] == "joining"


def test_a_snapshot_of_a_thousand_nodes_is_small_and_plain_json(view):
    for node in range(1024):
        view.hear_life(KEYS.life(node, 100 + node), True)
    view.hear_counters(*Counters.encode_all(counters(node, float("inf")) for node in range(1024)))
    text = json.dumps(view.snapshot(), allow_nan=False)
    assert len(text) < 100_000
    assert (view.snapshot()["rows"], view.snapshot()["columns"]) == (32, 32)


def told(view, node):
    return {name: column[node] for name, column in view.snapshot()["nodes"].items()}


def test_a_job_that_has_ended_is_not_on_the_nodes_any_more(view):
    job = {"number": 7, "job": "a", "status": "running", "cells": 4, "topology": "torus 1x4"}
    view.hear_jobs([job])
    view.hear_counters(*Counters.encode_all([counters(2)]))
    assert (told(view, 2)["best"], view.node(2)["job"]) == (0.5, "a")
    view.hear_jobs([job | {"status": "solved"}])
    assert (told(view, 2)["best"], view.node(2)["job"]) == (None, None)
    assert "generation" not in view.node(2)


def test_a_node_stands_at_its_number_though_one_before_it_has_left(view):
    view.hear_life(KEYS.life(1, 101), False)
    view.hear_status({"cluster": "c", "jobs": {}, "nodes": [{"node": node} for node in (0, 2, 3)]})
    assert view.snapshot()["nodes"]["node"] == [0, 1, 2, 3]
    assert states(view) == ["alive", "absent", "alive", "alive"]


def test_a_node_that_came_while_the_cluster_was_asked_stays(view, clock):
    clock.now += 60
    view.hear_life(KEYS.life(4, 104), True)
    view.hear_status({"cluster": "c", "jobs": {}, "nodes": [{"node": node} for node in range(4)]})
    clock.now += module.SHOWN_FOR
    view.hear_status({"cluster": "c", "jobs": {}, "nodes": [{"node": node} for node in range(5)]})
    assert states(view) == ["alive"] * 5


def test_a_number_that_no_node_has_costs_nothing(view):
    view.hear_life(KEYS.life(1 << 40, 1), True)
    view.hear_counters(*Counters.encode_all([counters(1 << 40)]))
    assert states(view) == ["alive"] * 4


def statistics(job):
    return Statistics(job, *[0] * 8, 0.0, 0.0, 0.0, 0.0, 0, 0.0, 0.01)


def test_how_jobs_are_is_told_of_those_that_run(view):
    view.hear_jobs([{"number": 7, "job": "a", "status": "running", "cells": 4, "topology": "torus 1x4"}])
    assert view.running() == {}
    view.hear_statistics(statistics(7).encode())
    assert view.running() == {"a": statistics(7)}
    assert (view.snapshot()["rows"], view.snapshot()["columns"]) == (1, 4)
    view.hear_jobs([{"number": 7, "job": "a", "status": "solved", "cells": 4, "topology": "torus 1x4"}])
    assert view.running() == {}
    assert words(view) == ["job a: solved"]


def test_jobs_are_counted_with_the_list_if_it_is_all_of_them(view):
    job = {"number": 7, "job": "a", "status": "running", "cells": 4, "topology": "torus 1x4"}
    view.hear_status({"cluster": "c", "jobs": {"solved": 500, "running": 1}, "nodes": []})
    view.hear_jobs([job])
    assert view.snapshot()["counts"] == {"solved": 500, "running": 1}
    view.hear_jobs([job, job | {"number": 8, "status": "queued"}], all_of_them=True)
    assert view.snapshot()["counts"] == {"running": 1, "queued": 1}


def test_what_is_kept_of_jobs_is_bounded(view):
    for job in range(1000):
        view.hear_statistics(statistics(job).encode())
    assert len(view.statistics) < 100


@pytest.mark.parametrize(
    ("spec", "shape", "around"),
    [
        ("torus 2x8", (2, 8), True),
        ("moore 2x8", (2, 8), True),
        ("grid 3x4", (3, 4), False),
        ("ring 16", (4, 4), False),
    ],
)
def test_each_topology_is_drawn_in_rows_and_columns(spec, shape, around):
    assert (shape_of(spec), wraps(spec)) == (shape, around)


def test_news_come_as_often_as_nodes_tell_and_at_once_when_one_has_gone(view, clock):
    for node in range(1024):
        view.hear_life(KEYS.life(node, 100 + node), True)
    assert "nodes" in view.news()
    shown = []
    for _ in range(12):
        clock.now += 1.0
        shown.append(view.news() is not None)
    assert shown == [False, False, False, True] * 3
    view.hear_life(KEYS.life(7, 107), False)
    assert view.news()["nodes"]["state"][7] == "dead"
    assert view.news() is None


def test_what_is_said_of_jobs_is_news_at_once(view, clock):
    for node in range(1024):
        view.hear_life(KEYS.life(node, 100 + node), True)
    view.news()
    view.hear_log(LogRecord("warning", "node 3", "a message was refused", 1e9).encode())
    assert view.news()["lines"][-1]["text"] == "node 3: a message was refused"
    view.lost("the cluster is away")
    told = view.news()
    assert (told["answers"], "nodes" in told) == (False, False)
    view.found()
    assert view.news()["answers"]
    view.found()
    assert view.news() is None


def test_few_nodes_are_shown_each_second(view, clock):
    view.hear_life(KEYS.life(0, 100), True)
    for _ in range(5):
        clock.now += 1.0
        assert "nodes" in view.news()


def test_whoever_asks_for_a_snapshot_takes_no_news_from_others(view, clock):
    for node in range(1024):
        view.hear_life(KEYS.life(node, 100 + node), True)
    view.news()
    view.hear_life(KEYS.life(7, 107), False)
    assert view.snapshot()["nodes"]["state"][7] == "dead"
    assert view.snapshot()["nodes"]["state"][7] == "dead", "with all nodes each time"
    assert view.news()["nodes"]["state"][7] == "dead"


BETTER = Improvement(7, 1, 0.1, 3, 2, 0.5, True, {"x": 1.5})
WORSE = replace(BETTER, fitness=0.75)
TOLD = {"number": 7, "epoch": 1, "best": None, "fitness": None}


def test_an_improvement_is_news_at_once(view):
    for node in range(1024):
        view.hear_life(KEYS.life(node, 100 + node), True)
    view.news()
    view.hear_improvement(BETTER)
    assert "nodes" not in view.news()
    assert [each.improvement for each in view.improvements().values()] == [BETTER]
    assert view.news() is None


def test_what_the_cluster_says_of_a_job_is_completed_by_what_it_has_not_heard_yet(view):
    assert view.completed(TOLD) == TOLD
    view.hear_improvement(BETTER)
    best = {"job": 7, "epoch": 1, "seconds": 0.1, "generation": 3, "cell": 2, "fitness": 0.5, "feasible": True}
    best["solution"] = {"x": 1.5}
    for known in (None, vars(WORSE), vars(replace(BETTER, epoch=0, fitness=0.1)), vars(WORSE) | {"fitness": None}):
        assert view.completed(TOLD | {"best": known}) == TOLD | {"best": best, "fitness": 0.5}


@pytest.mark.parametrize("known", [vars(BETTER), vars(replace(BETTER, fitness=0.25)), vars(replace(BETTER, epoch=2))])
def test_what_the_cluster_knows_better_stays(view, known):
    view.hear_improvement(BETTER)
    told = TOLD | {"best": known, "fitness": known["fitness"]}
    assert view.completed(told) == told


@pytest.mark.parametrize("other", [{"number": 8}, {"epoch": 0}, {"epoch": 2}])
def test_an_improvement_of_another_job_or_epoch_is_not_mixed_in(view, other):
    view.hear_improvement(BETTER)
    assert view.completed(TOLD | other) == TOLD | other


def test_an_improvement_without_a_fitness_that_a_number_can_say_is_plain(view):
    view.hear_improvement(replace(BETTER, fitness=math.inf))
    assert view.completed(TOLD)["fitness"] is None
    json.dumps([view.completed(TOLD), view.improvements()[7].plain()], allow_nan=False)


def test_a_new_link_may_be_to_another_cluster_whose_jobs_have_the_same_numbers(view):
    view.hear_improvement(BETTER)
    view.begin()
    assert view.completed(TOLD) == TOLD


def test_a_fitness_is_no_reason_to_ask_the_cluster_but_an_epoch_is(view):
    job = {"number": 7, "job": "a", "status": "running", "cells": 4, "topology": "torus 1x4", "fitness": None}
    view.hear_jobs([job])
    view.hear_improvement(WORSE)
    known = view.heard_of("a")
    view.hear_improvement(BETTER)
    view.hear_jobs([job | {"fitness": 0.5}])
    assert view.heard_of("a") == known
    view.hear_improvement(replace(BETTER, epoch=2))
    assert view.heard_of("a") != known
