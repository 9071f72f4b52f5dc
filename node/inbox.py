"""Where a cell keeps the messages that have come: rows of arrays, so that nothing is copied.

A message is read into a spare row and, if it is kept, stays there. In lockstep the messages of two exchanges are kept
apart, since a neighbour may be one ahead; in async mode the latest of each neighbour is kept. Reading, judging and
keeping all that have come is one compiled call.
"""

import struct
from collections.abc import Sequence
from functools import partial
from itertools import compress
from typing import Any

import numpy as np
from numba import types

from genetics import Cells
from genetics.operators import TABLE, Table, pointers
from lowlevel.compiled import kernel, subroutine
from lowlevel.pointers import integers, octets, octets_of, reals
from node.kernels import OWN, TOLD, note_staleness
from node.plan import Plan
from wire.exchange import Messages
from wire.exchange_kernels import EPOCH, GENERATION, JOB, PAYLOAD, SENT, only_emigrants, read_message
from wire.report import Staleness

# What an inbox counts: the number of the next exchange, spare rows, neighbours whose messages are lacking, and messages
# kept, refused, (in async mode) lost, and sound but of no use, such as those that come again.
NEXT, _SPARE, LACKING, _KEPT, _REFUSED, _LOST, _OF_NO_USE = range(7)

# Places in the table of pointers.
_HEADER, _GENOMES, _FITNESS, _MASK, _LOW, _HIGH, _ITEMS, _NAMES, _SENDERS, _WHENCES, _LATEST, _SPARES = range(12)
_COUNTS, _LIMITS = 12, 13
# Columns of the limits; the interval is 0 in async mode.
_MOST_BYTES, _CELLS, _JOB, _EPOCH, _INTERVAL, _CHAMPIONS = range(6)

_mark = struct.Struct("<2q").pack  # before a message where several are packed: its sender and its length


@subroutine
def _is_of_use(header: Any, interval: Any, latest: Any, number: Any, counts: Any) -> Any:
    """In lockstep: neither late, nor again, nor nonsense; a neighbour is at most one exchange ahead.

    In async mode (an interval of 0): newer than the latest; it may come by two ways, or be overtaken. In lockstep
    ``latest`` is 1 for as long as a message has not come.
    """
    if interval == 0:
        return header[SENT] > latest[0, number]
    exchange = header[GENERATION] // interval
    in_time = 0 <= exchange - counts[NEXT] <= 1
    return in_time and header[GENERATION] % interval == 0 and latest[exchange % 2, number]


@subroutine
def _note(header: Any, interval: Any, latest: Any, number: Any, counts: Any) -> Any:
    """Take note that the message has come; returns the exchange that it is for."""
    if interval == 0:
        counts[_LOST] += header[SENT] - 1 - latest[0, number]
        latest[0, number] = header[SENT]
        return 0
    exchange = header[GENERATION] // interval
    latest[exchange % 2, number] = 0
    counts[LACKING] -= exchange == counts[NEXT]
    return exchange % 2


@subroutine
def _swap(row: Any, source_row: Any, names: Any, spare: Any, counts: Any) -> Any:
    """Let the slots named find the spare ``row``; the row that they had is spare now."""
    counts[_SPARE] -= 1
    old = np.int64(TOLD)
    for slot in range(source_row.size):
        if names[slot]:
            old = source_row[slot]
            source_row[slot] = row
    if old > TOLD:
        spare[counts[_SPARE]] = old
        counts[_SPARE] += 1


@subroutine
def _take_in(table: Any, limits: Any, payload: Any, number: Any, counts: Any) -> Any:
    """Read a message of neighbour ``number`` into a spare row, and keep it if it is of use.

    Returns minus the reason why it is refused, or whether it is of this epoch.
    """
    spare = integers(table, _SPARES)[0]
    row = spare[counts[_SPARE] - 1]
    header, fitness = integers(table, _HEADER)[row], reals(table, _FITNESS)
    several = fitness.shape[1]
    genomes = octets(table, _GENOMES)[row * several : (row + 1) * several]
    mask, low, high = octets(table, _MASK)[0], reals(table, _LOW)[0], reals(table, _HIGH)[0]
    most_bytes, cells, items = limits[_MOST_BYTES], limits[_CELLS], integers(table, _ITEMS)[0]
    end = read_message(payload, most_bytes, cells, mask, low, high, items, header, genomes, fitness[row])
    if end < 0:
        return end
    latest = integers(table, _LATEST)
    if header[JOB] != limits[_JOB] or header[EPOCH] != limits[_EPOCH]:
        return 0
    if _is_of_use(header, limits[_INTERVAL], latest, number, counts):
        if not limits[_CHAMPIONS]:
            only_emigrants(header, genomes, fitness[row], integers(table, _SENDERS)[0, number])
        place = _note(header, limits[_INTERVAL], latest, number, counts)
        _swap(row, integers(table, _WHENCES)[place], octets(table, _NAMES)[number], spare, counts)
        counts[_KEPT] += 1
    else:
        counts[_OF_NO_USE] += 1
    return 1


@subroutine
def hear_one(table: Any, payload: Any, sender: Any) -> Any:
    """`_take_in` a message; 0 too if it is no neighbour's."""
    limits, counts, senders = integers(table, _LIMITS)[0], integers(table, _COUNTS)[0], integers(table, _SENDERS)[0]
    for number in range(senders.size):
        if senders[number] == sender:
            return _take_in(table, limits, payload, number, counts)
    return 0


@subroutine
def _integer_at(everything: Any, at: Any) -> Any:
    """Eight bytes, the lowest first, wherever they lie."""
    value = np.int64(0)
    for place in range(8):
        value |= np.int64(everything[at + place]) << (8 * place)
    return value


@kernel(types.int64(PAYLOAD, TABLE))
def hear(news: bytes, table: Table) -> int:
    """Read messages that are `packed`, and keep those that are sound and of use.

    What no neighbour has sent is passed over. Returns how many were refused.
    """
    everything = octets_of(news)
    start = np.int64(0)
    refused = 0
    while start < everything.size:
        sender, size = _integer_at(everything, start), _integer_at(everything, start + 8)
        start += 16
        refused += hear_one(table, everything[start : start + size], sender) < 0
        start += size
    integers(table, _COUNTS)[0, _REFUSED] += refused
    return refused


@kernel("void(int64[:,::1], int64[::1])")
def turn(latest: Cells, counts: Cells) -> None:
    """In lockstep: the next exchange."""
    latest[counts[NEXT] % 2] = 1
    counts[NEXT] += 1
    counts[LACKING] = np.sum(latest[counts[NEXT] % 2])


def packed(news: Sequence[tuple[int, bytes]]) -> bytes:
    """Messages one after another, each behind its sender and its length, as `hear` takes them."""
    return b"".join([_mark(sender, len(payload)) + payload for sender, payload in news])


class Inbox:
    """The messages of one cell's neighbours in one epoch of a job.

    Attributes:
        neighbours: the distinct cells that the cell's slots name, without itself.
        messages: rows for all of them, the cell's own in rows `OWN` and `TOLD`.
        source_rows: the row of the message for each slot, shape (exchanges kept apart, slots).
        latest: shape (exchanges, neighbours): 1 for whose message has not come; in async mode the latest one's number.
        counts: see above.
        used: in async mode the number of the message that each slot gave last.
        staleness: in async mode the counts of `wire.report.Staleness`.
        lacking: asked for how many neighbours' messages have not come, in lockstep; a call into compiled code, since it
            is asked in each generation.
        table: of pointers to all that `hear` works on.
    """

    def __init__(self, plan: Plan, cell: int, job: int) -> None:
        slots = plan.topology.neighbours(cell)
        self.neighbours = tuple(dict.fromkeys(other for other in slots if other != cell))
        self._lockstep = plan.run.mode == "lockstep"
        exchanges, others = 2 if self._lockstep else 1, len(self.neighbours)
        self._limits = plan.limits
        self._numbers = {other: number for number, other in enumerate(self.neighbours)}
        self.latest = np.full((exchanges, others), int(self._lockstep))
        self._not_come = tuple(exchange.tolist for exchange in self.latest)
        # Both stand for the cell itself, and for whom nothing was heard of. An individual alone breeds with what it has
        # told last until it tells more; an island takes nothing in from itself, and knows itself by its own row.
        self.source_rows = np.full((exchanges, len(slots)), TOLD if plan.run.deme == 1 else OWN)
        self.used = np.zeros(len(slots), np.int64)
        self.staleness = np.zeros(len(Staleness._fields), np.int64)
        spare = np.arange(2, 3 + exchanges * others)
        self.counts = np.zeros(7, np.int64)
        self.counts[_SPARE] = len(spare)
        self.counts[LACKING] = others
        self.lacking = partial(self.counts.item, LACKING)
        self.messages = Messages.room(2 + len(spare), plan.coding.genome_bytes, plan.run.emigrants)
        names = np.array([[named == other for named in slots] for other in self.neighbours], np.uint8)
        interval = plan.run.interval if self._lockstep else 0
        champions = plan.run.spy == "champion"
        self._kept: tuple[Any, ...] = (
            *self.messages,
            *(np.atleast_2d(each) for each in plan.limits.alphabet),
            names.reshape(others, len(slots)),
            np.array([self.neighbours], np.int64),
            self.source_rows,
            self.latest,
            spare,
            self.counts,
            np.array([plan.limits.most_bytes, plan.limits.cells, job, plan.epoch, interval, champions]),
        )
        self.table = pointers(*self._kept)

    @property
    def kept(self) -> int:
        """How many messages were sound and of use."""
        return self.counts.item(_KEPT)

    @property
    def refused(self) -> int:
        """How many were not what they should be."""
        return self.counts.item(_REFUSED)

    @property
    def lost(self) -> int:
        """In async mode: how many are known not to have come."""
        return self.counts.item(_LOST)

    @property
    def of_no_use(self) -> int:
        """How many were sound, but too late, too early, or the same again."""
        return self.counts.item(_OF_NO_USE)

    def missing(self) -> set[int]:
        """In lockstep: the neighbours whose messages for the next exchange have not come."""
        return set(compress(self.neighbours, self._not_come[self.counts.item(NEXT) % 2]()))

    def hear(self, news: Sequence[tuple[int, bytes]]) -> set[tuple[int, str]]:
        """Take in messages, each with its sender. Returns the senders of those that are refused, with the reasons."""
        return self.complaints(news) if news and hear(packed(news), self.table) else set()

    def complaints(self, news: Sequence[tuple[int, bytes]]) -> set[tuple[int, str]]:
        """Which of these messages are refused: their senders, with the reasons."""
        reasons = {(sender, self._reason(payload)) for sender, payload in news if sender in self._numbers}
        return {(sender, reason) for sender, reason in reasons if reason is not None}

    def _reason(self, payload: bytes) -> str | None:
        """Why a message is refused, if it is."""
        spare = Messages.room(1, self._limits.genome_bytes, self._limits.emigrants)
        return spare.decode(0, payload, self._limits)

    def take(self, generation: int) -> Cells:
        """The row of the message for each slot, shape (1, slots), for breeding after ``generation``.

        In lockstep what comes from now on is for later exchanges; in async mode it is noted how old the messages are.
        """
        if self._lockstep:
            exchange = self.counts.item(NEXT) % 2
            turn(self.latest, self.counts)
            return self.source_rows[exchange : exchange + 1]
        note_staleness(self.messages.header, self.source_rows[0], generation, self.used, self.staleness)
        return self.source_rows
