"""The layout of the exchange message in arrays and in msgpack, for `wire.exchange_reader` and `wire.exchange_writer`.

A message in arrays is one row of ``header``, of ``genomes`` (the emigrants, then the champion) and of ``fitness`` (in
the same order). In msgpack it is an array of eight:

    [version, job, epoch, generation, stop_at or nil, [[genome, fitness], ...],
     nil or [fitness, generation, cell, genome], [sent, evaluations]]

Every few exchanges a ninth field follows: the sender's state as bytes (`node.engine.state`), which neighbours keep for
a process that takes the sender's place. Here it is bytes of any content.
"""

import numpy as np
from numpy.typing import NDArray

Header = NDArray[np.int64]  # (..., HEADER)

# Columns of a header: the numbers of the job and of the epoch that the fitness values belong to, the sender's
# generation, the earliest stop that it knows (a generation), how many messages it has published in this epoch (this one
# included), how many fitness calls it has made in it, and the champion's generation and cell of birth.
# The order matters: JOB to STOP_AT and SENT to EVALUATIONS stand side by side in a message and are read as ranges.
JOB, EPOCH, GENERATION, STOP_AT, SENT, EVALUATIONS, BORN, BIRTHPLACE = range(8)
HEADER = 8

VERSION = 1
NEVER = 1 << 62
"""``stop_at`` as long as no stop is proposed, so that the earliest stop is a plain minimum.

Counts on the wire are below it. Adding a stop distance to a count does not overflow an int64.
"""

# Why a message is refused. `wire.exchange_reader` returns the negated number: positive results are positions in the
# payload.
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

# The first byte of a value in msgpack (https://github.com/msgpack/msgpack/blob/master/spec.md).
NIL = 0xC0
UNUSED = 0xC1  # the one byte that msgpack never uses
BIN_8 = 0xC4
FLOAT_32 = 0xCA
FLOAT_64 = 0xCB
UINT_8 = 0xCC
INT_8 = 0xD0
INT_64 = 0xD3
FIXARRAY = 0x90
ARRAY_16 = 0xDC
BIN_32 = 0xC6
FIELDS = 8  # without a state
STATE_HEAD = 5  # bytes before a state
