"""The compiled rules of champions and stops, over rows of cells."""

import numpy as np

from genetics import Cells, Fitness, Genomes
from genetics.compiled import kernel
from genetics.randomness import DELAY, draw, unit


@kernel(
    "void(uint8[:,::1], float64[::1], int64[::1], int64[::1], int64[::1], int64[::1], int64,"
    "uint8[:,:,::1], float64[:,::1], int64[:,::1], int64[:,::1], int64[:,::1])"
)
def believe(
    champion: Genomes,
    fitness: Fitness,
    generation: Cells,
    cell: Cells,
    stop_at: Cells,
    better_at: Cells,
    now: int,
    heard_champion: Genomes,
    heard_fitness: Fitness,
    heard_generation: Cells,
    heard_cell: Cells,
    heard_stop_at: Cells,
) -> None:
    """Each row keeps the least stop, and the best champion, that it knows or hears of: heard_* are (rows, slots)."""
    for row in range(fitness.size):
        for slot in range(heard_fitness.shape[1]):
            stop_at[row] = min(stop_at[row], heard_stop_at[row, slot])
            if heard_fitness[row, slot] > fitness[row] or heard_fitness[row, slot] == np.inf:
                continue
            if heard_fitness[row, slot] == fitness[row]:
                if heard_generation[row, slot] > generation[row]:
                    continue
                if heard_generation[row, slot] == generation[row] and heard_cell[row, slot] >= cell[row]:
                    continue
            else:
                better_at[row] = now
            champion[row] = heard_champion[row, slot]
            fitness[row] = heard_fitness[row, slot]
            generation[row] = heard_generation[row, slot]
            cell[row] = heard_cell[row, slot]


@kernel(
    "void(uint8[:,:,::1], float64[:,::1], int64[::1], int64,"
    "uint8[:,::1], float64[::1], int64[::1], int64[::1], int64[::1])"
)
def greet(
    genomes: Genomes,
    demes: Fitness,
    cells: Cells,
    now: int,
    champion: Genomes,
    fitness: Fitness,
    generation: Cells,
    cell: Cells,
    better_at: Cells,
) -> None:
    """The best of each row's deme becomes its champion if it is better; of two as good the earlier born stays."""
    for row in range(fitness.size):
        first = np.argmin(demes[row])
        if demes[row, first] < fitness[row]:
            champion[row] = genomes[row, first]
            fitness[row] = demes[row, first]
            generation[row] = now
            cell[row] = cells[row]
            better_at[row] = now


@kernel("float64(uint64, int64, int64, int64)")
def delay(seed: np.uint64, cell: int, generation: int, index: int) -> float:
    """An exponentially distributed time of mean 1, for the simulator's model of asynchronous nodes."""
    return float(-np.log1p(-unit(draw(seed, cell, generation, DELAY, index, 0))))
