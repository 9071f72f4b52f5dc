"""Commands, reports and news: there and back, what is refused, and that nothing but a rejection comes of noise."""

import json
import math
from collections import Counter
from typing import get_args

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wire import control
from wire.champion import Champion
from wire.control import (
    Answer,
    Begin,
    Command,
    Done,
    Drop,
    Finish,
    Halt,
    Judged,
    Look,
    Missed,
    Prepare,
    ProposeStop,
    Refused,
    TellStates,
    Wiring,
)
from wire.exchange import VERSION
from wire.news import LEVELS, Counters, Improvement, LogRecord, Statistics
from wire.report import MOST_BIRTHS, Birth, Proposal, Reason, Report, Staleness
from wire.strict import Rejected
from wire.takeover import KeptStates, Takeover

counts = st.integers(0, (1 << 62) - 1)
fitnesses = st.floats(allow_nan=False).filter(lambda value: value != -math.inf)
reasons = st.sampled_from(get_args(Reason))
champions = st.builds(Champion, fitnesses, counts, counts, st.binary(max_size=40))
plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@st.composite
def wirings(draw):
    """Of nodes on one host, of which nothing is said, or on several."""
    nodes = draw(st.lists(counts, max_size=5).map(tuple))
    texts = st.tuples(*[st.text(max_size=9)] * len(nodes))
    places = st.just(()) | st.tuples(texts, st.just(()) | texts) if nodes else st.just(())
    return Wiring(draw(counts), nodes, *draw(places))


COMMANDS = st.one_of(
    st.builds(
        Prepare,
        counts,
        counts,
        st.text(),
        wirings(),
        st.none() | counts,
        st.binary(max_size=100),
        st.binary(max_size=100),
        counts,
        st.booleans(),
        st.none() | st.builds(Takeover, counts, st.binary(max_size=100), st.booleans(), st.none() | counts),
    ),
    st.builds(Begin, counts, counts),
    st.builds(TellStates, counts, counts),
    st.builds(ProposeStop, counts, counts, reasons),
    st.builds(Halt, counts, counts),
    st.builds(Look, counts),
    st.builds(Drop, counts),
    st.builds(Missed, counts, counts, counts),
    st.builds(
        Finish,
        counts,
        counts,
        st.none() | champions,
        counts,
        st.lists(reasons, max_size=3).map(tuple),
        st.none() | st.text(),
        st.lists(st.tuples(counts, st.binary(max_size=40)), max_size=3).map(tuple),
        counts,
    ),
)
metres = st.floats(allow_nan=False, allow_infinity=False)
wheres = st.dictionaries(st.text(), st.none() | metres | st.integers() | st.lists(metres, max_size=3), max_size=3)
ANSWERS = st.one_of(
    st.builds(
        KeptStates,
        counts,
        counts,
        counts,
        st.lists(st.tuples(counts, counts, st.binary(max_size=100)), max_size=3).map(tuple),
        st.lists(st.tuples(counts, counts), max_size=3).map(tuple),
        st.none() | counts,
    ),
    st.builds(Done, st.text()),
    st.builds(Refused, st.text(), st.sampled_from(["input", "failure", "stranger"])),
    st.builds(
        Judged,
        st.text(),
        st.booleans(),
        st.none() | st.text(),
        st.none() | st.binary(max_size=40),
        st.none() | st.text(),
        st.none() | st.floats(allow_nan=False),
        st.none()
        | st.fixed_dictionaries({"least": st.none() | metres, "where": wheres, "required": metres, "unit": st.text()}),
        st.none() | st.text(),
        st.none() | st.text(),
    ),
)
REPORTS = st.builds(
    Report,
    cell=counts,
    generation=counts,
    digest=st.binary(max_size=32),
    evaluations=counts,
    sent=counts,
    received=counts,
    lost=counts,
    rejected=counts,
    staleness=st.builds(Staleness, counts, counts, counts, counts),
    champion=st.none() | champions,
    proposals=st.lists(st.builds(Proposal, counts, reasons, counts, counts), max_size=3).map(tuple),
    births=st.lists(st.builds(Birth, counts, counts, fitnesses.filter(math.isfinite)), max_size=3).map(tuple),
    deme=st.binary(max_size=100),
    state=st.binary(max_size=100),
    error=st.none() | st.text(),
    halted=st.booleans(),
)
IMPROVEMENTS = st.builds(
    Improvement,
    counts,
    counts,
    fitnesses,
    counts,
    counts,
    fitnesses,
    st.booleans(),
    st.dictionaries(st.text(), plain, max_size=4),
)

PREPARE = Prepare(
    3, 1, '["x.toml"]', Wiring(4, (2, 0, 1), ("a", "b", ""), ("", "tcp/b:1", "")), 12, b"\x12\x34", b"", 16, anew=True
)
FINISH = Finish(3, 1, Champion(0.5, 7, 2, b"\x12"), 20, ("target", "stall"), None, ((2, b"\x01"),), 12)
REPORT = Report(
    2,
    20,
    bytes(32),
    160,
    20,
    80,
    1,
    0,
    Staleness(80, 9, 3, 2),
    FINISH.champion,
    (Proposal(20, "target", 2, 13),),
    (Birth(0, 2, 3.5), Birth(7, 2, 0.5)),
    b"\x12\x34",
    b"\x56",
    None,
    halted=True,
)
COUNTERS = Counters(*range(1, 11), 0.5, 1.5, 2.5, 0.5, 3, 4, 0.25)
IMPROVEMENT = Improvement(3, 1, 0.25, 7, 2, 0.5, True, {"angles": [0.1, 0.2], "tip": {"x": 1}})

# How each kind of message is read, and one that is right.
JUDGED = Judged(
    "solved",
    True,
    None,
    b"\x12",
    "in words",
    0.5,
    {"least": 0.25, "where": {"link": 2}, "required": 0.0, "unit": "m"},
    None,
    "in each joint",
)
READERS = {
    "command": (control.decode, control.encode(PREPARE)),
    "finish": (control.decode, control.encode(FINISH)),
    "begin": (control.decode, control.encode(Begin(3, 1, 4))),
    "stop": (control.decode, control.encode(ProposeStop(3, 1, "cancel"))),
    "halt": (control.decode, control.encode(Halt(3, 1, 7))),
    "look": (control.decode, control.encode(Look(3))),
    "missed": (control.decode, control.encode(Missed(3, 1, 9))),
    "tell states": (control.decode, control.encode(TellStates(3, 1, wiring=7))),
    "kept states": (
        control.decode_answer,
        control.encode_answer(KeptStates(2, 40, 30, ((1, 32, b"state"),), ((1, 40),), 44)),
    ),
    "answer": (control.decode_answer, control.encode_answer(Done('{"a": 1}'))),
    "refusal": (control.decode_answer, control.encode_answer(Refused("no", "input"))),
    "judgement": (control.decode_answer, control.encode_answer(JUDGED)),
    "report": (Report.decode, REPORT.encode()),
    "improvement": (Improvement.decode, IMPROVEMENT.encode()),
    "counters": (Counters.decode, COUNTERS.encode()),
    "counters of many": (Counters.decode_all, *Counters.encode_all([COUNTERS, COUNTERS])),
    "statistics": (Statistics.decode, Statistics(*range(1, 10), 8.5, 0.5, 1.5, 2.5, 9, 0.25, 0.125).encode()),
    "log": (LogRecord.decode, LogRecord("warning", "node 3", "bad message", 1.75e9, 3, 4, 5, None).encode()),
}
KNOWN_REASONS = {
    "not msgpack",
    "not an array",
    "wrong shape",
    "wrong type",
    "out of bounds",
    "not finite",
    "other version",
    "no such command",
    "no such level",
    "no such answer",
    "no such reason",
    "not JSON",
    "no such time",
}


def reason(read, payload):
    with pytest.raises(Rejected) as caught:
        read(payload)
    return caught.value.reason


def with_field(kind, index, value):
    """A right message of some kind with one field replaced."""
    read, payload = READERS[kind]
    fields = msgpack.unpackb(payload)
    fields[index] = value
    return read, msgpack.packb(fields)


# There and back -------------------------------------------------------------------------------------------------------
@given(COMMANDS)
def test_a_command_comes_back_as_it_was(command):
    again = control.decode(control.encode(command))
    assert again == command
    assert type(again) is type(command)


def test_commands_have_names_of_their_own():
    kinds = get_args(Command)
    assert len({kind.name for kind in kinds}) == len(kinds)


def test_every_command_and_answer_is_tried():
    commands = {type(control.decode(payload)) for read, payload in READERS.values() if read is control.decode}
    answers = {type(read(payload)) for read, payload in READERS.values() if read is control.decode_answer}
    assert commands | {Drop} == set(get_args(Command))
    assert answers == set(get_args(Answer))


@given(ANSWERS)
def test_an_answer_comes_back_as_it_was(answer):
    assert control.decode_answer(control.encode_answer(answer)) == answer


@given(REPORTS)
def test_a_report_comes_back_as_it_was(report):
    again = Report.decode(report.encode())
    assert again == report
    assert type(again.staleness) is Staleness
    assert all(type(proposal) is Proposal for proposal in again.proposals)


@given(IMPROVEMENTS)
def test_an_improvement_comes_back_as_it_was(improvement):
    assert Improvement.decode(improvement.encode()) == improvement


@given(st.builds(Counters, *[counts] * 10, *[fitnesses] * 4, counts, counts, fitnesses))
def test_counters_come_back_as_they_were(counters):
    again = Counters.decode(counters.encode())
    assert again == counters
    assert type(again) is Counters


def test_counters_of_many_nodes_come_back_in_as_few_messages_as_there_may_be():
    many = [COUNTERS._replace(node=node) for node in range(5000)]
    messages = list(Counters.encode_all(many))
    assert len(messages) == 2
    assert [each for message in messages for each in Counters.decode_all(message)] == many
    assert not list(Counters.encode_all([]))


@given(st.builds(Statistics, *[counts] * 9, *[fitnesses] * 4, counts, fitnesses, fitnesses))
def test_statistics_come_back_as_they_were(statistics):
    again = Statistics.decode(statistics.encode())
    assert again == statistics
    assert type(again) is Statistics


@given(
    st.builds(LogRecord, st.sampled_from(LEVELS), st.text(), st.text(), st.floats(0.0, 9e10), *[st.none() | counts] * 4)
)
def test_a_log_record_comes_back_as_it_was(record):
    assert LogRecord.decode(record.encode()) == record


def test_numbers_that_json_has_not_are_null_in_a_solution():
    solution = {"gap": math.inf, "deep": [{"x": (-math.inf, math.nan, 1.5)}], "text": "Infinity"}
    payload = Improvement(1, 0, 0.0, 0, 0, 0.0, True, solution).encode()
    assert Improvement.decode(payload).solution == {"gap": None, "deep": [{"x": [None, None, 1.5]}], "text": "Infinity"}
    json.loads(msgpack.unpackb(payload)[-1], parse_constant=pytest.fail)


# What is refused ------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("version", [0, 2, True, 1.0, "1", None, []])
@pytest.mark.parametrize("kind", ["command", "finish", "begin", "stop", "halt", "look", "missed"])
def test_commands_of_another_version_are_refused(kind, version):
    assert VERSION == 1
    assert reason(*with_field(kind, 0, version)) == "other version"


@pytest.mark.parametrize("fields", [[], [VERSION], ["prepare"]])
def test_a_command_has_a_version_and_a_name(fields):
    assert reason(control.decode, msgpack.packb(fields)) == "wrong shape"


@pytest.mark.parametrize(
    "rest",
    [
        ["nonsense", 1],
        ["nonsense", 1, 2],
        ["Begin", 1, 2],
        [b"begin", 1, 2],
        [None, 1, 2],
        [["begin"], 1, 2],
        [1, 1, 2],
    ],
)
def test_unknown_commands_are_refused(rest):
    assert reason(control.decode, msgpack.packb([VERSION, *rest])) == "no such command"


@pytest.mark.parametrize("kind", ["command", "finish", "begin", "stop", "halt", "look", "missed"])
def test_the_number_of_a_commands_fields_is_exact(kind):
    read, payload = READERS[kind]
    fields = msgpack.unpackb(payload)
    for wrong in (fields[:2], fields[:-1], [*fields, None], [*fields, 1]):
        assert reason(read, msgpack.packb(wrong)) == "wrong shape"


@pytest.mark.parametrize(
    ("kind", "index", "value", "why"),
    [
        ("command", 2, -1, "out of bounds"),
        ("command", 2, True, "wrong type"),
        ("command", 2, 1.0, "wrong type"),
        ("command", 3, -1, "out of bounds"),
        ("command", 3, False, "wrong type"),
        ("command", 3, None, "wrong type"),
        ("command", 4, b"bytes", "wrong type"),
        ("command", 4, None, "wrong type"),
        ("command", 5, None, "wrong shape"),
        ("command", 5, 4, "wrong shape"),
        ("command", 5, [4], "wrong shape"),
        ("command", 5, [4, [2, 0, 1], []], "wrong shape"),
        ("command", 5, [-1, [2, 0, 1]], "out of bounds"),
        ("command", 5, [4, [2, 0, None]], "wrong type"),
        ("command", 5, [4, [2, 0, 1], [], [], 0], "wrong shape"),
        ("command", 5, [4, [2, 0, 1], ["a", "b"], []], "wrong shape"),
        ("command", 5, [4, [2, 0, 1], [], ["a", "b", "c", "d"]], "wrong shape"),
        ("command", 5, [4, [2, 0, 1], ["a", "b", 3], []], "wrong type"),
        ("command", 5, [4, [2, 0, 1], [], ["a", None, "c"]], "wrong type"),
        ("command", 5, [4, [2, 0, 1], "abc", []], "wrong type"),
        ("command", 5, [-1, [2, 0, 1], [], []], "out of bounds"),
        ("command", 5, [None, [2, 0, 1], [], []], "wrong type"),
        ("command", 5, [4, "201", [], []], "wrong type"),
        ("command", 5, [4, [2, -1, 1], [], []], "out of bounds"),
        ("command", 5, [4, [2, 0.0, 1], [], []], "wrong type"),
        ("command", 5, [4, [2, None, 1], [], []], "wrong type"),
        ("command", 6, -1, "out of bounds"),
        ("command", 6, 12.0, "wrong type"),
        ("command", 6, False, "wrong type"),
        ("command", 7, None, "wrong type"),
        ("command", 7, "text", "wrong type"),
        ("command", 8, 3, "wrong type"),
        ("command", 8, "text", "wrong type"),
        ("command", 9, None, "wrong type"),
        ("command", 9, -1, "out of bounds"),
        ("begin", 3, -1, "out of bounds"),
        ("begin", 3, None, "wrong type"),
        ("stop", 3, -1, "out of bounds"),
        ("stop", 4, "boredom", "no such reason"),
        ("stop", 4, None, "no such reason"),
        ("stop", 4, ["stall"], "no such reason"),
        ("stop", 4, b"stall", "no such reason"),
        ("halt", 2, True, "wrong type"),
        ("halt", 3, 1 << 62, "out of bounds"),
        ("look", 2, -1, "out of bounds"),
        ("look", 2, "3", "wrong type"),
        ("missed", 3, None, "wrong type"),
        ("missed", 4, -1, "out of bounds"),
        ("missed", 4, 1 << 62, "out of bounds"),
        ("finish", 3, None, "wrong type"),
        ("finish", 4, [0.5, 7, 2], "wrong shape"),
        ("finish", 4, [math.nan, 7, 2, b""], "not finite"),
        ("finish", 4, [1, 7, 2, b""], "wrong type"),
        ("finish", 4, [0.5, 7, 2, "text"], "wrong type"),
        ("finish", 5, None, "wrong type"),
        ("finish", 6, "stall", "wrong type"),
        ("finish", 6, ["stall", "boredom"], "no such reason"),
        ("finish", 7, 3, "wrong type"),
        ("finish", 8, [[2]], "wrong shape"),
        ("finish", 8, [[2, "text"]], "wrong type"),
        ("finish", 9, None, "wrong type"),
        ("finish", 9, -1, "out of bounds"),
        ("answer", 0, "perhaps", "no such answer"),
        ("answer", 1, None, "no such answer"),
        ("answer", 1, b"bytes", "no such answer"),
        ("refusal", 1, 3, "no such answer"),
        ("refusal", 2, None, "no such answer"),
        ("judgement", 1, None, "no such answer"),
        ("judgement", 2, 1, "no such answer"),
        ("judgement", 3, 3, "wrong type"),
        ("judgement", 4, "text", "wrong type"),
        ("judgement", 5, b"bytes", "wrong type"),
        ("judgement", 6, 1, "wrong type"),
        ("judgement", 7, {}, "wrong type"),
        ("judgement", 7, b"{}", "wrong type"),
        ("judgement", 7, "{", "not JSON"),
        ("judgement", 7, "[]", "wrong type"),
        ("judgement", 7, '{"least": 0.5, "where": {}}', "wrong shape"),
        ("judgement", 7, '{"least": 0.5, "where": {}, "required": 0.0, "unit": "m", "more": 1}', "wrong shape"),
        ("judgement", 7, '{"least": 1, "where": {}, "required": 0.0, "unit": "m"}', "wrong type"),
        ("judgement", 7, '{"least": NaN, "where": {}, "required": 0.0, "unit": "m"}', "not JSON"),
        ("judgement", 7, '{"least": 0.5, "where": [], "required": 0.0, "unit": "m"}', "wrong type"),
        ("judgement", 7, '{"least": 0.5, "where": {}, "required": null, "unit": "m"}', "wrong type"),
        ("judgement", 7, '{"least": 0.5, "where": {}, "required": 0.0, "unit": 1}', "wrong type"),
        ("judgement", 9, 1, "wrong type"),
        ("report", 0, True, "wrong type"),
        ("report", 1, -1, "out of bounds"),
        ("report", 2, "text", "wrong type"),
        *(("report", index, "1", "wrong type") for index in range(3, 8)),
        ("report", 8, None, "wrong shape"),
        ("report", 8, [80, 9, 3], "wrong shape"),
        ("report", 8, [80, 9, 3, 2, 1], "wrong shape"),
        ("report", 8, [80, 9.0, 3, 2], "wrong type"),
        ("report", 8, [80, 9, 3, -1], "out of bounds"),
        ("report", 9, [], "wrong shape"),
        ("report", 9, [-math.inf, 7, 2, b""], "not finite"),
        ("report", 10, None, "wrong type"),
        ("report", 10, [[20, "target", 2]], "wrong shape"),
        ("report", 10, [[20, "boredom", 2, 13]], "no such reason"),
        ("report", 10, [[20.0, "target", 2, 13]], "wrong type"),
        ("report", 11, None, "wrong type"),
        ("report", 11, [[7, 2]], "wrong shape"),
        ("report", 11, [[7.0, 2, 0.5]], "wrong type"),
        ("report", 11, [[7, -1, 0.5]], "out of bounds"),
        ("report", 11, [[7, 2, math.inf]], "not finite"),
        ("report", 11, [[0, 0, 0.5]] * (MOST_BIRTHS + 1), "out of bounds"),
        ("report", 12, "text", "wrong type"),
        ("report", 13, "text", "wrong type"),
        ("report", 14, b"bytes", "wrong type"),
        ("improvement", 0, 1.0, "wrong type"),
        ("improvement", 1, -1, "out of bounds"),
        ("improvement", 1, False, "wrong type"),
        ("improvement", 6, 1, "wrong type"),
        ("improvement", 6, None, "wrong type"),
        ("improvement", 2, 1, "wrong type"),
        ("improvement", 2, math.nan, "not finite"),
        ("improvement", 5, math.nan, "not finite"),
        ("improvement", 5, -math.inf, "not finite"),
        ("improvement", 7, {}, "wrong type"),
        ("improvement", 7, b"{}", "wrong type"),
        ("improvement", 7, None, "wrong type"),
        ("improvement", 7, "", "not JSON"),
        ("improvement", 7, "{", "not JSON"),
        ("improvement", 7, "{} {}", "not JSON"),
        ("improvement", 7, '{"a": NaN}', "not JSON"),
        ("improvement", 7, '{"a": -Infinity}', "not JSON"),
        ("improvement", 7, '{"a": ' + "1" * 5000 + "}", "not JSON"),
        ("improvement", 7, "[" * 100_000, "not JSON"),
        ("improvement", 7, '{"a":' * 100_000, "not JSON"),
        ("improvement", 7, "[1]", "wrong type"),
        ("improvement", 7, "null", "wrong type"),
        ("improvement", 7, '"text"', "wrong type"),
        ("counters", 3, True, "wrong type"),
        ("counters", 9, -1, "out of bounds"),
        ("statistics", 9, 8, "wrong type"),
        ("statistics", 9, math.nan, "not finite"),
        ("statistics", 0, 8.0, "wrong type"),
        ("statistics", 15, 1, "wrong type"),
        ("counters", 16, 1, "wrong type"),
        ("log", 0, 3, "no such level"),
        ("log", 3, math.nan, "not finite"),
        ("log", 4, -1, "out of bounds"),
        ("log", 1, 3, "wrong type"),
        ("log", 2, b"bytes", "wrong type"),
    ],
)
def test_a_wrong_field_is_refused(kind, index, value, why):
    if kind == "improvement" and value == {}:
        value = [[]]  # maps do not travel at all
    assert reason(*with_field(kind, index, value)) == why


@pytest.mark.parametrize("kind", ["report", "improvement", "counters", "statistics", "log"])
def test_the_number_of_fields_is_exact(kind):
    read, payload = READERS[kind]
    fields = msgpack.unpackb(payload)
    assert reason(read, msgpack.packb(fields[:-1])) == "wrong shape"
    assert reason(read, msgpack.packb([*fields, 0])) == "wrong shape"
    assert reason(read, msgpack.packb([])) == "wrong shape"


@pytest.mark.parametrize("kind", READERS)
def test_what_is_no_array_is_refused(kind):
    read, payload = READERS[kind]
    assert reason(read, b"") == "not msgpack"
    assert reason(read, payload + b"\x00") == "not msgpack"
    assert reason(read, msgpack.packb("text")) == "not an array"


# Fuzzing --------------------------------------------------------------------------------------------------------------
VALUES = (
    0,
    -1,
    1 << 63,
    True,
    None,
    1.5,
    math.nan,
    -math.inf,
    "",
    "target",
    "{}",
    '{"a": [1, {"b": NaN}]}',
    "[" * 3000,
    b"",
    b"\xff" * 20,
    [],
    [[]],
    [1, "target", 2, 3],
    [0.5, 1, 2, b"x"],
    [["target"]],
    msgpack.ExtType(3, b"abc"),
)


def spoil(rng, payload):
    """A message cut, flipped, filled with other values or with other text."""
    way = rng.randrange(5)
    if way == 0:
        return payload[: rng.randrange(len(payload))]
    if way == 1:
        return rng.randbytes(rng.randrange(60))
    if way == 2:
        flipped = bytearray(payload)
        for _ in range(rng.choice((1, 1, 2, 6))):
            flipped[rng.randrange(len(flipped))] ^= 1 << rng.randrange(8)
        return bytes(flipped)
    fields = msgpack.unpackb(payload)
    for _ in range(rng.choice((1, 1, 2))):
        fields[rng.randrange(len(fields))] = rng.choice(VALUES)
    if way == 4:
        fields = fields[: rng.randrange(len(fields) + 1)]
    return msgpack.packb(fields)


def encoded(read, message):
    """By the inverse of ``read``."""
    inverses = {control.decode: control.encode, control.decode_answer: control.encode_answer}
    inverse = (inverses | {Counters.decode_all: msgpack.packb}).get(read)
    return message.encode() if inverse is None else inverse(message)


@pytest.mark.parametrize("kind", READERS)
def test_noise_is_refused_or_makes_sense_and_nothing_else_is_raised(kind, random_source):
    rng = random_source
    read, payload = READERS[kind]
    seen = Counter()
    for _ in range(4_000):
        spoilt = spoil(rng, payload)
        try:
            message = read(spoilt)
        except Rejected as error:
            seen[error.reason] += 1
        else:
            seen["accepted"] += 1
            again = encoded(read, message)
            assert encoded(read, read(again)) == again  # a target that is NaN is not equal to itself
    assert seen.total() == 4_000
    assert seen.keys() <= KNOWN_REASONS | {"accepted"}
    assert len(seen) >= 4
