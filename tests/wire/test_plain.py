"""What JSON can say."""

import json
import math

from hypothesis import given
from hypothesis import strategies as st

from wire.plain import plain

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.tuples(inner, inner) | st.dictionaries(st.text(), inner),
)


@given(VALUES)
def test_whatever_it_is_json_can_say_it_and_says_the_same_again(value):
    said = plain(value)
    assert json.loads(json.dumps(said, allow_nan=False)) == said


def test_only_numbers_that_are_not_finite_are_replaced():
    assert plain({"a": [1.5, math.inf, (math.nan, "x")], "b": -math.inf, "c": 3}) == {
        "a": [1.5, None, [None, "x"]],
        "b": None,
        "c": 3,
    }
