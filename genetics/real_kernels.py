"""The compiled loops of real-valued genomes, over rows of cells.

Everything here is inlined into its kernel so that LLVM can vectorise the loops. For the same reason draws come in
batches.
"""

import math
from typing import Any

import numpy as np

from genetics.arrays import Cells, Fitness, Genomes
from genetics.operators import VARIATION, Table
from genetics.randomness import CROSS, INITIAL, MUTATE, draw, normal, unit, words
from lowlevel.compiled import inlined, kernel
from lowlevel.pointers import integers, reals

BLEND = 0.5  # how far beyond its parents an offspring may lie, as a share of their distance (alpha of BLX-alpha)
WIDEST_STEP = 0.3  # the largest scale of a mutation step, as a share of the range
DECADES = 4.0  # the scale is log-uniform over this many powers of ten: coarse and fine search go on at the same time

_TO_FINEST = -DECADES * math.log(10.0)
_BATCH = 16  # draws made together: two registers of today's widest processors
_HALF = np.uint64(32)


@kernel("float64[:,:,::1](uint64, int64[::1], int64, int64, float64, float64)")
def random(seed: np.uint64, cells: Cells, deme: int, dimension: int, low: float, high: float) -> Fitness:
    """Return uniformly random demes, shape (rows, deme, dimension)."""
    genes = np.empty((cells.size, deme, dimension))
    for row in range(cells.size):
        for individual in range(deme):
            for gene in range(dimension):
                share = unit(draw(seed, cells[row], 0, INITIAL, individual, gene))
                genes[row, individual, gene] = low + (high - low) * share
    return genes


@inlined
def _draw_shares(genes: Any, seed: Any, cell: Any, generation: Any) -> Any:
    """Fill all genes of a row's offspring with uniform numbers in (0, 1), four from each draw.

    The numbers are stored where the offspring will be: crossover then reads each one and overwrites it with the gene,
    so no further array is needed.
    """
    drawn = np.empty((4, _BATCH), np.uint32)
    bits = drawn.reshape(4 * _BATCH)
    for start in range(0, genes.size, bits.size):
        words(drawn, seed, cell, generation, CROSS, 0, start // 4)
        part = genes[start : start + bits.size]
        for place in range(part.size):
            part[place] = (bits[place] + 0.5) * 2.0**-32


@inlined
def _cross(first: Any, second: Any, one: Any, other: Any, uniform: Any) -> Any:
    """Turn the random shares that two offspring hold into genes, by crossing a couple."""
    if uniform:
        for gene in range(one.size):
            swapped, own, its = one[gene] < 0.5, first[gene], second[gene]
            one[gene] = its if swapped else own
            other[gene] = own if swapped else its
    else:
        for gene in range(one.size):
            distance = second[gene] - first[gene]
            one[gene] = first[gene] + (one[gene] * (1.0 + 2.0 * BLEND) - BLEND) * distance
            other[gene] = second[gene] - (other[gene] * (1.0 + 2.0 * BLEND) - BLEND) * distance


@inlined
def _mutate(genes: Any, seed: Any, cell: Any, generation: Any, widest: Any, rate: Any) -> Any:
    """Change each gene of a row's offspring with probability ``rate``.

    The loop draws the gap to the next change, which is geometrically distributed, instead of one number for each gene.
    All offspring of a row are one sequence of genes here, so only one gap, the last, is drawn in vain.
    """
    gaps, steps = np.empty((4, _BATCH), np.uint32), np.empty((4, _BATCH), np.uint32)
    scale = 1.0 / np.log1p(-rate) if rate < 1.0 else -0.0  # with a rate of 1 all gaps are 0
    last: Any = -1
    for first in range(0, genes.size + 1, _BATCH):
        words(gaps, seed, cell, generation, MUTATE, 0, first)
        words(steps, seed, cell, generation, MUTATE, 1, first)
        for change in range(_BATCH):
            # A gap takes 64 bits, since with 32 tiny rates would not be exact. A step needs no more than 32.
            gap = np.log1p(-unit(np.uint64(gaps[0, change]) << _HALF | np.uint64(gaps[1, change]))) * scale
            if gap >= genes.size - last - 1:  # compared as floats: a tiny rate gives gaps beyond any integer
                return
            last += 1 + np.int64(gap)
            deviation = normal(np.uint64(steps[0, change]) << _HALF, np.uint64(steps[1, change]) << _HALF)
            share = unit(np.uint64(steps[2, change]) << _HALF)
            genes[last] += widest * np.exp(_TO_FINEST * share) * deviation


@inlined
def _finish(offspring: Any, seed: Any, cell: Any, generation: Any, low: Any, high: Any, rate: Any) -> Any:
    """Mutate a row's offspring and clip their genes to the bounds."""
    genes = offspring.reshape(offspring.size)
    if rate > 0.0:
        _mutate(genes, seed, cell, generation, WIDEST_STEP * (high - low), rate)
    for gene in range(genes.size):
        genes[gene] = min(max(genes[gene], low), high)


@inlined
def _recombine(
    couples: Any,
    offspring: Any,
    seed: Any,
    cell: Any,
    generation: Any,
    low: Any,
    high: Any,
    uniform: Any,
    rate: Any,
) -> Any:
    """Fill one row's offspring, see `recombine`."""
    _draw_shares(offspring.reshape(offspring.size), seed, cell, generation)
    for couple in range(couples.shape[0]):
        _cross(couples[couple, 0], couples[couple, 1], offspring[2 * couple], offspring[2 * couple + 1], uniform)
    _finish(offspring, seed, cell, generation, low, high, rate)


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
    """Return two mutated offspring for each couple: (rows, couples, 2, dimension) to (rows, 2 * couples, dimension)."""
    rows, count, _, dimension = couples.shape
    offspring = np.empty((rows, 2 * count, dimension))
    for row in range(rows):
        _recombine(couples[row], offspring[row], seed, cells[row], generation, low, high, uniform, rate)
    return offspring


@kernel(VARIATION)
def variation(couples: Genomes, offspring: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Fill one row's offspring, see `recombine`. The table has two entries: uniform; low, high and rate."""
    uniform, numbers = integers(table, 0)[0, 0] != 0, reals(table, 1)[0]
    parents, children = couples.view(np.float64), offspring.view(np.float64)
    _recombine(parents, children, seed, cell, generation, numbers[0], numbers[1], uniform, numbers[2])
