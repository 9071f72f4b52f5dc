"""Who mates with whom, who leaves and who stays: the same for every coding.

Individuals of equal fitness are ordered by birth: the earlier in the array comes first.
"""

from typing import Any

import numpy as np

from genetics.arrays import Cells, Fitness, Genomes
from genetics.compiled import kernel, subroutine
from genetics.randomness import SELECT, below, draw


@subroutine
def _worst(fitness: Any) -> Any:
    """Of several as bad, the latest born."""
    worst = 0
    for individual in range(1, fitness.size):
        if fitness[individual] >= fitness[worst]:
            worst = individual
    return worst


@subroutine
def admit_to(
    genomes: Any, fitness: Any, emigrants: Any, emigrant_fitness: Any, whence: Any, count: Any, itself: Any
) -> Any:
    """`admit` for one row, which ``itself`` names."""
    for sender in whence:
        if sender == itself:
            continue
        for immigrant in range(count):
            worst = _worst(fitness)
            if emigrant_fitness[sender, immigrant] < fitness[worst]:
                genomes[worst] = emigrants[sender, immigrant]
                fitness[worst] = emigrant_fitness[sender, immigrant]


@kernel("void(uint8[:,:,::1], float64[:,::1], uint8[:,:,::1], float64[:,::1], int64[:,::1], int64)")
def admit(
    genomes: Genomes,
    fitness: Fitness,
    emigrants: Genomes,
    emigrant_fitness: Fitness,
    whence: Cells,
    count: int,
) -> None:
    """Each immigrant in turn replaces the worst of its row if it is better; of equal worst, the latest born goes.

    ``whence``, (rows, slots), says whose emigrants come, the first ``count`` of each. A slot that names its own row
    brings none: an island must not be flooded with its own best.
    """
    for row in range(fitness.shape[0]):
        admit_to(genomes[row], fitness[row], emigrants, emigrant_fitness, whence[row], count, row)


@subroutine
def pair_with(own: Any, emigrants: Any, whence: Any, count: Any, couples: Any) -> Any:
    """`couples_with` for one row."""
    for couple in range(couples.shape[0]):
        couples[couple, 0] = own
        couples[couple, 1] = emigrants[whence[couple // count], couple % count]


@kernel("uint8[:,:,:,::1](uint8[:,:,::1], uint8[:,:,::1], int64[:,::1], int64)")
def couples_with(genomes: Genomes, emigrants: Genomes, whence: Cells, count: int) -> Genomes:
    """Each row's single individual with each of its immigrants in turn (§6), see `admit` for those.

    Returns shape (rows, slots * count, 2, genome_bytes).
    """
    rows, slots = whence.shape
    couples = np.empty((rows, slots * count, 2, genomes.shape[2]), np.uint8)
    for row in range(rows):
        pair_with(genomes[row, 0], emigrants, whence[row], count, couples[row])
    return couples


@subroutine
def first_unsound(fitness: Any) -> Any:
    """The first index at which a fitness is none (NaN or -inf), or -1."""
    for index in range(fitness.size):
        if not fitness[index] > -np.inf:
            return index
    return -1


@kernel("int64(float64[::1])")
def unsound(fitness: Fitness) -> int:
    """`first_unsound` for Python."""
    index: int = first_unsound(fitness)
    return index


@subroutine
def _by_rank(order: Any, bits: Any) -> Any:
    """An individual with probability proportional to its rank: n for the best of n, 1 for the worst."""
    count = order.size
    ticket = below(bits, count * (count + 1) // 2)
    # The individual of weight w holds the tickets from w(w - 1)/2 to w(w + 1)/2 - 1; floats tell them apart exactly.
    weight = np.int64((1.0 + np.sqrt(1.0 + 8.0 * ticket)) / 2.0)
    return order[count - weight]


@subroutine
def _by_rank_at_most(order: Any, bits: Any, chosen: Any, most: Any) -> Any:
    """`_by_rank` among those who were ``chosen`` less than ``most`` times; among all, if nobody is left."""
    count = order.size
    tickets = 0
    for place in range(count):
        if chosen[place] < most:
            tickets += count - place
    if tickets == 0:
        return _by_rank(order, bits)
    ticket = below(bits, tickets)
    for place in range(count):
        if chosen[place] < most:
            ticket -= count - place
            if ticket < 0:
                chosen[place] += 1
                return order[place]
    return order[0]


@subroutine
def pair(
    fitness: Any, seed: Any, cell: Any, generation: Any, better_half: Any, most_selections: Any, couples: Any
) -> Any:
    """`pairs` for one row."""
    order = np.argsort(fitness, kind="mergesort")
    bits = np.empty(couples.size, np.uint64)
    for parent in range(bits.size):  # a loop of its own, which LLVM can vectorise
        bits[parent] = draw(seed, cell, generation, SELECT, parent >> 1, parent & 1)
    chosen = np.zeros(fitness.size if most_selections > 0 else 0, np.int64)
    for parent in range(bits.size):
        if better_half:
            mate = order[below(bits[parent], (fitness.size + 1) // 2)]
        elif most_selections > 0:
            mate = _by_rank_at_most(order, bits[parent], chosen, most_selections)
        else:
            mate = _by_rank(order, bits[parent])
        couples[parent >> 1, parent & 1] = mate


@kernel("int64[:,:,::1](float64[:,::1], uint64, int64[::1], int64, int64, boolean, int64)")
def pairs(
    fitness: Fitness,
    seed: np.uint64,
    cells: Cells,
    generation: int,
    count: int,
    better_half: bool,
    most_selections: int,
) -> Cells:
    """``count`` couples of each row, by rank (Ahuactzin et al. 1992, §3.1 steps 3 and 4), or among the better half.

    By rank nobody is chosen more than ``most_selections`` times, if that is positive and there are others. Returns
    indices into each row's deme, shape (rows, count, 2).
    """
    rows = fitness.shape[0]
    couples = np.empty((rows, count, 2), np.int64)
    for row in range(rows):
        pair(fitness[row], seed, cells[row], generation, better_half, most_selections, couples[row])
    return couples


@subroutine
def take_place(genomes: Any, fitness: Any, offspring: Any, offspring_fitness: Any, elitist: Any) -> Any:
    """`replace_local` for one row."""
    child = np.argmin(offspring_fitness)
    if not (elitist and fitness[0] < offspring_fitness[child]):
        genomes[0] = offspring[child]
        fitness[0] = offspring_fitness[child]


@kernel("void(uint8[:,:,::1], float64[:,::1], uint8[:,:,::1], float64[:,::1], boolean)")
def replace_local(
    genomes: Genomes, fitness: Fitness, offspring: Genomes, offspring_fitness: Fitness, elitist: bool
) -> None:
    """The best offspring takes the place of the single local individual (§6), unless that is better and elitist."""
    for row in range(fitness.shape[0]):
        take_place(genomes[row], fitness[row], offspring[row], offspring_fitness[row], elitist)


@subroutine
def leave_families(
    genomes: Any, fitness: Any, couples: Any, offspring: Any, offspring_fitness: Any, elitist: Any
) -> Any:
    """`replace_families` for one row."""
    old_genomes, old_fitness = genomes.copy(), fitness.copy()
    for couple in range(fitness.size):
        family = couples[couple, 0]
        if old_fitness[couples[couple, 1]] < old_fitness[family]:
            family = couples[couple, 1]
        genomes[couple] = old_genomes[family]
        fitness[couple] = old_fitness[family]
        for child in range(2 * couple, 2 * couple + 2):
            if offspring_fitness[child] < fitness[couple]:
                genomes[couple] = offspring[child]
                fitness[couple] = offspring_fitness[child]
    if elitist:
        champion = np.argmin(old_fitness)
        if old_fitness[champion] < np.min(fitness):
            worst = np.argmax(fitness)
            genomes[worst] = old_genomes[champion]
            fitness[worst] = old_fitness[champion]


@kernel("void(uint8[:,:,::1], float64[:,::1], int64[:,:,::1], uint8[:,:,::1], float64[:,::1], boolean)")
def replace_families(
    genomes: Genomes,
    fitness: Fitness,
    couples: Cells,
    offspring: Genomes,
    offspring_fitness: Fitness,
    elitist: bool,
) -> None:
    """Each couple leaves the best of itself and its two offspring (§3.1 step 4).

    The earlier born wins a tie: a parent over an offspring, the first drawn parent over the second. With ``elitist``
    the best of the old deme takes the worst new place (the first of several as bad) if nobody as good was left.
    """
    for row in range(fitness.shape[0]):
        leave_families(genomes[row], fitness[row], couples[row], offspring[row], offspring_fitness[row], elitist)


@subroutine
def renew(genomes: Any, fitness: Any, offspring: Any, offspring_fitness: Any, elitist: Any) -> Any:
    """`replace_worst` for one row."""
    order = np.argsort(fitness, kind="mergesort")
    stay = fitness.size - offspring_fitness.size
    best = order[0]
    champion, champion_fitness = genomes[best].copy(), fitness[best]
    for child in range(offspring_fitness.size):
        genomes[order[stay + child]] = offspring[child]
        fitness[order[stay + child]] = offspring_fitness[child]
    if elitist and champion_fitness < np.min(fitness):
        worst = np.argmax(fitness)
        genomes[worst] = champion
        fitness[worst] = champion_fitness


@kernel("void(uint8[:,:,::1], float64[:,::1], uint8[:,:,::1], float64[:,::1], boolean)")
def replace_worst(
    genomes: Genomes, fitness: Fitness, offspring: Genomes, offspring_fitness: Fitness, elitist: bool
) -> None:
    """Offspring take the places of the worst, of equal ones the latest born, whatever they are worth themselves.

    With ``elitist`` the best of the old deme takes the worst place if offspring took all and none is as good.
    """
    for row in range(fitness.shape[0]):
        renew(genomes[row], fitness[row], offspring[row], offspring_fitness[row], elitist)
