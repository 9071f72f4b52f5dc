"""What clients say to the coordinator and hear of it: there and back, and clear words for whatever is wrong."""

import dataclasses
import math

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wire import jobs
from wire.jobs import (
    MOST_FILE_BYTES,
    MOST_LISTED,
    VERSION,
    Cancel,
    Done,
    Down,
    JobState,
    ListJobs,
    Refused,
    Rewire,
    Show,
    Status,
    Submit,
    Update,
)
from wire.strict import Rejected

ids = st.from_regex(r"[A-Za-z0-9._-]{1,64}", fullmatch=True)
finite = st.floats(allow_nan=False, allow_infinity=False)
words = st.text(st.characters(codec="utf-8"), max_size=40)
plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(1 << 63), (1 << 64) - 1) | finite | words,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=3),
    max_leaves=8,
)
REQUESTS = st.one_of(
    st.builds(Submit, words, st.none() | ids, st.integers(-1_000_000, 1_000_000)),
    st.builds(ListJobs, st.none() | st.integers(0, MOST_LISTED)),
    st.builds(Show, ids),
    st.builds(Cancel, ids),
    st.builds(Update, ids, st.sampled_from(['{"goal": null}', '{"start": [1, 2]}'])),
    st.builds(Rewire, ids, words),
    st.just(Status()),
    st.just(Down()),
)
STATES = st.builds(JobState, ids, st.integers(0, 1 << 60), words, st.none() | finite, st.none() | words, finite)


def refusal(*message):
    """The words with which a request of these parts is refused."""
    with pytest.raises(Rejected) as caught:
        jobs.decode(msgpack.packb(list(message)))
    return caught.value.reason


# There and back -------------------------------------------------------------------------------------------------------
@given(REQUESTS)
def test_a_request_comes_back_as_it_was(request):
    assert jobs.decode(jobs.encode(request)) == request


@given(st.builds(Done, plain) | st.builds(Refused, words, st.sampled_from(["input", "failure"])))
def test_an_answer_comes_back_as_it_was(answer):
    assert jobs.decode_answer(jobs.encode_answer(answer)) == answer


@given(STATES)
def test_a_state_comes_back_as_it_was(state):
    assert JobState.decode(state.encode()) == state


def test_what_a_client_writes_by_hand_is_understood():
    payload = msgpack.packb([1, "submit", {"file": "[]"}])
    assert jobs.decode(payload) == Submit("[]", None, 0)
    assert jobs.decode(msgpack.packb([1, "list", {}])) == ListJobs(None)
    assert jobs.decode(msgpack.packb([1, "down", {}])) == Down()


def test_a_fitness_that_is_not_finite_is_none():
    state = JobState("a", 1, "running", math.inf, None, 2.0)
    assert JobState.decode(state.encode()).fitness is None


def test_words_that_utf8_cannot_say_are_said_as_well_as_can_be():
    assert jobs.decode_answer(jobs.encode_answer(Refused("no \ud800"))) == Refused("no ?")
    assert JobState.decode(JobState("a", 1, "failed", None, "\ud800", 2.0).encode()).message == "?"


# What is refused ------------------------------------------------------------------------------------------------------
def test_another_version_is_told_so():
    expected = "expected a request of protocol version 1, which this cluster speaks, found 7"
    assert refusal(7, "submit", {"file": "[]"}) == expected
    assert refusal(7, {"whatever": "it says"}, 3, 4) == expected
    assert VERSION == 1


@pytest.mark.parametrize("message", [[], [True, "list", {}], ["1", "list", {}]])
def test_no_version_is_told_so(message):
    assert refusal(*message) == "expected a request [version, name, arguments], found no version"


@pytest.mark.parametrize("message", [[1], [1, "list"], [1, "list", []], [1, 2, {}], [1, "list", {}, 3]])
def test_another_shape_is_refused(message):
    assert refusal(*message) == "expected a request [version, name, arguments]"


def test_unknown_requests_and_arguments_are_named():
    assert refusal(1, "solve", {}) == (
        "expected one of submit, list, show, records, logs, cancel, update, rewire, status, down, found 'solve'"
    )
    assert refusal(1, "show", {"id": "a"}) == "show: expected the arguments job, brief, found 'id'"
    assert refusal(1, "down", {"now": True}) == "down: expected no arguments, found 'now'"
    assert refusal(1, "rewire", {"job": "a"}) == "rewire: expected the arguments job, topology, found no topology"


@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        ("submit", {"file": b"[]"}, "submit: file: expected text, found b'[]'"),
        ("submit", {"file": "[]", "priority": True}, "submit: priority: expected a whole number, found True"),
        ("submit", {"file": "[]", "priority": 1 << 40}, "submit: priority: expected a whole number from "),
        ("list", {"limit": -1}, "list: limit: expected a whole number from 0 to 10000, found -1"),
        ("update", {"job": "a", "patch": "[1]"}, "update: patch: expected a JSON object with keys, found '[1]'"),
        ("update", {"job": "a", "patch": "{}"}, "update: patch: expected a JSON object with keys, found '{}'"),
        ("update", {"job": "a", "patch": "{"}, "update: patch: expected a JSON object, found '{'"),
        ("update", {"job": "a", "patch": "[" * 100_000}, "update: patch: expected a JSON object, found '[[["),
        ("rewire", {"job": "a", "topology": "x" * 300}, "rewire: topology: expected at most 256 characters, found 300"),
    ],
)
def test_wrong_arguments_are_refused_in_words(name, arguments, expected):
    assert refusal(1, name, arguments).startswith(expected)


@pytest.mark.parametrize("job", ["", "a b", "a/b", "ä", "x" * 65, "a\n", 7, None, "$*", "**"])
def test_no_job_has_such_an_id(job):
    assert "job: expected a job's id, 1 to 64 of the characters A-Z a-z 0-9 . _ -, found" in refusal(
        1, "show", {"job": job}
    )


def test_a_file_has_its_limit():
    longest = "x" * MOST_FILE_BYTES
    assert jobs.decode(jobs.encode(Submit(longest))) == Submit(longest)
    assert refusal(1, "submit", {"file": longest + "x"}) == (
        f"submit: file: expected at most {MOST_FILE_BYTES} bytes, found {MOST_FILE_BYTES + 1}"
    )
    assert refusal(1, "submit", {"file": "é" * (MOST_FILE_BYTES // 2 + 1)}).startswith("submit: file: expected at most")
    with pytest.raises(Rejected, match="expected a request of at most"):
        jobs.decode(bytes(MOST_FILE_BYTES + (1 << 16)))


@given(st.binary(max_size=300))
def test_noise_is_rejected_and_nothing_worse(payload):
    for read in (jobs.decode, jobs.decode_answer, JobState.decode):
        try:
            read(payload)
        except Rejected as error:
            assert error.reason  # noqa: PT017


@given(plain, plain)
def test_any_arguments_are_understood_or_rejected(name, arguments):
    try:
        jobs.decode(msgpack.packb([1, name, arguments]))
    except Rejected as error:
        assert error.reason  # noqa: PT017


def test_a_state_of_another_version_or_kind_is_rejected():
    good = msgpack.unpackb(JobState("a", 1, "queued", 0.5, None, 2.0).encode())
    for index, wrong in [(0, 2), (0, True), (1, "a b"), (2, -1), (3, None), (4, 1), (4, math.nan), (5, 5), (6, None)]:
        changed = [*good]
        changed[index] = wrong
        with pytest.raises(Rejected):
            JobState.decode(msgpack.packb(changed))


def test_every_argument_has_a_check():
    named = {field.name for request in jobs._REQUESTS.values() for field in dataclasses.fields(request)}
    assert named == jobs._CHECKS.keys()
