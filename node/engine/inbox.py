"""The inbox of a cell: neighbours' messages as rows of arrays, which breeding uses without a copy.

A message is decoded into a spare row. If it is kept, slots point to that row; otherwise the next message overwrites it.
In lockstep the messages of two exchanges are kept apart, since a neighbour may be one exchange ahead; in async mode the
latest message of each neighbour is kept. One compiled call decodes, checks and keeps any number of messages.

An inbox is not thread-safe: `node.process` says which thread may use it when.
"""

import struct
from collections.abc import Sequence
from functools import partial
from itertools import compress
from typing import Any

import numpy as np
from numba import types

from genetics import Cells
from genetics.operators import TABLE, Table
from lowlevel.compiled import kernel, subroutine
from lowlevel.pointers import integers, octets, octets_of, reals
from node.engine import ring
from node.engine.kernels import OWN, PUBLISHED
from node.engine.layout import RowLayout, TableLayout
from node.engine.state_size import LEAST_DISTANCE
from node.plan import Plan
from topologies import first_neighbour
from wire.exchange import Messages
from wire.exchange_layout import EPOCH, GENERATION, JOB, NEVER, SENT, STOP_AT
from wire.exchange_reader import PAYLOAD, only_emigrants, read_message, state_at
from wire.report import Staleness

# What an inbox counts.
_COUNT = RowLayout()
NEXT = _COUNT.column("next")  # the number of the next exchange
_SPARE = _COUNT.column("spare")  # rows that are free
MISSING = _COUNT.column("missing")  # in lockstep the neighbours whose messages for that exchange have not come
_KEPT = _COUNT.column("kept")  # messages
_REFUSED = _COUNT.column("refused")
_LOST = _COUNT.column("lost")  # in async mode
_OF_NO_USE = _COUNT.column("of_no_use")  # sound, but repeated or out of time
_LEAST_STOP = _COUNT.column("least_stop")  # the earliest generation after which others want to stop

# The table by which compiled code finds an inbox's arrays.
_TABLE = TableLayout()
_HEADER = _TABLE.integers("header")  # the rows of `Inbox.messages`
_GENOMES = _TABLE.octets("genomes")
_FITNESS = _TABLE.reals("fitness")
_MASK = _TABLE.octets("mask")  # what a genome may be, see `genetics.coding.Alphabet`
_LOW = _TABLE.reals("low")
_HIGH = _TABLE.reals("high")
_ITEMS = _TABLE.integers("items")
_NAMES = _TABLE.octets("names")  # (neighbours, slots): 1 where the slot names the neighbour
_SENDERS = _TABLE.integers("senders")  # (neighbours,): their cells
_SOURCE_ROWS = _TABLE.integers("source_rows")
_LATEST = _TABLE.integers("latest")
_SPARES = _TABLE.integers("spares")  # the rows that are free, as many as `_SPARE` says
_COUNTS = _TABLE.integers("counts")  # the columns of `_COUNT`
_LIMITS = _TABLE.integers("limits")  # the columns of `_LIMIT`
_STATES = _TABLE.octets("states")  # (neighbours, ...): their states, see `node.engine.ring`
_STATE_ENTRIES = _TABLE.integers("state_entries")
_STATE_MARKS = _TABLE.integers("state_marks")

# What messages must fit.
_LIMIT = RowLayout()
_MOST_BYTES = _LIMIT.column("most_bytes")
_CELLS = _LIMIT.column("cells")
_JOB = _LIMIT.column("job")
_EPOCH = _LIMIT.column("epoch")
_INTERVAL = _LIMIT.column("interval")  # 0 in async mode
_CHAMPIONS = _LIMIT.column("champions")  # whether they may carry one

_STATES_OF_EACH = 3  # with fewer the states of two neighbouring cells could lack a common generation

_mark = struct.Struct("<2q").pack  # precedes each of several packed messages: its sender and its length


@subroutine
def _is_of_use(header: Any, interval: Any, latest: Any, number: Any, counts: Any) -> Any:
    """Return whether to keep a sound message.

    In lockstep it must be for the next exchange or the one after that, and its sender's first for it (``latest`` is 1
    until it has come). No sound neighbour is further ahead, since it waits for this cell.

    In async mode (an interval of 0) it must be newer than the sender's latest: the same message may come twice, by a
    direct link and through the router, and one may overtake another.
    """
    if interval == 0:
        return header[SENT] > latest[0, number]
    exchange = header[GENERATION] // interval
    in_time = 0 <= exchange - counts[NEXT] <= 1
    return in_time and header[GENERATION] % interval == 0 and latest[exchange % 2, number]


@subroutine
def _note(header: Any, interval: Any, latest: Any, number: Any, counts: Any) -> Any:
    """Note that a message has come; return the place of its exchange, 0 or 1 (in async mode always 0)."""
    if interval == 0:
        counts[_LOST] += header[SENT] - 1 - latest[0, number]  # senders number their messages without gaps
        latest[0, number] = header[SENT]
        return 0
    exchange = header[GENERATION] // interval
    latest[exchange % 2, number] = 0
    counts[MISSING] -= exchange == counts[NEXT]
    return exchange % 2


@subroutine
def _swap(row: Any, source_row: Any, names: Any, spare: Any, counts: Any) -> Any:
    """Point the slots marked in ``names`` to the spare ``row``; the row that they pointed to becomes spare.

    The rows `OWN` and `PUBLISHED`, to which slots point before any message has come, never become spare.
    """
    counts[_SPARE] -= 1
    old = np.int64(PUBLISHED)
    for slot in range(source_row.size):
        if names[slot]:
            old = source_row[slot]
            source_row[slot] = row
    if old > PUBLISHED:
        spare[counts[_SPARE]] = old
        counts[_SPARE] += 1


@subroutine
def _keep_state(table: Any, state: Any, header: Any, number: Any, interval: Any) -> Any:
    """Keep a state of neighbour ``number``, for the process that takes its place; once, as messages come again.

    One of a generation in which others tell none makes room for the next: else cells that die together may share none.
    """
    room, marks = octets(table, _STATES)[number], integers(table, _STATE_MARKS)[number]
    entries = integers(table, _STATE_ENTRIES)[number * _STATES_OF_EACH : (number + 1) * _STATES_OF_EACH]
    most = room.size // _STATES_OF_EACH  # each has a place of this size, so none is lost to a gap at the end
    if state.size <= most and not ring.has(entries, marks, header[GENERATION]):
        if interval > 0:
            ring.drop_latest_unless_multiple(entries, marks, interval * LEAST_DISTANCE)
        start = ring.begin(room, entries, marks, most)
        room[start : start + state.size] = state
        ring.end(entries, marks, start, state.size, header[GENERATION])
        ring.leave_gap(marks, start + most)


@subroutine
def _take_in(table: Any, limits: Any, payload: Any, number: Any, counts: Any) -> Any:
    """Decode a message of neighbour ``number`` into a spare row, and keep it if it is of use.

    Returns minus the reason why the message is refused, 0 if it is of another job or epoch, else 1.
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
    counts[_LEAST_STOP] = min(counts[_LEAST_STOP], header[STOP_AT])
    if _is_of_use(header, limits[_INTERVAL], latest, number, counts):
        if not limits[_CHAMPIONS]:
            only_emigrants(header, genomes, fitness[row], integers(table, _SENDERS)[0, number])
        place = _note(header, limits[_INTERVAL], latest, number, counts)
        _swap(row, integers(table, _SOURCE_ROWS)[place], octets(table, _NAMES)[number], spare, counts)
        counts[_KEPT] += 1
    else:
        counts[_OF_NO_USE] += 1
    # The state counts also if the message does not: this cell may have just begun in the place of a dead one.
    if end < len(payload):
        _keep_state(table, payload[state_at(payload, end) :], header, number, limits[_INTERVAL])
    return 1


@subroutine
def take_in_one(table: Any, payload: Any, sender: Any) -> Any:
    """`_take_in` a message of the cell ``sender``; return 0 also if that is no neighbour.

    The search is linear: a cell has a handful of neighbours.
    """
    limits, counts, senders = integers(table, _LIMITS)[0], integers(table, _COUNTS)[0], integers(table, _SENDERS)[0]
    for number in range(senders.size):
        if senders[number] == sender:
            return _take_in(table, limits, payload, number, counts)
    return 0


@subroutine
def _integer_at(everything: Any, at: Any) -> Any:
    """Read a little-endian int64 at any offset, aligned or not."""
    value = np.int64(0)
    for place in range(8):
        value |= np.int64(everything[at + place]) << (8 * place)
    return value


@kernel(types.int64(PAYLOAD, TABLE))
def hear(news: bytes, table: Table) -> int:
    """Decode `packed` messages and keep those that are sound and of use; return how many were refused.

    Messages that no neighbour has sent are skipped.
    """
    everything = octets_of(news)
    start = np.int64(0)
    refused = 0
    while start < everything.size:
        sender, size = _integer_at(everything, start), _integer_at(everything, start + 8)
        start += 16
        refused += take_in_one(table, everything[start : start + size], sender) < 0
        start += size
    integers(table, _COUNTS)[0, _REFUSED] += refused
    return refused


@kernel("void(int64[:,::1], int64[::1])")
def next_exchange(latest: Cells, counts: Cells) -> None:
    """In lockstep move on to the next exchange; the place of the finished one then waits for the one after that."""
    latest[counts[NEXT] % 2] = 1
    counts[NEXT] += 1
    counts[MISSING] = np.sum(latest[counts[NEXT] % 2])


def packed(news: Sequence[tuple[int, bytes]]) -> bytes:
    """Return messages as `hear` takes them: one after another, each preceded by its sender and its length."""
    return b"".join([_mark(sender, len(payload)) + payload for sender, payload in news])


class Inbox:
    """The messages of one cell's neighbours in one epoch of a job.

    Attributes:
        neighbours: the distinct cells that the cell's slots name, without the cell itself.
        messages: rows for all messages; the cell's own are in rows `OWN` and `PUBLISHED`.
        source_rows: for each slot the row of its message, shape (exchanges kept apart, slots).
        latest: shape (exchanges kept apart, neighbours). In lockstep 1 until the neighbour's message has come, then 0;
            in async mode the number of the neighbour's latest message.
        counts: see the constants of this module, shape (columns,).
        used: in async mode the number of the message that each slot gave last, shape (slots,).
        staleness: in async mode the counts of `wire.report.Staleness`.
        missing_count: in lockstep a function that returns how many neighbours' messages for the next exchange have not
            come. It is a bound C method, because it is called in each generation.
        rings: the latest states of each neighbour. Each has a ring of its own: one may send them more often.
        table: pointers to everything that `hear` works on.
    """

    def __init__(self, plan: Plan, cell: int, job: int) -> None:
        slots = plan.topology.neighbours(cell)
        self.neighbours = tuple(dict.fromkeys(other for other in slots if other != cell))
        self._lockstep = plan.run.mode == "lockstep"
        exchanges, others = 2 if self._lockstep else 1, len(self.neighbours)
        self._limits = plan.limits
        self._numbers = {other: number for number, other in enumerate(self.neighbours)}
        self._told_here = {other for other in self.neighbours if first_neighbour(plan.topology, other) == cell}
        self.latest = np.full((exchanges, others), int(self._lockstep))
        self._not_come = tuple(exchange.tolist for exchange in self.latest)
        # A slot points to one of these two rows if it names the cell itself, or a neighbour that has not sent anything
        # yet. A single individual breeds with the message that it published last: its own row changes in generations
        # between exchanges too.
        # An island takes nothing in from itself: `admit_row` skips the row OWN.
        self.source_rows = np.full((exchanges, len(slots)), PUBLISHED if plan.run.deme == 1 else OWN)
        self.used = np.zeros(len(slots), np.int64)
        self.staleness = np.zeros(len(Staleness._fields), np.int64)
        spare = np.arange(2, 3 + exchanges * others)  # one for each message that may be kept, and one to decode into
        room = _STATES_OF_EACH * plan.limits.most_state_bytes
        rooms, entries, marks = ring.arrays(others, room, _STATES_OF_EACH)
        self.rings = [ring.Ring(*its) for its in zip(rooms, entries, marks, strict=True)]
        self.counts = _COUNT.zeros()
        self.counts[_SPARE], self.counts[MISSING], self.counts[_LEAST_STOP] = len(spare), others, NEVER
        self.missing_count = partial(self.counts.item, MISSING)
        self.messages = Messages.room(2 + len(spare), plan.coding.genome_bytes, plan.run.emigrants)
        names = np.array([[named == other for named in slots] for other in self.neighbours], np.uint8)
        header, genomes, fitness = self.messages
        mask, low, high, items = (np.atleast_2d(each) for each in plan.limits.alphabet)
        # The table holds bare addresses: these arrays must live as long, and must never be replaced.
        self._kept: dict[str, Any] = {
            "header": header,
            "genomes": genomes,
            "fitness": fitness,
            "mask": mask,
            "low": low,
            "high": high,
            "items": items,
            "names": names.reshape(others, len(slots)),
            "senders": np.array([self.neighbours], np.int64),
            "source_rows": self.source_rows,
            "latest": self.latest,
            "spares": spare,
            "counts": self.counts,
            "limits": self._limits_row(plan, job),
            "states": rooms,
            "state_entries": entries,
            "state_marks": marks,
        }
        self.table = _TABLE.build(**self._kept)

    def _limits_row(self, plan: Plan, job: int) -> Any:
        return _LIMIT.build(
            most_bytes=plan.limits.most_bytes,
            cells=plan.limits.cells,
            job=job,
            epoch=plan.epoch,
            interval=plan.run.interval if self._lockstep else 0,
            champions=plan.run.spy == "champion",
        )

    def go_on_from(self, generation: int, interval: int) -> None:
        """In lockstep expect the messages of a generation first, as if all before had come.

        What has come already was kept as if it were of the first exchanges, so it does not count.
        """
        self.latest[:] = 1
        self.counts[MISSING] = len(self.neighbours)
        self.counts[NEXT] = generation // interval
        self.counts[_KEPT] = self.exchange * len(self.neighbours)

    def heard(self) -> dict[int, int]:
        """Return, in lockstep, up to which exchange all messages of each neighbour have come; 0 also if none has."""
        now, after = self._not_come[self.exchange % 2](), self._not_come[(self.exchange + 1) % 2]()
        come = [0 if this else 1 if following else 2 for this, following in zip(now, after, strict=True)]
        return {other: max(0, self.exchange - 1 + each) for other, each in zip(self.neighbours, come, strict=True)}

    @property
    def states(self) -> tuple[tuple[int, int, bytes], ...]:
        """The latest states of the neighbours, each with its cell and its generation; those of a cell in order."""
        return tuple((other, *each) for other, its in zip(self.neighbours, self.rings, strict=True) for each in its)

    def states_told_once(self) -> tuple[tuple[int, int, bytes], ...]:
        """Return the latest states of the neighbours that name this cell first; another cell tells the others'."""
        return tuple(each for each in self.states if each[0] in self._told_here)

    @property
    def kept(self) -> int:
        """The number of messages that were sound and of use."""
        return self.counts.item(_KEPT)

    @property
    def refused(self) -> int:
        """The number of messages that were malformed or out of bounds."""
        return self.counts.item(_REFUSED)

    @property
    def lost(self) -> int:
        """In async mode the number of messages known not to have come, by gaps in their numbers."""
        return self.counts.item(_LOST)

    @property
    def of_no_use(self) -> int:
        """The number of messages that were sound, but too late, too early or repeated."""
        return self.counts.item(_OF_NO_USE)

    def note_stop(self, stop_at: int) -> None:
        """Note a generation after which others will stop."""
        self.counts[_LEAST_STOP] = min(stop_at, self.least_stop)

    @property
    def least_stop(self) -> int:
        """The earliest generation after which others want to stop, also by messages that were of no use; or NEVER."""
        return self.counts.item(_LEAST_STOP)

    @property
    def exchange(self) -> int:
        """In lockstep the number of the next exchange."""
        return self.counts.item(NEXT)

    def validate(self) -> None:
        """Check that every row is either free or that of one neighbour's message, and the counts.

        Raises:
            AssertionError: if something does not hold.
        """
        free = self._kept["spares"][: self.counts.item(_SPARE)].tolist()
        in_use = [set(rows) - {OWN, PUBLISHED} for rows in self.source_rows.tolist()]
        rows = sorted([*free, *(row for exchange in in_use for row in exchange)])
        assert rows == list(range(2, len(self.messages.header))), f"rows are lost, or used twice: {rows}"
        assert not self._lockstep or self.missing_count() == len(self.missing_senders()), "the number missing is wrong"
        assert (self.counts >= 0).all(), f"negative counts: {self.counts}"

    def missing_senders(self) -> set[int]:
        """Return, in lockstep, the neighbours whose messages for the next exchange have not come."""
        return set(compress(self.neighbours, self._not_come[self.exchange % 2]()))

    def hear(self, news: Sequence[tuple[int, bytes]]) -> set[tuple[int, str]]:
        """Take in messages, each with its sender; return the senders of refused ones, each with the reason."""
        return self.complaints(news) if news and hear(packed(news), self.table) else set()

    def complaints(self, news: Sequence[tuple[int, bytes]]) -> set[tuple[int, str]]:
        """Return the senders of those of these messages that are refused, each with the reason.

        This decodes them a second time; the compiled call only counts refusals, since there are hardly any.
        """
        reasons = {(sender, self._reason(payload)) for sender, payload in news if sender in self._numbers}
        return {(sender, reason) for sender, reason in reasons if reason is not None}

    def _reason(self, payload: bytes) -> str | None:
        """Return why a message is refused; None if it is not."""
        spare = Messages.room(1, self._limits.genome_bytes, self._limits.emigrants)
        return spare.decode(0, payload, self._limits)
