"""Compiled reading of the exchange message from msgpack into arrays: the innermost loop of a node.

`wire.exchange_layout` describes both forms. The msgpack library is no alternative on the hot path: it would build a
Python object for each value, and the fast path (`node.fast_path`) reads messages where no Python code runs. That path
is also why no reader raises an exception: an exception cannot leave a compiled callback. Every value is checked as it
is read. The compiled code has no bounds checks of its own, so each reader compares with the payload's length before it
touches a byte.
"""

from typing import Any

import numpy as np
from numba import types

from genetics.arrays import Cells, Fitness, Genomes
from genetics.sequence_kernels import is_sound_sequence
from lowlevel.compiled import kernel, subroutine
from wire.exchange_layout import (
    ARRAY_16,
    BIN_8,
    BIN_32,
    BIRTHPLACE,
    BORN,
    FIELDS,
    FIXARRAY,
    FLOAT_32,
    FLOAT_64,
    GENERATION,
    GENOME_TOO_LONG,
    INT_8,
    INT_64,
    JOB,
    NEVER,
    NIL,
    NO_SUCH_GENOME,
    NOT_AN_ARRAY,
    NOT_FINITE,
    NOT_MSGPACK,
    OTHER_VERSION,
    OUT_OF_BOUNDS,
    SENT,
    STOP_AT,
    TOO_LONG,
    UINT_8,
    UNUSED,
    VERSION,
    WRONG_SHAPE,
    WRONG_TYPE,
    Header,
)

PAYLOAD = types.Bytes(types.uint8, 1, "C", readonly=True)
"""A Python bytes object, for signatures of kernels."""


# Each reader takes the position ``at`` of a value and returns the position of the next one, after the value itself if
# there is one. A negative position is the negated reason for a refusal; then the value is meaningless. Callers pass a
# negative position on instead of reading further, so the first reason is the one that is reported.
@subroutine
def _raw(payload: Any, at: Any, size: Any) -> Any:
    """Read ``size`` bytes, big-endian, as a uint64."""
    value = np.uint64(0)
    if at + size > len(payload):
        return value, -NOT_MSGPACK
    for place in range(at, at + size):
        value = (value << np.uint64(8)) | np.uint64(payload[place])
    return value, at + size


@subroutine
def _tag(payload: Any, at: Any) -> Any:
    """Return the first byte of a value; at the end of the payload 0xC1, so no caller needs a check of its own."""
    return np.int64(payload[at]) if at < len(payload) else np.int64(UNUSED)


@subroutine
def _other(tag: Any) -> Any:
    """Return the refusal of a value that has another type than expected, or of a payload that ends too early."""
    return -NOT_MSGPACK if tag == UNUSED else -WRONG_TYPE


@subroutine
def _count(payload: Any, at: Any, below: Any) -> Any:
    """Read an integer in [0, below), in any of msgpack's ten integer formats."""
    tag = _tag(payload, at)
    if tag < 0x80:  # the value itself
        return (tag, at + 1) if tag < below else (tag, -OUT_OF_BOUNDS)
    if tag >= 0xE0:  # -32 to -1
        return tag, -OUT_OF_BOUNDS
    if not UINT_8 <= tag <= INT_64:
        return tag, _other(tag)
    size = 1 << (tag - UINT_8) % 4  # four unsigned formats of 1, 2, 4 and 8 bytes, then four signed ones
    value, after = _raw(payload, at + 1, size)
    if after < 0:
        return tag, after
    # Compared as uint64, before the conversion to int64: 2^63 and more would become negative, and so pass.
    negative = tag >= INT_8 and value >> np.uint64(8 * size - 1) != 0
    if negative or value >= np.uint64(below):
        return tag, -OUT_OF_BOUNDS
    return np.int64(value), after


@subroutine
def _length(payload: Any, at: Any) -> Any:
    """Read the length of an array. It only announces elements, perhaps four billion: never allocate by it."""
    tag = _tag(payload, at)
    if tag & 0xF0 == FIXARRAY:
        return tag & 0x0F, at + 1
    if tag not in (ARRAY_16, ARRAY_16 + 1):
        return tag, -NOT_MSGPACK if tag == UNUSED else -WRONG_SHAPE
    length, after = _raw(payload, at + 1, 2 << (tag - ARRAY_16))
    return np.int64(length), after


@subroutine
def _array_of(count: Any, payload: Any, at: Any) -> Any:
    """Return the position of the first element of an array, which must have ``count`` elements."""
    length, after = _length(payload, at)
    if after < 0 or length == count:
        return after
    return -WRONG_SHAPE


@subroutine
def _is_in_alphabet(genome: Any, mask: Any, low: Any, high: Any, items: Any) -> Any:
    """Return whether the coding could have made the genome: `genetics.coding.Alphabet.admits`, compiled.

    Breeding and evaluation index arrays by what genomes contain, without checks of bounds, so a genome that is refused
    here could otherwise make them read or write memory that is not theirs.
    """
    for place in range(genome.size):
        if genome[place] & ~mask[place]:
            return False
    if items.size:
        return is_sound_sequence(genome, items)
    if low.size:
        genes = genome.view(np.float64)
        for gene in range(low.size):
            if not low[gene] <= genes[gene] <= high[gene]:  # NaN compares false, so it is refused too
                return False
    return True


@subroutine
def _genome(payload: Any, at: Any, genome: Any, mask: Any, low: Any, high: Any, items: Any) -> Any:
    """Read bytes into ``genome`` and fill the rest with zeros, which `_put_genome` leaves out; return the position."""
    tag = _tag(payload, at)
    if not BIN_8 <= tag <= BIN_8 + 2:
        return _other(tag)
    size, start = _raw(payload, at + 1, 1 << (tag - BIN_8))
    if start < 0:
        return start
    end = start + np.int64(size)
    if end > len(payload):
        return -NOT_MSGPACK
    if end - start > genome.size:
        return -GENOME_TOO_LONG
    for place in range(end - start):
        genome[place] = payload[start + place]
    for place in range(end - start, genome.size):
        genome[place] = 0
    return end if _is_in_alphabet(genome, mask, low, high, items) else -NO_SUCH_GENOME


@subroutine
def _fitness(payload: Any, at: Any, fitness: Any, number: Any) -> Any:
    """Read a float64 or float32 into ``fitness[number]``; return the position. +inf, infeasible, is a valid fitness."""
    tag = _tag(payload, at)
    if tag == FLOAT_64:
        bits, after = _raw(payload, at + 1, 8)
        fitness.view(np.uint64)[number] = bits  # every bit of it: lockstep runs are repeated bit for bit
    elif tag == FLOAT_32:
        bits, after = _raw(payload, at + 1, 4)
        single = np.array([np.uint32(bits)])
        fitness[number] = single.view(np.float32)[0]
    else:
        return _other(tag)
    if after >= 0 and (np.isnan(fitness[number]) or fitness[number] == -np.inf):
        return -NOT_FINITE
    return after


@subroutine
def _counts(payload: Any, at: Any, header: Any, first: Any, past: Any) -> Any:
    """Read the header's columns from ``first`` up to, but not including, ``past``; return the position."""
    for column in range(first, past):
        if at >= 0:
            header[column], at = _count(payload, at, NEVER)
    return at


@subroutine
def _emigrants(payload: Any, at: Any, mask: Any, low: Any, high: Any, items: Any, genomes: Any, fitness: Any) -> Any:
    """Read exactly as many emigrants as the row has room for; return the position."""
    emigrants = fitness.size - 1
    at = _array_of(emigrants, payload, at)
    for number in range(emigrants):
        if at >= 0:
            at = _array_of(2, payload, at)
        if at >= 0:
            at = _genome(payload, at, genomes[number], mask, low, high, items)
        if at >= 0:
            at = _fitness(payload, at, fitness, number)
    return at


@subroutine
def _champion(
    payload: Any,
    at: Any,
    cells: Any,
    mask: Any,
    low: Any,
    high: Any,
    items: Any,
    header: Any,
    genome: Any,
    fitness: Any,
) -> Any:
    """Read the champion, or nil, into the row's last place; return the position."""
    last = fitness.size - 1
    if _tag(payload, at) == NIL:
        # The row may hold an older message. With this fitness nothing looks at the genome that is still there.
        fitness[last] = np.inf
        header[BORN] = NEVER
        header[BIRTHPLACE] = 0
        return at + 1
    at = _array_of(4, payload, at)
    if at >= 0:
        at = _fitness(payload, at, fitness, last)
    if at >= 0:
        header[BORN], at = _count(payload, at, NEVER)
    if at >= 0:
        header[BIRTHPLACE], at = _count(payload, at, cells)
    if at >= 0:
        at = _genome(payload, at, genome, mask, low, high, items)
    return at


@subroutine
def read_message(
    payload: Any,
    most_bytes: Any,
    cells: Any,
    mask: Any,
    low: Any,
    high: Any,
    items: Any,
    header: Any,
    genomes: Any,
    fitness: Any,
) -> Any:
    """Read a message, an array of bytes, into one row: (HEADER,), (emigrants + 1, genome_bytes), (emigrants + 1,).

    Returns the position after the eighth field, where a state may follow (`state_at`), or the negated reason for which
    the message is refused. A refused message leaves the row partly overwritten: pass a spare row, as the inbox does. A
    message without a champion sets the champion's fitness to +inf and leaves its genome as it was.
    """
    if len(payload) > most_bytes:  # first: it bounds the time that any payload can take
        return -TOO_LONG
    length, at = _length(payload, 0)
    if at < 0:
        return -NOT_AN_ARRAY if at == -WRONG_SHAPE else at
    if length not in (FIELDS, FIELDS + 1):
        return -WRONG_SHAPE
    version, after = _count(payload, at, NEVER)
    if version != VERSION or after < 0:
        return -NOT_MSGPACK if after == -NOT_MSGPACK else -OTHER_VERSION
    at = _counts(payload, after, header, JOB, STOP_AT)
    if at >= 0 and _tag(payload, at) == NIL:
        header[STOP_AT], at = NEVER, at + 1
    else:
        at = _counts(payload, at, header, STOP_AT, SENT)
    if at >= 0:
        at = _emigrants(payload, at, mask, low, high, items, genomes, fitness)
    if at >= 0:
        at = _champion(payload, at, cells, mask, low, high, items, header, genomes[-1], fitness)
    if at >= 0:
        at = _array_of(2, payload, at)
    at = _counts(payload, at, header, SENT, BORN)
    if at >= 0:
        at = min(at, state_at(payload, at) if length > FIELDS else _end(payload, at))
    return at


@subroutine
def _end(payload: Any, at: Any) -> Any:
    """Return ``at`` if the payload ends there; something else must not follow a message."""
    return at if at == len(payload) else -NOT_MSGPACK


@subroutine
def state_at(payload: Any, at: Any) -> Any:
    """Return where the bytes of a state begin, whose field is at ``at``; it must reach to the end of the payload."""
    tag = _tag(payload, at)
    if not BIN_8 <= tag <= BIN_32:
        return _other(tag)
    size, start = _raw(payload, at + 1, 1 << (tag - BIN_8))
    if start < 0 or start + np.int64(size) != len(payload):
        return -NOT_MSGPACK
    return start


@kernel(
    types.int64(
        PAYLOAD,
        types.int64,
        types.int64,
        types.uint8[::1],
        types.float64[::1],
        types.float64[::1],
        types.int64[::1],
        types.int64[:, ::1],
        types.uint8[:, :, ::1],
        types.float64[:, ::1],
        types.int64,
    )
)
def decode(
    payload: bytes,
    most_bytes: int,
    cells: int,
    mask: Genomes,
    low: Fitness,
    high: Fitness,
    items: Cells,
    header: Header,
    genomes: Genomes,
    fitness: Fitness,
    row: int,
) -> int:
    """Call `read_message` for one row of the arrays; return 0, or the negated reason for which it is refused."""
    bytes_of = np.frombuffer(payload, np.uint8)
    end: int = read_message(
        bytes_of, most_bytes, cells, mask, low, high, items, header[row], genomes[row], fitness[row]
    )
    return min(0, end)


@subroutine
def only_emigrants(header: Any, genomes: Any, fitness: Any, sender: Any) -> Any:
    """Put the sender's best emigrant in the place of its champion, for ``--spy root``, where no champion is sent.

    The rules that merge champions then need no second case.
    """
    header[BORN] = header[GENERATION]
    header[BIRTHPLACE] = sender
    genomes[-1] = genomes[0]
    fitness[-1] = fitness[0]


@kernel("void(int64[:,::1], uint8[:,:,::1], float64[:,::1], int64[::1])")
def hear_emigrants_only(header: Header, genomes: Genomes, fitness: Fitness, senders: Cells) -> None:
    """Call `only_emigrants` for one message of each of the ``senders`` (cells)."""
    for row in range(senders.size):
        only_emigrants(header[row], genomes[row], fitness[row], senders[row])
