"""Compiled code that calls operators by their addresses; only where `lowlevel.capabilities` allows it.

Whoever imports this module has asked for that first: where numba's private parts are others, it does not compile.
"""

from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic

from genetics.arrays import Cells, Genomes
from genetics.operators import FITNESS, FOUNDING, MATING, STRAYING, Table
from lowlevel.compiled import kernel
from lowlevel.numba_calls import call_by_address

_intrinsic: Any = intrinsic  # callers omit the first argument (the context), which the type of `intrinsic` does not say


@_intrinsic  # type: ignore[untyped-decorator]
def call_fitness(context: Any, address: Any, genomes: Any, fitness: Any, table: Any) -> Any:
    """Call a function of signature FITNESS."""
    return types.void(types.int64, *FITNESS.args), lambda target, builder, _, arguments: call_by_address(
        target, builder, arguments, FITNESS
    )


@_intrinsic  # type: ignore[untyped-decorator]
def call_mating(
    context: Any, address: Any, couples: Any, offspring: Any, seed: Any, cell: Any, generation: Any, table: Any
) -> Any:
    """Call a function of signature MATING."""
    return types.void(types.int64, *MATING.args), lambda target, builder, _, arguments: call_by_address(
        target, builder, arguments, MATING
    )


@_intrinsic  # type: ignore[untyped-decorator]
def call_straying(
    context: Any, address: Any, individuals: Any, seed: Any, cell: Any, generation: Any, table: Any
) -> Any:
    """Call a function of signature STRAYING."""
    return types.int64(types.int64, *STRAYING.args), lambda target, builder, _, arguments: call_by_address(
        target, builder, arguments, STRAYING
    )


@_intrinsic  # type: ignore[untyped-decorator]
def call_founding(context: Any, address: Any, deme: Any, seed: Any, cell: Any, generation: Any, table: Any) -> Any:
    """Call a function of signature FOUNDING."""
    return types.void(types.int64, *FOUNDING.args), lambda target, builder, _, arguments: call_by_address(
        target, builder, arguments, FOUNDING
    )


@kernel("void(int64, uint8[:,:,::1], uint64, int64[::1], int64, int64[:,::1])")
def found_rows(address: int, demes: Genomes, seed: np.uint64, cells: Cells, generation: int, table: Table) -> None:
    """Fill first demes (rows, deme, genome_bytes), each by the function of signature FOUNDING at ``address``."""
    for row in range(cells.size):
        call_founding(address, demes[row], seed, cells[row], generation, table)


@kernel("void(int64, uint8[:,:,:,::1], uint8[:,:,::1], uint64, int64[::1], int64, int64[:,::1])")
def mate_rows(
    address: int,
    couples: Genomes,
    offspring: Genomes,
    seed: np.uint64,
    cells: Cells,
    generation: int,
    table: Table,
) -> None:
    """Fill offspring (rows, 2 * n, bytes) of couples (rows, n, 2, bytes) by the function of signature MATING."""
    for row in range(cells.size):
        call_mating(address, couples[row], offspring[row], seed, cells[row], generation, table)
