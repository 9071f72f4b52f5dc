"""Where a cell keeps the messages that have come: rows of arrays, so that nothing is copied.

A message is read into a spare row and, if it is kept, stays there. In lockstep the messages of two exchanges are kept
apart, since a neighbour may be one ahead; in async mode the latest of each neighbour is kept. Reading, judging and
keeping all that have come is one compiled call.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from genetics import Cells, Fitness, Genomes
from genetics.compiled import kernel, subroutine
from node.plan import Plan
from wire.exchange import REASONS, Messages
from wire.exchange_kernels import (
    ARGUMENTS_OF_READING,
    GENERATION,
    JOB,
    SENT,
    Header,
    only_emigrants,
    read_message,
)

_AT_ONCE = 64  # messages in one call
OWN = 0
"""The row of the cell's own message, which stands for a neighbour that nothing was heard of."""

# What an inbox counts: the number of the next exchange, spare rows, neighbours whose messages are lacking, and messages
# kept, refused and (in async mode) lost.
_NEXT, _SPARE, _LACKING, _KEPT, _REFUSED, _LOST = range(6)
_COUNTS = 6


@subroutine
def _is_of_use(header: Any, interval: Any, latest: Any, number: Any, counts: Any) -> Any:
    """In lockstep: neither late, nor again, nor nonsense; a neighbour is at most one exchange ahead.

    In async mode (an interval of 0): newer than the latest; it may come by two ways, or be overtaken.
    """
    if interval == 0:
        return header[SENT] > latest[0, number]
    exchange = header[GENERATION] // interval
    in_time = 0 <= exchange - counts[_NEXT] <= 1
    return in_time and header[GENERATION] % interval == 0 and not latest[exchange % 2, number]


@subroutine
def _note(header: Any, interval: Any, latest: Any, number: Any, counts: Any) -> Any:
    """Take note that the message has come; returns the exchange that it is for."""
    if interval == 0:
        counts[_LOST] += header[SENT] - 1 - latest[0, number]
        latest[0, number] = header[SENT]
        return 0
    exchange = header[GENERATION] // interval
    latest[exchange % 2, number] = 1
    counts[_LACKING] -= exchange == counts[_NEXT]
    return exchange % 2


@subroutine
def _swap(row: Any, whence: Any, names: Any, spare: Any, counts: Any) -> Any:
    """Let the slots named find the spare ``row``; the row that they had is spare now."""
    counts[_SPARE] -= 1
    old = OWN
    for slot in range(whence.size):
        if names[slot]:
            old = whence[slot]
            whence[slot] = row
    if old != OWN:
        spare[counts[_SPARE]] = old
        counts[_SPARE] += 1


@kernel(
    types.int64(
        *ARGUMENTS_OF_READING,
        types.int64,
        types.int64,
        types.boolean,
        types.int64,
        types.int64[:, ::1],
        types.boolean[:, ::1],
        types.int64[:, ::1],
        types.int64[:, ::1],
        types.int64[::1],
        types.int64[::1],
    )
)
def hear(
    payloads: bytes,
    most_bytes: int,
    cells: int,
    mask: Genomes,
    low: Fitness,
    high: Fitness,
    header: Header,
    genomes: Genomes,
    fitness: Fitness,
    job: int,
    interval: int,
    champions: bool,
    count: int,
    arrivals: Cells,
    names: NDArray[np.bool_],
    whence: Cells,
    latest: Cells,
    spare: Cells,
    counts: Cells,
) -> int:
    """Read ``count`` messages that lie one after another, and keep those that are sound and of use.

    Args:
        payloads: the messages.
        most_bytes: the longest that can be right.
        cells: how many there are.
        mask: of the alphabet, as are ``low`` and ``high``.
        low: see there.
        high: see there.
        header: of all rows, as are ``genomes`` and ``fitness``.
        genomes: see there.
        fitness: see there.
        job: messages of others are of no use.
        interval: generations between exchanges; 0 in async mode.
        champions: False under the paper's spy, see `wire.exchange_kernels.only_emigrants`.
        count: of messages.
        arrivals: of each message its length, the number of the neighbour and its cell; here the reason comes, or 0.
        names: which slots name which neighbour, shape (neighbours, slots).
        whence: the row of the message for each slot, shape (exchanges, slots).
        latest: shape (exchanges, neighbours): 1 for whom a message has come; in async mode the latest message's number.
        spare: a stack of rows.
        counts: the inbox's.

    Returns how many were refused.
    """
    everything = np.frombuffer(payloads, np.uint8)
    start = np.int64(0)
    refused = 0
    for arrival in arrivals[:count]:
        end, number, row = start + arrival[0], arrival[1], spare[counts[_SPARE] - 1]
        payload = everything[start:end]
        start = end
        own_header, own_genomes, own_fitness = header[row], genomes[row], fitness[row]
        read = read_message(payload, most_bytes, cells, mask, low, high, own_header, own_genomes, own_fitness)
        arrival[3] = -min(0, read)
        if read < 0:
            refused += 1
        elif own_header[JOB] == job and _is_of_use(own_header, interval, latest, number, counts):
            if not champions:
                only_emigrants(own_header, own_genomes, own_fitness, arrival[2])
            place = _note(own_header, interval, latest, number, counts)
            _swap(row, whence[place], names[number], spare, counts)
            counts[_KEPT] += 1
    counts[_REFUSED] += refused
    return refused


@kernel("void(int64[:,::1], int64[::1])")
def turn(latest: Cells, counts: Cells) -> None:
    """In lockstep: the next exchange."""
    latest[counts[_NEXT] % 2] = 0
    counts[_NEXT] += 1
    counts[_LACKING] = latest.shape[1] - np.sum(latest[counts[_NEXT] % 2])


class Inbox:
    """The messages of one cell's neighbours in one job.

    Attributes:
        neighbours: the distinct cells that the cell's slots name, without itself.
        messages: rows for all of them, the cell's own in row `OWN`.
    """

    def __init__(self, plan: Plan, cell: int, job: int) -> None:
        slots = plan.topology.neighbours(cell)
        self.neighbours = tuple(dict.fromkeys(other for other in slots if other != cell))
        self._lockstep = plan.run.mode == "lockstep"
        exchanges, others, limits = 2 if self._lockstep else 1, len(self.neighbours), plan.limits
        self._numbers = {other: number for number, other in enumerate(self.neighbours)}
        self._latest = np.zeros((exchanges, others), np.int64)
        self._whence = np.full((exchanges, len(slots)), OWN)
        self._views = [self._whence[exchange : exchange + 1] for exchange in range(exchanges)]
        self._spare = np.arange(1, 2 + exchanges * others)
        self._counts = np.zeros(_COUNTS, np.int64)
        self._counts[_SPARE] = len(self._spare)
        self._counts[_LACKING] = others
        self._arrivals = np.zeros((_AT_ONCE, 4), np.int64)
        self._names = np.array([[named == other for named in slots] for other in self.neighbours], bool)
        self._names = self._names.reshape(others, len(slots))
        self.messages = Messages.room(1 + len(self._spare), plan.coding.genome_bytes, plan.run.emigrants)
        self._reading = (limits.most_bytes, limits.cells, *limits.alphabet, *self.messages)
        self._judging = (job, plan.run.interval if self._lockstep else 0, plan.run.spy == "champion")

    @property
    def whence(self) -> Cells:
        """The row of the message for each slot, shape (1, slots), of the exchange that is to be bred with next."""
        return self._views[self._counts.item(_NEXT) % 2]

    @property
    def lacking(self) -> int:
        """In lockstep: how many neighbours' messages have not come."""
        return self._counts.item(_LACKING)

    @property
    def kept(self) -> int:
        """How many messages were sound and of use."""
        return self._counts.item(_KEPT)

    @property
    def refused(self) -> int:
        """How many were not what they should be."""
        return self._counts.item(_REFUSED)

    @property
    def lost(self) -> int:
        """In async mode: how many are known not to have come."""
        return self._counts.item(_LOST)

    def missing(self) -> list[int]:
        """In lockstep: the neighbours whose messages have not come."""
        latest = self._latest[self._counts[_NEXT] % 2]
        return [other for other, number in self._numbers.items() if not latest[number]]

    def hear(self, news: Sequence[tuple[int, bytes]]) -> list[tuple[int, str]]:
        """Take in messages, each with its sender. Returns the senders of those that are refused, with the reasons."""
        refusals = []
        for start in range(0, len(news), _AT_ONCE):
            known = [each for each in news[start : start + _AT_ONCE] if each[0] in self._numbers]
            refusals += self._hear(known)
        return refusals

    def _hear(self, news: Sequence[tuple[int, bytes]]) -> list[tuple[int, str]]:
        arrivals, count = self._arrivals, len(news)
        for place, (sender, payload) in enumerate(news):
            arrivals[place] = (len(payload), self._numbers[sender], sender, 0)
        refused = hear(
            b"".join([payload for _, payload in news]),
            *self._reading,
            *self._judging,
            count,
            arrivals,
            self._names,
            self._whence,
            self._latest,
            self._spare,
            self._counts,
        )
        if not refused:
            return []
        return [(sender, REASONS[reason]) for _, _, sender, reason in arrivals[:count].tolist() if reason]

    def take(self) -> Cells:
        """`whence`, for breeding; in lockstep what comes from now on is for later exchanges."""
        whence = self.whence
        if self._lockstep:
            turn(self._latest, self._counts)
        return whence
