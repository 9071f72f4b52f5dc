"""The exchange message between msgpack and arrays, compiled: reading one is the innermost loop of a node.

A message in arrays is a row of `header`, of `genomes` (the emigrants, then the champion) and of `fitness` (theirs).
What may be in it is checked as it is read; whatever comes, nothing is raised and nothing is read beyond its end.
"""

from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from genetics.arrays import Cells, Fitness, Genomes
from genetics.sequence_kernels import is_sound_sequence
from lowlevel.compiled import kernel, subroutine

Header = NDArray[np.int64]  # (..., HEADER)

# Columns of a header: the numbers of the job and of the epoch that the fitness values belong to, the sender's
# generation, the least generation of a stop that it knows, how many messages it has published for this job (this one
# included), how many fitness calls it has made, and when and where the champion was born.
JOB, EPOCH, GENERATION, STOP_AT, SENT, EVALUATIONS, BORN, BIRTHPLACE = range(8)
HEADER = 8

VERSION = 1
NEVER = 1 << 62
"""The generation of a stop that nobody has proposed; counts on the wire are less."""

# Why a message is refused: `decode` returns minus one of these.
(
    TOO_LONG,
    NOT_MSGPACK,
    NOT_AN_ARRAY,
    WRONG_SHAPE,
    WRONG_TYPE,
    OUT_OF_BOUNDS,
    NOT_FINITE,
    OTHER_VERSION,
    GENOME_TOO_LONG,
    NO_SUCH_GENOME,
) = range(1, 11)

_NIL = 0xC0
_UNUSED = 0xC1
_BIN_8 = 0xC4
_FLOAT_32 = 0xCA
_FLOAT_64 = 0xCB
_UINT_8 = 0xCC
_INT_8 = 0xD0
_INT_64 = 0xD3
_FIXARRAY = 0x90
_ARRAY_16 = 0xDC
_FIELDS = 8
PAYLOAD = types.Bytes(types.uint8, 1, "C", readonly=True)


# Reading: each subroutine returns what it read and where the next value starts, or minus the reason in its place. -----
@subroutine
def _raw(payload: Any, at: Any, size: Any) -> Any:
    """``size`` bytes, big-endian, as a uint64."""
    value = np.uint64(0)
    if at + size > len(payload):
        return value, -NOT_MSGPACK
    for place in range(at, at + size):
        value = (value << np.uint64(8)) | np.uint64(payload[place])
    return value, at + size


@subroutine
def _tag(payload: Any, at: Any) -> Any:
    """The byte that says what follows; 0xC1, which never does, stands for the end of the payload too."""
    return np.int64(payload[at]) if at < len(payload) else np.int64(_UNUSED)


@subroutine
def _other(tag: Any) -> Any:
    """Why a value of another type than expected is refused."""
    return -NOT_MSGPACK if tag == _UNUSED else -WRONG_TYPE


@subroutine
def _count(payload: Any, at: Any, below: Any) -> Any:
    """An integer in [0, below)."""
    tag = _tag(payload, at)
    if tag < 0x80:
        return (tag, at + 1) if tag < below else (tag, -OUT_OF_BOUNDS)
    if tag >= 0xE0:  # -32 to -1
        return tag, -OUT_OF_BOUNDS
    if not _UINT_8 <= tag <= _INT_64:
        return tag, _other(tag)
    size = 1 << (tag - _UINT_8) % 4
    value, after = _raw(payload, at + 1, size)
    if after < 0:
        return tag, after
    negative = tag >= _INT_8 and value >> np.uint64(8 * size - 1) != 0
    if negative or value >= np.uint64(below):
        return tag, -OUT_OF_BOUNDS
    return np.int64(value), after


@subroutine
def _length(payload: Any, at: Any) -> Any:
    """The length of an array."""
    tag = _tag(payload, at)
    if tag & 0xF0 == _FIXARRAY:
        return tag & 0x0F, at + 1
    if tag not in (_ARRAY_16, _ARRAY_16 + 1):
        return tag, -NOT_MSGPACK if tag == _UNUSED else -WRONG_SHAPE
    length, after = _raw(payload, at + 1, 2 << (tag - _ARRAY_16))
    return np.int64(length), after


@subroutine
def _array_of(count: Any, payload: Any, at: Any) -> Any:
    """Where the first element of an array of ``count`` starts."""
    length, after = _length(payload, at)
    if after < 0 or length == count:
        return after
    return -WRONG_SHAPE


@subroutine
def _is_in_alphabet(genome: Any, mask: Any, low: Any, high: Any, items: Any) -> Any:
    """See `genetics.coding.Alphabet`."""
    for place in range(genome.size):
        if genome[place] & ~mask[place]:
            return False
    if items.size:
        return is_sound_sequence(genome, items)
    if low.size:
        genes = genome.view(np.float64)
        for gene in range(low.size):
            if not low[gene] <= genes[gene] <= high[gene]:
                return False
    return True


@subroutine
def _genome(payload: Any, at: Any, genome: Any, mask: Any, low: Any, high: Any, items: Any) -> Any:
    """Fill ``genome``, with zeros beyond what came; returns where the next value starts."""
    tag = _tag(payload, at)
    if not _BIN_8 <= tag <= _BIN_8 + 2:
        return _other(tag)
    size, start = _raw(payload, at + 1, 1 << (tag - _BIN_8))
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
    """Fill ``fitness[number]``; returns where the next value starts."""
    tag = _tag(payload, at)
    if tag == _FLOAT_64:
        bits, after = _raw(payload, at + 1, 8)
        fitness.view(np.uint64)[number] = bits
    elif tag == _FLOAT_32:
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
    """Fill the header's columns from ``first`` to before ``past``; returns where the next value starts."""
    for column in range(first, past):
        if at >= 0:
            header[column], at = _count(payload, at, NEVER)
    return at


@subroutine
def _emigrants(payload: Any, at: Any, mask: Any, low: Any, high: Any, items: Any, genomes: Any, fitness: Any) -> Any:
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
    last = fitness.size - 1
    if _tag(payload, at) == _NIL:
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
    """Fill one row's arrays, (HEADER,), (emigrants + 1, genome_bytes), (emigrants + 1,), from an array of bytes.

    Returns a positive number, or minus the reason why the message is refused; then the row holds anything. A message
    without a champion leaves the fitness +inf there, and its genome as it was.
    """
    if len(payload) > most_bytes:
        return -TOO_LONG
    length, at = _length(payload, 0)
    if at < 0:
        return -NOT_AN_ARRAY if at == -WRONG_SHAPE else at
    if length != _FIELDS:
        return -WRONG_SHAPE
    version, after = _count(payload, at, NEVER)
    if version != VERSION or after < 0:
        return -NOT_MSGPACK if after == -NOT_MSGPACK else -OTHER_VERSION
    at = _counts(payload, after, header, JOB, STOP_AT)
    if at >= 0 and _tag(payload, at) == _NIL:
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
    if at >= 0 and at != len(payload):
        return -NOT_MSGPACK
    return at


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
    """`read_message` into one row of the arrays; returns 0, or minus the reason why the message is refused."""
    bytes_of = np.frombuffer(payload, np.uint8)
    end: int = read_message(
        bytes_of, most_bytes, cells, mask, low, high, items, header[row], genomes[row], fitness[row]
    )
    return min(0, end)


@subroutine
def only_emigrants(header: Any, genomes: Any, fitness: Any, sender: Any) -> Any:
    """Under the paper's spy a sender's best emigrant is all that is heard of it: only the spy looks at champions."""
    header[BORN] = header[GENERATION]
    header[BIRTHPLACE] = sender
    genomes[-1] = genomes[0]
    fitness[-1] = fitness[0]


@kernel("void(int64[:,::1], uint8[:,:,::1], float64[:,::1], int64[::1])")
def hear_emigrants_only(header: Header, genomes: Genomes, fitness: Fitness, senders: Cells) -> None:
    """`only_emigrants` for one message of each of the ``senders``."""
    for row in range(senders.size):
        only_emigrants(header[row], genomes[row], fitness[row], senders[row])


# Writing --------------------------------------------------------------------------------------------------------------
@subroutine
def _put(out: Any, at: Any, tag: Any, value: Any, size: Any) -> Any:
    """A tag and ``size`` bytes of ``value``, big-endian."""
    out[at] = tag
    for place in range(size):
        out[at + 1 + place] = np.uint8((value >> np.uint64(8 * (size - 1 - place))) & np.uint64(0xFF))
    return at + 1 + size


@subroutine
def _put_count(out: Any, at: Any, count: Any) -> Any:
    """In the shortest form, as every msgpack library writes it."""
    value = np.uint64(count)
    if count < 0x80:
        return _put(out, at, count, value, 0)
    size, tag = 1, _UINT_8
    while size < 8 and value >> np.uint64(8 * size) != 0:
        size, tag = 2 * size, tag + 1
    return _put(out, at, tag, value, size)


@subroutine
def _put_length(out: Any, at: Any, length: Any) -> Any:
    if length < 16:
        return _put(out, at, _FIXARRAY + length, np.uint64(0), 0)
    wide = length > 0xFFFF
    return _put(out, at, _ARRAY_16 + wide, np.uint64(length), 4 if wide else 2)


@subroutine
def _put_fitness(out: Any, at: Any, fitness: Any, number: Any) -> Any:
    return _put(out, at, _FLOAT_64, fitness.view(np.uint64)[number], 8)


@subroutine
def _put_genome(out: Any, at: Any, genome: Any) -> Any:
    """Zeros at its end, where a genome of another length may go on, do not travel."""
    length = genome.size
    while length > 0 and genome[length - 1] == 0:
        length -= 1
    size, tag = 1, _BIN_8
    while length >> (8 * size) != 0:
        size, tag = 2 * size, tag + 1
    at = _put(out, at, tag, np.uint64(length), size)
    for place in range(length):
        out[at + place] = genome[place]
    return at + length


@subroutine
def write_message(header: Any, genomes: Any, fitness: Any, champion: Any, out: Any) -> Any:
    """`encode` for one row."""
    last = fitness.size - 1
    at = _put_length(out, 0, _FIELDS)
    at = _put_count(out, at, VERSION)
    for column in range(JOB, STOP_AT):
        at = _put_count(out, at, header[column])
    never = header[STOP_AT] == NEVER
    at = _put(out, at, _NIL, np.uint64(0), 0) if never else _put_count(out, at, header[STOP_AT])
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
        at = _put(out, at, _NIL, np.uint64(0), 0)
    at = _put_length(out, at, 2)
    at = _put_count(out, at, header[SENT])
    return _put_count(out, at, header[EVALUATIONS])


@kernel("int64(int64[:,::1], uint8[:,:,::1], float64[:,::1], int64, boolean, uint8[::1])")
def encode(header: Header, genomes: Genomes, fitness: Fitness, row: int, champion: bool, out: Genomes) -> int:
    """Write one row as a message into ``out``, with its ``champion`` if there is one; returns how many bytes."""
    end: int = write_message(header[row], genomes[row], fitness[row], champion, out)
    return end
