"""Whatever bytes they get, readers of foreign input refuse them by their own error, or read them.

`make fuzz` tries many more inputs on the same targets.
"""

import resource

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzz.limits import MOST_MEGABYTES
from fuzz.mutation import STRANGE, mutated, with_a_change
from fuzz.targets import TARGETS

SLOW = {"problem-files", "scenes", "solutions", "srdf", "submitted", "urdf"}  # some milliseconds for each input


@pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS)
def test_a_target_begins_with_right_inputs(target):
    seeds = target.seeds()
    assert seeds
    assert all(target.read(seed) for seed in seeds)


def refuses_or_reads(target, data):
    target.read(data)  # raises if the reader has a fault
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10 < MOST_MEGABYTES


@pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS)
def test_any_bytes_are_refused_or_read(target):
    @settings(max_examples=10 if target.name in SLOW else 60, deadline=None)
    @given(st.binary(max_size=200))
    def holds(data):
        refuses_or_reads(target, data)

    holds()


@pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS)
def test_an_input_with_changes_is_refused_or_read(target):
    seeds = target.seeds()

    @settings(max_examples=15 if target.name in SLOW else 60, deadline=None)
    @given(st.sampled_from(seeds), st.randoms(use_true_random=False))
    def holds(seed, rng):
        refuses_or_reads(target, mutated(seed, target.form, seeds, rng))

    holds()


def test_changes_reach_every_place_and_leave_the_value_as_it_was(random_source):
    value = {"a": [1, {"b": 2.5}], "c": "text"}
    changed = [with_a_change(value, [7], random_source) for _ in range(2000)]
    assert value == {"a": [1, {"b": 2.5}], "c": "text"}
    kept = [each for each in changed if isinstance(each, dict) and isinstance(each.get("a"), list)]
    assert any(each["a"] and each["a"][0] != 1 for each in kept)
    assert any(len(each["a"]) == 1 for each in kept)
    assert any("c" not in each for each in kept)
    assert any(each.get("c") in STRANGE and each["c"] != "" for each in kept)
    assert any(each.get("c") == 7 for each in kept)
