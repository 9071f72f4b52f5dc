"""Compiled writing of the exchange message from arrays to msgpack; `wire.exchange_layout` describes both forms."""

from typing import Any

import numpy as np

from lowlevel.compiled import subroutine
from wire.exchange_layout import (
    ARRAY_16,
    BIN_8,
    BIN_32,
    BIRTHPLACE,
    BORN,
    EVALUATIONS,
    FIELDS,
    FIXARRAY,
    FLOAT_64,
    JOB,
    NEVER,
    NIL,
    SENT,
    STOP_AT,
    UINT_8,
    VERSION,
)


# Each writer puts a value at position ``at`` of ``out`` and returns the position after it. None checks whether there is
# room: `wire.limits.Limits.most_bytes` is enough for every message of a job.
@subroutine
def _put(out: Any, at: Any, tag: Any, value: Any, size: Any) -> Any:
    """Write a tag and ``size`` bytes of ``value``, big-endian."""
    out[at] = tag
    for place in range(size):
        out[at + 1 + place] = np.uint8((value >> np.uint64(8 * (size - 1 - place))) & np.uint64(0xFF))
    return at + 1 + size


@subroutine
def _put_count(out: Any, at: Any, count: Any) -> Any:
    """Write an integer in the shortest format, as msgpack libraries do, so that equal messages are equal bytes."""
    value = np.uint64(count)
    if count < 0x80:
        return _put(out, at, count, value, 0)
    size, tag = 1, UINT_8
    while size < 8 and value >> np.uint64(8 * size) != 0:
        size, tag = 2 * size, tag + 1
    return _put(out, at, tag, value, size)


@subroutine
def _put_length(out: Any, at: Any, length: Any) -> Any:
    """Write the head of an array."""
    if length < 16:
        return _put(out, at, FIXARRAY + length, np.uint64(0), 0)
    wide = length > 0xFFFF
    return _put(out, at, ARRAY_16 + wide, np.uint64(length), 4 if wide else 2)


@subroutine
def _put_fitness(out: Any, at: Any, fitness: Any, number: Any) -> Any:
    return _put(out, at, FLOAT_64, fitness.view(np.uint64)[number], 8)


@subroutine
def _put_genome(out: Any, at: Any, genome: Any) -> Any:
    """Write a genome without the zeros at its end: genomes of variable length have room for the longest."""
    length = genome.size
    while length > 0 and genome[length - 1] == 0:
        length -= 1
    size, tag = 1, BIN_8
    while length >> (8 * size) != 0:
        size, tag = 2 * size, tag + 1
    at = _put(out, at, tag, np.uint64(length), size)
    for place in range(length):
        out[at + place] = genome[place]
    return at + length


@subroutine
def write_message(header: Any, genomes: Any, fitness: Any, champion: Any, out: Any) -> Any:
    """Write one row's message into ``out``, with its champion if ``champion``; return the number of bytes."""
    last = fitness.size - 1
    at = _put_length(out, 0, FIELDS)
    at = _put_count(out, at, VERSION)
    for column in range(JOB, STOP_AT):
        at = _put_count(out, at, header[column])
    never = header[STOP_AT] == NEVER
    at = _put(out, at, NIL, np.uint64(0), 0) if never else _put_count(out, at, header[STOP_AT])
    at = _put_length(out, at, last)
    for number in range(last):
        at = _put_length(out, at, 2)
        at = _put_genome(out, at, genomes[number])
        at = _put_fitness(out, at, fitness, number)
    if champion and fitness[last] < np.inf:
        at = _put_length(out, at, 4)
        at = _put_fitness(out, at, fitness, last)
        at = _put_count(out, at, header[BORN])
        at = _put_count(out, at, header[BIRTHPLACE])
        at = _put_genome(out, at, genomes[last])
    else:
        at = _put(out, at, NIL, np.uint64(0), 0)
    at = _put_length(out, at, 2)
    at = _put_count(out, at, header[SENT])
    return _put_count(out, at, header[EVALUATIONS])


@subroutine
def write_state_head(out: Any, at: Any, size: Any) -> Any:
    """Write what precedes a state of ``size`` bytes, after a message that ends at ``at``; return the position after it.

    The message then has one field more.
    """
    _put_length(out, 0, FIELDS + 1)
    return _put(out, at, BIN_32, np.uint64(size), 4)
