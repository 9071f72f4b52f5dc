"""A ring holds the latest strings, in their order, whatever their sizes."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from lowlevel.compiled import kernel
from node.engine import ring

ROOM, ENTRIES = 100, 7


@kernel("int64(uint8[::1], int64[:, ::1], int64[::1], uint8[::1], int64, int64)")
def put(room, entries, marks, string, most, number):
    start = ring.begin(room, entries, marks, most)
    room[start : start + string.size] = string
    ring.end(entries, marks, start, string.size, number)
    return ring.latest(room, entries, marks).size


@given(st.lists(st.tuples(st.binary(min_size=1, max_size=40), st.integers(0, 20)), max_size=60))
def test_it_holds_the_latest_strings_as_many_as_fit(strings):
    kept = ring.Ring(*(each[0] for each in ring.arrays(1, ROOM, ENTRIES)))
    assert list(kept) == []
    assert kept.latest_size == 0
    for number, (string, spare) in enumerate(strings):
        most = len(string) + spare  # what was asked for may be more than what was needed
        size = put(kept.room, kept.entries, kept.marks, np.frombuffer(bytearray(string), np.uint8), most, number)
        assert size == kept.latest_size == len(string)
        assert kept.latest() == string
        expected = [(each, strings[each][0]) for each in range(number + 1)]
        found = list(kept)
        assert found == expected[len(expected) - len(found) :]
        # Only what must make room goes: at worst one gap at the end of the room is left unused.
        fits, sizes = 0, 0
        for each, extra in reversed(strings[: number + 1]):
            sizes += len(each) + extra
            if 2 * sizes > ROOM - 60 or fits == ENTRIES:
                break
            fits += 1
        assert len(found) >= min(fits, ENTRIES)
