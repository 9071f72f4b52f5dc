"""Compiled code that calls operators by their addresses; only where `lowlevel.capabilities` allows it.

Whoever imports this module has asked for that first: where numba's private parts are others, it does not compile.
"""

from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic

from genetics.arrays import Cells, Genomes
from genetics.operators import FITNESS, INITIALISE, MUTATE_ONE_BIT, VARIATION, Table
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
def call_variation(
    context: Any, address: Any, couples: Any, offspring: Any, seed: Any, cell: Any, generation: Any, table: Any
) -> Any:
    """Call a function of signature VARIATION."""
    return types.void(types.int64, *VARIATION.args), lambda target, builder, _, arguments: call_by_address(
        target, builder, arguments, VARIATION
    )


@_intrinsic  # type: ignore[untyped-decorator]
def call_mutate_one_bit(
    context: Any, address: Any, individuals: Any, seed: Any, cell: Any, generation: Any, table: Any
) -> Any:
    """Call a function of signature MUTATE_ONE_BIT."""
    return types.int64(types.int64, *MUTATE_ONE_BIT.args), lambda target, builder, _, arguments: call_by_address(
        target, builder, arguments, MUTATE_ONE_BIT
    )


@_intrinsic  # type: ignore[untyped-decorator]
def call_initialise(context: Any, address: Any, deme: Any, seed: Any, cell: Any, generation: Any, table: Any) -> Any:
    """Call a function of signature INITIALISE."""
    return types.void(types.int64, *INITIALISE.args), lambda target, builder, _, arguments: call_by_address(
        target, builder, arguments, INITIALISE
    )


@kernel("void(int64, uint8[:,:,::1], uint64, int64[::1], int64, int64[:,::1])")
def initialise_rows(address: int, demes: Genomes, seed: np.uint64, cells: Cells, generation: int, table: Table) -> None:
    """Fill first demes (rows, deme, genome_bytes), each by the function of signature INITIALISE at ``address``."""
    for row in range(cells.size):
        call_initialise(address, demes[row], seed, cells[row], generation, table)


@kernel("void(int64, uint8[:,:,:,::1], uint8[:,:,::1], uint64, int64[::1], int64, int64[:,::1])")
def vary_rows(
    address: int,
    couples: Genomes,
    offspring: Genomes,
    seed: np.uint64,
    cells: Cells,
    generation: int,
    table: Table,
) -> None:
    """Fill offspring (rows, 2 * n, bytes) of couples (rows, n, 2, bytes) by the function of signature VARIATION."""
    for row in range(cells.size):
        call_variation(address, couples[row], offspring[row], seed, cells[row], generation, table)
