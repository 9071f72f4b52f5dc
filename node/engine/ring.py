"""A ring of byte strings in arrays, which compiled code writes: the latest ones, as many as there is room for.

A cell keeps its latest messages in one, and the latest states of each neighbour in another. A string is written in two
steps, since its length is not known before: `begin` finds room for the longest that it may be, `end` enters it. No
string is empty: such a one would take no place, so nothing could overwrite it.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lowlevel.compiled import subroutine
from node.engine.layout import RowLayout

_ENTRY = RowLayout()
_NUMBER = _ENTRY.column("number")
_START = _ENTRY.column("start")  # in the room
_SIZE = _ENTRY.column("size")  # bytes
ENTRY = len(_ENTRY)

_MARK = RowLayout()
_NEXT = _MARK.column("next")  # where the next string starts
_FIRST = _MARK.column("first")  # the oldest entry, counted from the beginning
_COUNT = _MARK.column("count")  # entries so far
MARKS = len(_MARK)


@subroutine
def begin(room: Any, entries: Any, marks: Any, most: Any) -> Any:
    """Return where a string of at most ``most`` bytes may be written; the oldest entries make room for it.

    ``most`` must not exceed the room.
    """
    before = marks[_NEXT]
    start = before if before + most <= room.size else 0
    while marks[_FIRST] < marks[_COUNT]:
        oldest = entries[marks[_FIRST] % len(entries)]
        begins, ends = oldest[_START], oldest[_START] + oldest[_SIZE]
        is_overwritten = begins < start + most and ends > start
        # At the end of the room those that lie behind are the oldest: they go first, or entries would lose their order.
        is_skipped = start < before and begins >= before
        is_full = marks[_COUNT] - marks[_FIRST] == len(entries)
        if not (is_overwritten or is_skipped or is_full):
            break
        marks[_FIRST] += 1
    return start


@subroutine
def end(entries: Any, marks: Any, start: Any, size: Any, number: Any) -> Any:
    """Enter a string that has been written, under a number."""
    entry = entries[marks[_COUNT] % len(entries)]
    entry[_NUMBER], entry[_START], entry[_SIZE] = number, start, size
    marks[_COUNT] += 1
    marks[_NEXT] = start + size


@subroutine
def leave_gap(marks: Any, place: Any) -> Any:
    """Let the next string begin at ``place``, behind the one that was entered last."""
    marks[_NEXT] = place


@subroutine
def has(entries: Any, marks: Any, number: Any) -> Any:
    """Return whether there is a string of this number."""
    found = False
    for count in range(marks[_FIRST], marks[_COUNT]):
        found = found or entries[count % len(entries)][_NUMBER] == number
    return found


@subroutine
def latest(room: Any, entries: Any, marks: Any) -> Any:
    """Return the string that was entered last; there must be one."""
    entry = entries[(marks[_COUNT] - 1) % len(entries)]
    return room[entry[_START] : entry[_START] + entry[_SIZE]]


@subroutine
def latest_number(entries: Any, marks: Any) -> Any:
    """Return the number of the string that was entered last; there must be one."""
    return entries[(marks[_COUNT] - 1) % len(entries)][_NUMBER]


@subroutine
def drop_latest_unless_multiple(entries: Any, marks: Any, of: Any) -> Any:
    """Take the string that was entered last out again if its number is no multiple; harmless if there is none."""
    if marks[_FIRST] < marks[_COUNT] and latest_number(entries, marks) % of != 0:
        marks[_COUNT] -= 1
        marks[_NEXT] = entries[marks[_COUNT] % len(entries)][_START]


def arrays(rings: int, most_bytes: int, most_entries: int) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return the rooms, entries and marks of so many empty rings, with a first axis for the rings."""
    entries = np.zeros((rings, most_entries, ENTRY), np.int64)
    return np.empty((rings, most_bytes), np.uint8), entries, np.zeros((rings, MARKS), np.int64)


class Ring:
    """The arrays of a ring, and how Python reads them. They may be parts of larger arrays, see `arrays`.

    Attributes:
        room: the strings, shape (bytes,).
        entries: for each string its number, its place and its size, shape (most entries, ENTRY).
        marks: what comes next, shape (MARKS,).
    """

    def __init__(self, room: NDArray[np.uint8], entries: NDArray[np.int64], marks: NDArray[np.int64]) -> None:
        self.room, self.entries, self.marks = room, entries, marks
        self._bytes = self.room.data  # a memoryview: slicing an array costs as much as a message

    def latest(self) -> bytes:
        """Return the string that was entered last."""
        _, start, size = self.entries[(self.marks.item(_COUNT) - 1) % len(self.entries)].tolist()
        return self._bytes[start : start + size].tobytes()

    @property
    def latest_size(self) -> int:
        """The size of the string that was entered last, in bytes; 0 if there is none."""
        return self.entries.item((self.marks.item(_COUNT) - 1) % len(self.entries), _SIZE)

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        """Yield number and string of each entry, the oldest first."""
        for count in range(self.marks.item(_FIRST), self.marks.item(_COUNT)):
            number, start, size = self.entries[count % len(self.entries)].tolist()
            yield number, self._bytes[start : start + size].tobytes()
