"""Whether a run that stalls begins anew, and after how many generations it counts as stalled."""

import pytest
from one_max import OneMax

from node.plan import Plan
from problems import BadInput, Run


class Trying(OneMax):
    """Has ideas for some attempts."""

    ideas: int = 10**9
    reachable: bool = True

    @property
    def solved_at(self):
        return 0.0 if self.reachable else None

    def next_attempt(self, attempt):
        return {"size": 40 + attempt} if attempt <= self.ideas else None


class Broken(OneMax):
    """Says something that is no table."""

    def next_attempt(self, attempt):
        return {"size": {1}}


def plan(attempt=0, kind=Trying, ideas=10**9, reachable=True, **run):
    fields = {"ideas": ideas, "reachable": reachable} if kind is Trying else {}
    return Plan(kind(kind="trying", **fields), Run(**run), attempt=attempt)


@pytest.mark.parametrize(
    ("settings", "attempt", "fields"),
    [
        ({}, 0, {"size": 41}),
        ({}, 7, {"size": 48}),
        ({}, 8, None),
        ({"stall": 5}, 8, None),
        ({"seconds": 9.0}, 8, {"size": 49}),
        ({"generations": 9}, 8, {"size": 49}),
        ({"evaluations": 9}, 8, {"size": 49}),
        ({"ideas": 2}, 2, None),
        ({"ideas": 2, "seconds": 9.0}, 2, None),
        ({"restarts": 0}, 0, None),
        ({"restarts": 1}, 0, {"size": 41}),
        ({"restarts": 1}, 1, None),
        ({"restarts": 20}, 19, {"size": 60}),
        ({"restarts": 20, "ideas": 2}, 2, {}),
        ({"reachable": False}, 0, None),
        ({"reachable": False, "target": -1.0}, 0, {"size": 41}),
        ({"reachable": False, "restarts": 1}, 0, {"size": 41}),
        ({"kind": OneMax}, 0, None),
        ({"kind": OneMax, "restarts": 1}, 0, {}),
        ({"keep_alive": True}, 8, {"size": 49}),
        ({"keep_alive": True, "restarts": 0, "kind": OneMax, "reachable": False}, 1000, {}),
    ],
    ids=str,
)
def test_the_fields_of_the_next_attempt(settings, attempt, fields):
    assert plan(attempt, **settings).next_attempt == fields


@pytest.mark.parametrize(
    ("settings", "attempt", "stall"),
    [
        ({}, 0, 200),
        ({}, 8, 200),
        ({"stall": 7}, 0, 7),
        ({"stall": 7, "seconds": 9.0, "kind": OneMax}, 0, 7),
        ({"seconds": 9.0}, 0, 200),
        ({"generations": 9}, 0, 200),
        ({"evaluations": 9}, 0, 200),
        ({"seconds": 9.0, "ideas": 1}, 1, None),
        ({"seconds": 9.0, "restarts": 1, "kind": OneMax}, 0, 200),
        ({"seconds": 9.0, "restarts": 1, "kind": OneMax}, 1, None),
        ({"seconds": 9.0, "restarts": 0}, 0, None),
        ({"seconds": 9.0, "kind": OneMax}, 0, None),
        ({"seconds": 9.0, "keep_alive": True, "kind": OneMax}, 50, 200),
        ({"seconds": 9.0, "keep_alive": True, "reachable": False}, 0, None),
        ({"keep_alive": True, "reachable": False}, 0, 200),
    ],
    ids=str,
)
def test_a_stall_counts_where_it_ends_the_run_or_leads_to_another_attempt(settings, attempt, stall):
    assert plan(attempt, **settings).stall == stall


def test_limits_may_leave_no_room_for_another_attempt():
    assert plan().leaves_room(10**6)
    assert [plan(generations=90).leaves_room(lived) for lived in (89, 90)] == [True, False]
    # 16 cells evaluate 16 individuals first in each epoch, and 128 in each generation.
    at_most = plan(evaluations=2 * 16 + 128 * 7)
    assert [at_most.leaves_room(lived) for lived in (6, 7)] == [True, False]


def test_what_is_no_table_of_plain_values_is_refused():
    with pytest.raises(BadInput, match="trying: next_attempt must return plain JSON values"):
        _ = plan(kind=Broken).next_attempt
