"""The compiled loops of real-valued genomes, over rows of cells."""

from typing import Any

import numpy as np

from genetics.arrays import Cells, Fitness, Genomes
from genetics.compiled import kernel, subroutine
from genetics.operators import MATING, Table, integers, reals
from genetics.randomness import CROSS, INITIAL, MUTATE, draw, normal, unit

BLEND = 0.5  # how far beyond its parents an offspring may lie, as a share of their distance (BLX-alpha)
WIDEST_STEP = 0.3  # of the range
DECADES = 4.0  # mutation steps are spread over this many powers of ten, so that coarse and fine search go on at once


@kernel("float64[:,:,::1](uint64, int64[::1], int64, int64, float64, float64)")
def random(seed: np.uint64, cells: Cells, deme: int, dimension: int, low: float, high: float) -> Fitness:
    """Uniform demes, shape (rows, deme, dimension)."""
    genes = np.empty((cells.size, deme, dimension))
    for row in range(cells.size):
        for individual in range(deme):
            for gene in range(dimension):
                share = unit(draw(seed, cells[row], 0, INITIAL, individual, gene))
                genes[row, individual, gene] = low + (high - low) * share
    return genes


@subroutine
def _child(
    own: Any,
    other: Any,
    child: Any,
    seed: Any,
    cell: Any,
    generation: Any,
    number: Any,
    low: Any,
    high: Any,
    uniform: Any,
    rate: Any,
) -> Any:
    """Fill the mutated offspring ``number``, the one of a couple that is nearer to the parent ``own``."""
    for gene in range(child.size):
        value = own[gene]
        if uniform:
            if draw(seed, cell, generation, CROSS, number // 2, gene) & np.uint64(1):
                value = other[gene]
        else:
            share = unit(draw(seed, cell, generation, CROSS, number, gene))
            value += (share * (1.0 + 2.0 * BLEND) - BLEND) * (other[gene] - own[gene])
        if rate > 0.0 and unit(draw(seed, cell, generation, MUTATE, number, 4 * gene)) < rate:
            size = unit(draw(seed, cell, generation, MUTATE, number, 4 * gene + 1))
            step = WIDEST_STEP * 10.0 ** (-DECADES * size) * (high - low)
            value += step * normal(
                draw(seed, cell, generation, MUTATE, number, 4 * gene + 2),
                draw(seed, cell, generation, MUTATE, number, 4 * gene + 3),
            )
        child[gene] = min(max(value, low), high)


@kernel("float64[:,:,::1](float64[:,:,:,::1], uint64, int64[::1], int64, float64, float64, boolean, float64)")
def recombine(
    couples: Fitness,
    seed: np.uint64,
    cells: Cells,
    generation: int,
    low: float,
    high: float,
    uniform: bool,
    rate: float,
) -> Fitness:
    """Two mutated offspring for each couple: (rows, couples, 2, dimension) to (rows, 2 * couples, dimension)."""
    rows, count, _, dimension = couples.shape
    offspring = np.empty((rows, 2 * count, dimension))
    for row in range(rows):
        for number in range(2 * count):
            couple, turn = divmod(number, 2)
            own, other = couples[row, couple, turn], couples[row, couple, 1 - turn]
            _child(own, other, offspring[row, number], seed, cells[row], generation, number, low, high, uniform, rate)
    return offspring


@subroutine
def _mate(
    own: Any,
    emigrants: Any,
    whence: Any,
    each: Any,
    offspring: Any,
    seed: Any,
    cell: Any,
    generation: Any,
    low: Any,
    high: Any,
    uniform: Any,
    rate: Any,
) -> Any:
    """The offspring of one row, see `mate`."""
    for number in range(offspring.shape[0]):
        couple = number // 2
        immigrant = emigrants[whence[couple // each], couple % each]
        if number % 2 == 0:
            _child(own, immigrant, offspring[number], seed, cell, generation, number, low, high, uniform, rate)
        else:
            _child(immigrant, own, offspring[number], seed, cell, generation, number, low, high, uniform, rate)


@kernel(
    "float64[:,:,::1](float64[:,:,::1], float64[:,:,::1], int64[:,::1], int64,"
    "uint64, int64[::1], int64, float64, float64, boolean, float64)"
)
def mate(
    genes: Fitness,
    emigrants: Fitness,
    whence: Cells,
    each: int,
    seed: np.uint64,
    cells: Cells,
    generation: int,
    low: float,
    high: float,
    uniform: bool,
    rate: float,
) -> Fitness:
    """Two mutated offspring of each row's single individual with each of its immigrants in turn."""
    rows, slots = whence.shape
    offspring = np.empty((rows, 2 * slots * each, genes.shape[2]))
    for row in range(rows):
        own, children, cell = genes[row, 0], offspring[row], cells[row]
        _mate(own, emigrants, whence[row], each, children, seed, cell, generation, low, high, uniform, rate)
    return offspring


@kernel(MATING)
def mating(
    own: Genomes,
    emigrants: Genomes,
    whence: Cells,
    each: int,
    offspring: Genomes,
    seed: np.uint64,
    cell: int,
    generation: int,
    table: Table,
) -> None:
    """`mate` for one row; its table: uniform; then low, high, rate."""
    uniform = integers(table, 0)[0, 0] != 0
    numbers = reals(table, 1)[0]
    low, high, rate = numbers[0], numbers[1], numbers[2]
    genes, others, children = own.view(np.float64), emigrants.view(np.float64), offspring.view(np.float64)
    _mate(genes, others, whence, each, children, seed, cell, generation, low, high, uniform, rate)
