"""The compiled loops of real-valued genomes, over rows of cells."""

import numpy as np

from genetics.arrays import Cells, Fitness
from genetics.compiled import kernel
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
        cell = cells[row]
        for child in range(2 * count):
            couple, turn = divmod(child, 2)
            for gene in range(dimension):
                own = couples[row, couple, turn, gene]
                other = couples[row, couple, 1 - turn, gene]
                value = own
                if uniform:
                    if draw(seed, cell, generation, CROSS, couple, gene) & np.uint64(1):
                        value = other
                else:
                    share = unit(draw(seed, cell, generation, CROSS, child, gene))
                    value += (share * (1.0 + 2.0 * BLEND) - BLEND) * (other - own)
                if rate > 0.0 and unit(draw(seed, cell, generation, MUTATE, child, 4 * gene)) < rate:
                    size = unit(draw(seed, cell, generation, MUTATE, child, 4 * gene + 1))
                    step = WIDEST_STEP * 10.0 ** (-DECADES * size) * (high - low)
                    value += step * normal(
                        draw(seed, cell, generation, MUTATE, child, 4 * gene + 2),
                        draw(seed, cell, generation, MUTATE, child, 4 * gene + 3),
                    )
                offspring[row, child, gene] = min(max(value, low), high)
    return offspring
