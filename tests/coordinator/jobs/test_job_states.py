"""The life of a job: what may follow what."""

from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coordinator.jobs.states import ENDS, TRANSITIONS, State, WrongTransition, follow, state_of
from spy.judgement import Status

STATES = get_args(State)


def test_the_table_speaks_of_every_state():
    assert set(TRANSITIONS) == set(STATES)
    assert set().union(*TRANSITIONS.values()) == set(STATES) - {"submitted"}


def test_every_way_that_a_run_ends_is_an_end_and_nothing_follows():
    assert set(get_args(Status)) == ENDS
    assert all(not TRANSITIONS[end] for end in ENDS)


def test_every_job_can_end_from_wherever_it_is():
    reached = set(ENDS)
    while more := {state for state in STATES if TRANSITIONS[state] & reached} - reached:
        reached |= more
    assert reached == set(STATES)


@pytest.mark.parametrize(
    "life",
    [
        "submitted queued preparing running solved",
        "submitted queued cancelled",
        "submitted queued preparing deadline",
        "submitted queued preparing running waiting running waiting cancelled",
        "submitted queued preparing running searching waiting running searching running deadline",
        "submitted queued preparing running waiting searching waiting cancelled",
        "submitted queued preparing searching queued preparing searching exhausted",
        "submitted queued preparing queued preparing running queued preparing running exhausted",
    ],
)
def test_lives_of_jobs(life):
    now, *later = life.split()
    for then in later:
        now = follow(now, then)
    assert now == life.split()[-1]


@pytest.mark.parametrize(
    ("now", "then"),
    [
        ("queued", "running"),
        ("submitted", "solved"),
        ("queued", "solved"),
        ("waiting", "stalled"),
        ("queued", "searching"),
    ],
)
def test_no_short_cuts(now, then):
    with pytest.raises(WrongTransition, match=f"after '{now}' comes .*, not '{then}'"):
        follow(now, then)


@given(st.sampled_from(sorted(ENDS)), st.sampled_from(STATES) | st.text())
def test_nothing_follows_an_end(end, then):
    with pytest.raises(WrongTransition, match="nothing more"):
        follow(end, then)


@given(st.sampled_from(STATES), st.sampled_from(STATES))
def test_what_is_in_the_table_is_allowed_and_nothing_else(now, then):
    if then in TRANSITIONS[now]:
        assert follow(now, then) == then
    else:
        with pytest.raises(WrongTransition):
            follow(now, then)


def test_names_of_states():
    assert [state_of(each) for each in STATES] == list(STATES)
    with pytest.raises(WrongTransition, match="no state 'Queued'"):
        state_of("Queued")
