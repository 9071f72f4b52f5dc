"""Admission and replacement, who leaves a deme and who stays: the same for every coding.

A place in a deme's array gives no advantage. Otherwise a deme stands still where all are equally fit. So a draw of
purpose TIE says which of several worst leaves and which of several best stays, and an offspring as good as its parents
replaces them. An immigrant must be better than the one that it replaces: on a plateau islands would otherwise fill each
other with copies.
"""

from typing import Any

import numpy as np

from genetics.arrays import Cells, Fitness, Genomes
from genetics.randomness import TIE, below, draw
from lowlevel.compiled import kernel, subroutine

_ADMITTED, _OFFSPRING, _CHAMPION, _LAST, _LEAVING = range(5)
"""Which tie a draw breaks, as its index."""


@subroutine
def _drawn(fitness: Any, value: Any, first: Any, seed: Any, cell: Any, generation: Any, tie: Any, number: Any) -> Any:
    """One of the individuals whose fitness is ``value``, of which ``first`` is the first; each with equal chances."""
    count = 0
    for individual in range(first, fitness.size):
        count += fitness[individual] == value
    if count == 1:
        return first
    left = below(draw(seed, cell, generation, TIE, tie, number), count)
    for individual in range(first, fitness.size):
        if fitness[individual] == value:
            if left == 0:
                return individual
            left -= 1
    return first


@subroutine
def _best(fitness: Any, seed: Any, cell: Any, generation: Any, tie: Any) -> Any:
    """The best individual, a drawn one of several."""
    best = np.argmin(fitness)
    return _drawn(fitness, fitness[best], best, seed, cell, generation, tie, 0)


@subroutine
def _worst(fitness: Any, seed: Any, cell: Any, generation: Any, tie: Any, number: Any) -> Any:
    """The worst individual, a drawn one of several."""
    worst = np.argmax(fitness)
    return _drawn(fitness, fitness[worst], worst, seed, cell, generation, tie, number)


@subroutine
def admit_to(
    genomes: Any,
    fitness: Any,
    emigrants: Any,
    emigrant_fitness: Any,
    source_row: Any,
    count: Any,
    itself: Any,
    seed: Any,
    cell: Any,
    generation: Any,
) -> Any:
    """`admit` for one row, which ``itself`` names among the senders and ``cell`` to the draws."""
    for slot in range(source_row.size):
        sender = source_row[slot]
        if sender == itself:
            continue
        for immigrant in range(count):
            its_fitness = emigrant_fitness[sender, immigrant]
            if its_fitness < np.max(fitness):
                worst = _worst(fitness, seed, cell, generation, _ADMITTED, slot * count + immigrant)
                genomes[worst] = emigrants[sender, immigrant]
                fitness[worst] = its_fitness


@kernel(
    "void(uint8[:,:,::1], float64[:,::1], uint8[:,:,::1], float64[:,::1], int64[:,::1], int64,"
    "uint64, int64[::1], int64)"
)
def admit(
    genomes: Genomes,
    fitness: Fitness,
    emigrants: Genomes,
    emigrant_fitness: Fitness,
    source_row: Cells,
    count: int,
    seed: np.uint64,
    cells: Cells,
    generation: int,
) -> None:
    """Each immigrant in turn replaces the worst of its row if it is better; of several worst a drawn one goes.

    ``source_row``, (rows, slots), says whose emigrants come, the first ``count`` of each. A slot that names its own row
    brings none: an island must not be flooded with its own best.
    """
    for row in range(fitness.shape[0]):
        into, its_fitness = genomes[row], fitness[row]
        admit_to(
            into, its_fitness, emigrants, emigrant_fitness, source_row[row], count, row, seed, cells[row], generation
        )


@subroutine
def take_place(
    genomes: Any,
    fitness: Any,
    offspring: Any,
    offspring_fitness: Any,
    elitist: Any,
    seed: Any,
    cell: Any,
    generation: Any,
) -> Any:
    """`replace_local` for one row."""
    child = _best(offspring_fitness, seed, cell, generation, _OFFSPRING)
    if not (elitist and fitness[0] < offspring_fitness[child]):
        genomes[0] = offspring[child]
        fitness[0] = offspring_fitness[child]


@kernel("void(uint8[:,:,::1], float64[:,::1], uint8[:,:,::1], float64[:,::1], boolean, uint64, int64[::1], int64)")
def replace_local(
    genomes: Genomes,
    fitness: Fitness,
    offspring: Genomes,
    offspring_fitness: Fitness,
    elitist: bool,
    seed: np.uint64,
    cells: Cells,
    generation: int,
) -> None:
    """The best offspring takes the place of the single local individual (§6), unless that is better and elitist.

    Of several best a drawn one does: the first would always be a child of the same neighbour.
    """
    for row in range(fitness.shape[0]):
        its = offspring_fitness[row]
        take_place(genomes[row], fitness[row], offspring[row], its, elitist, seed, cells[row], generation)


@subroutine
def _bring_back(
    genomes: Any, fitness: Any, champion: Any, champion_fitness: Any, seed: Any, cell: Any, generation: Any
) -> Any:
    """Give the best of the old deme the worst place, if none in the new deme is as good."""
    if champion_fitness < np.min(fitness):
        worst = _worst(fitness, seed, cell, generation, _LAST, 0)
        genomes[worst] = champion
        fitness[worst] = champion_fitness


@subroutine
def leave_families(
    genomes: Any,
    fitness: Any,
    couples: Any,
    offspring: Any,
    offspring_fitness: Any,
    elitist: Any,
    seed: Any,
    cell: Any,
    generation: Any,
) -> Any:
    """`replace_families` for one row."""
    old_genomes, old_fitness = genomes.copy(), fitness.copy()
    for couple in range(fitness.size):
        parent, child = couples[couple, 0], 2 * couple
        if old_fitness[couples[couple, 1]] < old_fitness[parent]:
            parent = couples[couple, 1]
        if offspring_fitness[child + 1] < offspring_fitness[child]:
            child += 1
        if offspring_fitness[child] <= old_fitness[parent]:
            genomes[couple] = offspring[child]
            fitness[couple] = offspring_fitness[child]
        else:
            genomes[couple] = old_genomes[parent]
            fitness[couple] = old_fitness[parent]
    if elitist and np.min(old_fitness) < np.min(fitness):
        best = _best(old_fitness, seed, cell, generation, _CHAMPION)
        _bring_back(genomes, fitness, old_genomes[best], old_fitness[best], seed, cell, generation)


@kernel(
    "void(uint8[:,:,::1], float64[:,::1], int64[:,:,::1], uint8[:,:,::1], float64[:,::1], boolean,"
    "uint64, int64[::1], int64)"
)
def replace_families(
    genomes: Genomes,
    fitness: Fitness,
    couples: Cells,
    offspring: Genomes,
    offspring_fitness: Fitness,
    elitist: bool,
    seed: np.uint64,
    cells: Cells,
    generation: int,
) -> None:
    """Each couple leaves the best of itself and its two offspring (§3.1 step 4, which says nothing of ties).

    An offspring as good as the better parent replaces it. Of two equal parents, and of two equal offspring, the first
    stays: both were drawn alike, so that is no advantage of either. With ``elitist`` the best of the old deme takes the
    worst new place if nobody as good was left.
    """
    for row in range(fitness.shape[0]):
        into, its_fitness, its_couples, cell = genomes[row], fitness[row], couples[row], cells[row]
        children, their_fitness = offspring[row], offspring_fitness[row]
        leave_families(into, its_fitness, its_couples, children, their_fitness, elitist, seed, cell, generation)


@subroutine
def _draw_leaving(order: Any, fitness: Any, stay: Any, seed: Any, cell: Any, generation: Any) -> Any:
    """Shuffle those as fit as the best that must leave, so that the last ``order.size - stay`` are a drawn sample."""
    value = fitness[order[stay]]
    first, last = stay, stay
    while first > 0 and fitness[order[first - 1]] == value:
        first -= 1
    if first == stay:
        return
    while last < order.size - 1 and fitness[order[last + 1]] == value:
        last += 1
    for place in range(last, stay - 1, -1):
        other = first + below(draw(seed, cell, generation, TIE, _LEAVING, place), place - first + 1)
        order[place], order[other] = order[other], order[place]


@subroutine
def renew(
    genomes: Any,
    fitness: Any,
    offspring: Any,
    offspring_fitness: Any,
    elitist: Any,
    seed: Any,
    cell: Any,
    generation: Any,
) -> Any:
    """`replace_worst` for one row."""
    order = np.argsort(fitness, kind="mergesort")
    stay = fitness.size - offspring_fitness.size
    _draw_leaving(order, fitness, stay, seed, cell, generation)
    best = order[0] if stay > 0 else _best(fitness, seed, cell, generation, _CHAMPION)
    champion, champion_fitness = genomes[best].copy(), fitness[best]
    for child in range(offspring_fitness.size):
        genomes[order[stay + child]] = offspring[child]
        fitness[order[stay + child]] = offspring_fitness[child]
    if elitist:
        _bring_back(genomes, fitness, champion, champion_fitness, seed, cell, generation)


@kernel("void(uint8[:,:,::1], float64[:,::1], uint8[:,:,::1], float64[:,::1], boolean, uint64, int64[::1], int64)")
def replace_worst(
    genomes: Genomes,
    fitness: Fitness,
    offspring: Genomes,
    offspring_fitness: Fitness,
    elitist: bool,
    seed: np.uint64,
    cells: Cells,
    generation: int,
) -> None:
    """Offspring take the places of the worst, a drawn sample of equal ones, whatever they are worth themselves.

    With ``elitist`` the best of the old deme takes the worst place if offspring took all and none is as good.
    """
    for row in range(fitness.shape[0]):
        its = offspring_fitness[row]
        renew(genomes[row], fitness[row], offspring[row], its, elitist, seed, cells[row], generation)
