"""A cell's state as bytes: what another process needs to go on from it, bit for bit.

Every few exchanges a message carries the sender's state (`node.engine.rule`). The neighbours keep the latest ones. When
the process of a cell dies, another one takes a state from a neighbour and asks the neighbours for their messages since
(`node.cell.Cell`). Random draws have keys, so it breeds what its predecessor bred.

A state is that of a generation whose message has been written. It holds, without gaps: the cell's own message in
arrays, the deme, the digest of its history, and the latest improvements that it has noted. A proposal to stop is not in
it: no state is written once one is known.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lowlevel.compiled import subroutine
from lowlevel.pointers import integers, octets, reals
from node.engine import cell_table as at
from node.engine.kernels import OWN
from node.engine.state_size import BIRTHPLACE_BITS, MOST_IMPROVEMENTS, births_of


@subroutine
def _put(out: Any, place: Any, values: Any) -> Any:
    """Write a row of numbers; return the place after it."""
    octets_of = values.view(np.uint8)
    out[place : place + octets_of.size] = octets_of
    return place + octets_of.size


@subroutine
def write_state(table: Any, out: Any) -> Any:
    """Write the cell's state into ``out``; return its size in bytes. The order of the parts is that of `read_state`."""
    fitness, count = reals(table, at.FITNESS)[OWN], integers(table, at.BIRTH_COUNT)[0, 0]
    first = max(0, count - MOST_IMPROVEMENTS)
    out[0] = count - first
    place = _put(out, 1, integers(table, at.HEADER)[OWN])
    place = _put(out, place, integers(table, at.BETTER_AT)[0])
    place = _put(out, place, integers(table, at.DIGEST)[0])
    place = _put(out, place, reals(table, at.NOTED_FITNESS)[0])
    place = _put(out, place, fitness)
    place = _put(out, place, reals(table, at.DEME_FITNESS)[0])
    births = integers(table, at.BIRTHS)[first:count]
    place = _put(out, place, (births[:, 0] << BIRTHPLACE_BITS) | births[:, 1])
    place = _put(out, place, reals(table, at.BIRTH_FITNESS)[0, first:count])
    for genome in octets(table, at.GENOMES)[: fitness.size]:
        place = _put(out, place, genome)
    for genome in octets(table, at.DEME):
        place = _put(out, place, genome)
    return place


def read_state(state: bytes, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Read a state that `write_state` has written into the ``arrays`` of a cell's table.

    Raises:
        ValueError: if it has another size than a state of this cell.
    """
    count = min(state[0], MOST_IMPROVEMENTS) if state else 0
    births = np.empty(count, np.int64)
    parts = (
        arrays["header"][OWN],
        arrays["better_at"],
        arrays["digest"],
        arrays["noted_fitness"],
        arrays["fitness"][OWN],
        arrays["deme_fitness"],
        births,
        arrays["birth_fitness"][:count],
        arrays["genomes"][OWN],
        arrays["deme"],
    )
    expected = 1 + sum(part.nbytes for part in parts)
    if len(state) != expected:
        raise ValueError(f"a cell's state has {len(state)} bytes, not {expected}")
    arrays["birth_count"][:] = count
    place = 1
    for part in parts:
        part.reshape(-1).view(np.uint8)[:] = np.frombuffer(state, np.uint8, part.nbytes, place)
        place += part.nbytes
    arrays["births"][:count] = births_of(births)
