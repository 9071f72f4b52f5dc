"""A checkpoint comes back from its bytes as it was; one that was changed or cut does not come back at all."""

import hashlib
import math
from dataclasses import replace
from pathlib import Path

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coordinator.jobs.checkpoint import Checkpoint
from problems import BadInput
from problems.file import parse
from problems.modules import AnyModules, Modules
from spy.past import Past
from wire.news import Improvement

FILE = parse('kind = "function"\nname = "onemax"\ndimension = 64\n', "onemax", Path("/"))
WHOLE = Checkpoint(
    FILE,
    FILE.with_run(topology="ring 2"),
    3,
    {"do": "rewire", "topology": "ring 2"},
    Past(epochs=3, generations=40, history="ab").led_on(
        {"do": "update", "epoch": 1, "generation": 9, "fields": {"name": "onemax"}}
    ),
    7,
    Improvement(1, 3, 0.5, 12, 1, math.inf, False, {"bits": [0, 1]}),
    8.5,
    ((96, b"first"), (100, b"second")),
)
BYTES = WHOLE.encode()


@pytest.mark.parametrize("checkpoint", [WHOLE, Checkpoint(FILE, FILE)], ids=["whole", "begin"])
def test_it_comes_back_as_it_was(checkpoint):
    assert Checkpoint.decode(checkpoint.encode(), AnyModules()) == checkpoint


def test_its_generation_is_that_of_the_slowest_cell():
    assert (WHOLE.generation, Checkpoint(FILE, FILE).generation) == (40 + 96, 0)


@given(at=st.integers(0, len(BYTES) - 1), bit=st.integers(0, 7))
def test_not_a_bit_of_it_may_change(at, bit):
    changed = bytearray(BYTES)
    changed[at] ^= 1 << bit
    with pytest.raises(BadInput, match="expected a"):
        Checkpoint.decode(bytes(changed), AnyModules())


@given(size=st.integers(0, len(BYTES) - 1))
def test_one_that_was_cut_is_refused(size):
    with pytest.raises(BadInput, match="expected a"):
        Checkpoint.decode(BYTES[:size], AnyModules())


def test_another_version_is_named():
    with pytest.raises(BadInput, match="version 3, found version 4"):
        Checkpoint.decode(BYTES.replace(b"checkpoint 3\n", b"checkpoint 4\n"), AnyModules())


def test_other_versions_of_the_software_are_named():
    here = WHOLE.versions["numpy"]
    assert WHOLE.other_versions() == []
    assert replace(WHOLE, versions=WHOLE.versions | {"numpy": "0.9"}).other_versions() == [
        f"numpy {here} instead of 0.9"
    ]


def test_a_service_runs_no_module_that_a_checkpoint_names():
    own = parse('kind = "tours:Tour"\n', "own", Path("/"))
    with pytest.raises(BadInput, match="allow-module tours"):
        Checkpoint.decode(Checkpoint(own, own).encode(), Modules())


def damaged(place, value):
    """The checkpoint with another value at a place, and the digest that then is right."""
    head, _, rest = BYTES.partition(b"\n")
    values = msgpack.unpackb(rest[32:])
    values[place] = value
    content = msgpack.packb(values)
    return head + b"\n" + hashlib.sha256(content).digest() + content


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (3, "[" * 100_000),
        (4, "[" * 100_000),
        (4, "[]"),
        (4, '["3", 40, 0, [0, 0, 0, 0], [0, 0, 0, 0], "ab", null]'),
        (4, '[3, 40, 0, [0, 0, 0, 0], [0, 0, 0, 0], "no hexadecimal digits", null]'),
        (4, '[3, 40, 0, [0, 0, 0, 0], [0, 0, 0, 0], "ab", 7]'),
        (4, '[3, 40, 0, [0, 0, 0, 0], [0, 0, 0, 0], "ab", [0.5, 1, 2, 3]]'),
        (5, ["{}"]),
        (5, ['{"do": "update", "epoch": 1, "generation": 2}']),
        (5, ['{"do": "update", "epoch": "1", "generation": 2, "fields": {}}']),
    ],
)
def test_one_that_others_made_is_refused_by_one_error(place, value):
    with pytest.raises(BadInput, match="expected a checkpoint, found one that is damaged"):
        Checkpoint.decode(damaged(place, value), AnyModules())
