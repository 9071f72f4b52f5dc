"""The targets of the wire: each reads any bytes as one kind of message.

A target returns if the bytes are refused as they should be, or are a message that comes back from its encoding.
"""

import contextlib
import hashlib
import math
from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np

from coordinator.jobs.checkpoint import Checkpoint
from fuzz.forms import BYTES, MSGPACK
from fuzz.target import ROOT, Target
from genetics import BitString, Coding, Permutation, RealVector
from genetics.coding import Alphabet
from problems import BadInput
from problems.file import load
from problems.modules import Modules
from spy.past import Past
from wire import control, jobs
from wire.champion import Champion
from wire.exchange import VERSION, Messages
from wire.hosts import Host
from wire.keys import Keys
from wire.limits import Limits
from wire.news import Counters, Improvement, LogRecord, Statistics
from wire.report import Birth, Proposal, Report, Staleness
from wire.strict import Rejected
from wire.takeover import KeptStates, Takeover

_CHAMPION = Champion(0.5, 7, 2, b"\x12\x34")
_WIRING = control.Wiring(4, (2, 0, 1), ("a", "b", ""), ("", "tcp/b:1", ""))
_COMMANDS = (
    control.Prepare(
        3, 1, '["x.toml", {}]', _WIRING, 12, b"\x12\x34", b"", 16, False, Takeover(7, b"state", stop_at=9), True
    ),
    control.Begin(3, 1, 4),
    control.ProposeStop(3, 1, "cancel"),
    control.Halt(3, 1),
    control.Look(3),
    control.Drop(3),
    control.Missed(3, 1, 9),
    control.Finish(3, 1, _CHAMPION, 20, ("target", "stall"), "failed", ((2, b"\x01"),), 12),
    control.TellStates(3, 1, True),
)
_CLEARANCE = {"least": 0.25, "where": {"link": 2}, "required": 0.0, "unit": "m"}
_ANSWERS = (
    control.Done('{"a": 1}'),
    control.Refused("no", "input"),
    control.Judged("solved", True, None, b"\x12", "in words", 0.5, _CLEARANCE, "{}", "when", ("longer",), True),
    KeptStates(2, 40, 30, ((1, 32, b"state"),), ((1, 40),), 44),
)
_REPORT = Report(
    2,
    20,
    bytes(32),
    160,
    20,
    80,
    1,
    0,
    Staleness(80, 9, 3, 2),
    _CHAMPION,
    (Proposal(20, "target", 2, 13),),
    (Birth(0, 2, 3.5), Birth(7, 2, 0.5)),
    b"\x12\x34",
    b"\x56",
    "failed",
    (("ab", b"\x12"),),
)
_COUNTERS = Counters(*range(1, 11), 0.5, 1.5, 2.5, 0.5, 3, 4, 0.25)
_IMPROVEMENT = Improvement(3, 1, 0.25, 7, 2, 0.5, True, {"angles": [0.1, 0.2], "tip": {"x": 1}})
_STATISTICS = Statistics(*range(1, 10), 8.5, 0.5, 1.5, 2.5, 9, 0.25, 0.125)
_LOG = LogRecord("warning", "node 3", "bad message", 1.75e9, 3, 4, 5, None)
_REQUESTS = (
    jobs.Submit("[]", "a", 3),
    jobs.ListJobs(3),
    jobs.Show("a", True),
    jobs.Records("history", "a", 3),
    jobs.Logs("a", 3, 7),
    jobs.Cancel("a"),
    jobs.Update("a", '{"x": 1}'),
    jobs.Rewire("a", "ring 8"),
    jobs.Status(),
    jobs.Down(),
)
_CLIENT_ANSWERS = (jobs.Done({"job": "a", "rows": [[1, None, 0.5]]}), jobs.Refused("no", "failure"))
_STATE = jobs.JobState("a", 3, "running", 0.5, "well", 1.75e9)
_TOKENS = (Keys("c").life(12, 4711), Keys("c").life(12, "4711+SIGSEGV-h1"), Keys("c").spy_life(4711))

_CELLS, _EMIGRANTS = 16, 2
_ORDERS = Permutation(4)
_CODINGS: tuple[tuple[Coding, bytes], ...] = (  # each with a genome
    (BitString(3, 5), bytes(2)),
    (RealVector(2, -1.0, 1.0), bytes(16)),
    (_ORDERS, _ORDERS.encode(np.arange(4)).tobytes()),
)


def _stays(
    read: Callable[[bytes], Any], write: Callable[[Any], bytes], *refusals: type[Exception]
) -> Callable[[bytes], bool]:
    """Return a function that reads bytes, and checks that a message comes back from its encoding."""

    def reads(data: bytes) -> bool:
        try:
            message = read(data)
        except refusals:
            return False
        again = write(message)
        # Not the messages: NaN, which some fields may be, is not equal to itself.
        assert write(read(again)) == again, (message, read(again))
        return True

    return reads


def _one_of(*readers: Callable[[bytes], bool]) -> Callable[[bytes], bool]:
    def reads(data: bytes) -> bool:
        return max([reader(data) for reader in readers])  # every one is called

    return reads


# Exchange -------------------------------------------------------------------------------------------------------------
def _limits(coding: Coding) -> Limits:
    return Limits(coding.genome_bytes, _EMIGRANTS, _CELLS, coding.alphabet, 64)


def _exchange(genome: bytes) -> bytes:
    fields = [VERSION, 3, 1, 20, None, [[genome, 0.5], [genome, math.inf]], [0.5, 7, 2, genome], [20, 160], b"state"]
    return bytes(msgpack.packb(fields))


def _read_exchange(data: bytes) -> bool:
    is_right = False
    for coding, _ in _CODINGS:
        limits, messages = _limits(coding), Messages.room(1, coding.genome_bytes, _EMIGRANTS)
        if messages.decode(0, data, limits) is None:
            assert _is_sound(messages, limits.alphabet), messages
            is_right = True
    return is_right


def _is_sound(messages: Messages, alphabet: Alphabet) -> bool:
    """Return whether an accepted message holds only what breeding may use as it is."""
    genomes = messages.genomes[0] if messages.champion(0) is not None else messages.genomes[0, :-1]
    numbers = (messages.header[0] >= 0).all() and not np.isnan(messages.fitness[0]).any()
    return bool(numbers) and all(alphabet.admits(genome) for genome in genomes)


# Checkpoints ----------------------------------------------------------------------------------------------------------
def _checkpoint() -> bytes:
    """Return what follows the digest in a checkpoint."""
    file = load(ROOT / "examples" / "rastrigin.toml")
    past = Past(epochs=3, generations=40, history="ab", champion=_CHAMPION)
    past = past.led_on({"do": "update", "epoch": 1, "generation": 7, "fields": {"dimension": 3}})
    states = ((96, b"first"), (100, b"second"))
    whole = Checkpoint(file, file, 3, {"do": "rewire"}, past, 7, _IMPROVEMENT, 8.5, states).encode()
    return whole[_place_of_content(whole) :]


def _place_of_content(checkpoint: bytes) -> int:
    return checkpoint.index(b"\n") + 1 + hashlib.sha256().digest_size


def _with_digest(content: bytes) -> bytes:
    return b"supernode checkpoint 3\n" + hashlib.sha256(content).digest() + content


def _read_checkpoint(data: bytes) -> Checkpoint:
    checkpoint = Checkpoint.decode(_with_digest(data), Modules())
    assert checkpoint.generation >= 0
    checkpoint.other_versions()
    return checkpoint


_read_checkpoint_and_back = _stays(
    _read_checkpoint, lambda checkpoint: (whole := checkpoint.encode())[_place_of_content(whole) :], BadInput
)


def _read_checkpoints(data: bytes) -> bool:
    with contextlib.suppress(BadInput):
        Checkpoint.decode(data, Modules())
    return _read_checkpoint_and_back(data)


# Tokens ---------------------------------------------------------------------------------------------------------------
def _read_token(data: bytes) -> bool:
    key = data.decode("utf-8", "replace")
    try:
        node, process = Keys.life_of(key)
    except Rejected:
        return False
    crash, host = Keys.crash_of_life(key), Keys.host_of_life(key)
    named = f"{process}{'+' if crash else ''}{crash}{'-' if host else ''}{host}"
    again = Keys("c").spy_life(named) if node is None else Keys("c").life(node, named)
    assert (Keys.life_of(again), Keys.crash_of_life(again), Keys.host_of_life(again)) == ((node, process), crash, host)
    return True


def targets() -> list[Target]:
    """Return the targets of the wire."""
    news = _one_of(
        _stays(Improvement.decode, Improvement.encode, Rejected),
        _stays(Counters.decode, Counters.encode, Rejected),
        _stays(Counters.decode_all, msgpack.packb, Rejected),
        _stays(Statistics.decode, Statistics.encode, Rejected),
        _stays(LogRecord.decode, LogRecord.encode, Rejected),
    )
    return [
        Target("exchange", MSGPACK, lambda: [_exchange(genome) for _, genome in _CODINGS], _read_exchange),
        Target(
            "commands",
            MSGPACK,
            lambda: list(map(control.encode, _COMMANDS)),
            _stays(control.decode, control.encode, Rejected),
        ),
        Target(
            "answers",
            MSGPACK,
            lambda: list(map(control.encode_answer, _ANSWERS)),
            _stays(control.decode_answer, control.encode_answer, Rejected),
        ),
        Target("reports", MSGPACK, lambda: [_REPORT.encode()], _stays(Report.decode, Report.encode, Rejected)),
        Target(
            "news",
            MSGPACK,
            lambda: [
                *(each.encode() for each in (_IMPROVEMENT, _COUNTERS, _STATISTICS, _LOG)),
                *Counters.encode_all([_COUNTERS, _COUNTERS]),
            ],
            news,
        ),
        Target(
            "requests", MSGPACK, lambda: list(map(jobs.encode, _REQUESTS)), _stays(jobs.decode, jobs.encode, Rejected)
        ),
        Target(
            "client-answers",
            MSGPACK,
            lambda: [*map(jobs.encode_answer, _CLIENT_ANSWERS), _STATE.encode()],
            _one_of(
                _stays(jobs.decode_answer, jobs.encode_answer, Rejected),
                _stays(jobs.JobState.decode, jobs.JobState.encode, Rejected),
            ),
        ),
        Target(
            "hosts",
            MSGPACK,
            lambda: [Host("h1", "rack", 2, "tcp/10.0.0.3:7450", (4, 5), "block/rack", True).encode()],
            _stays(Host.decode, Host.encode, Rejected),
        ),
        Target("checkpoints", MSGPACK, lambda: [_checkpoint()], _read_checkpoints),
        Target("tokens", BYTES, lambda: [each.encode() for each in _TOKENS], _read_token),
    ]
