"""Admission of immigrants and replacement by offspring, the same for every coding.

The place of an individual in its deme's array must not matter. Otherwise a deme whose individuals are all equally fit
would stop changing. So draws of purpose TIE decide which of several worst individuals leaves and which of several best
ones stays, and an offspring as good as its parents replaces them.

An immigrant, however, must be better than the individual that it replaces. Immigrants are copies, so on a plateau of
the fitness islands would otherwise fill each other with copies (measured in docs/cell.md, "Ties").
"""

from typing import Any

import numpy as np

from genetics.arrays import Cells, Fitness, Genomes
from genetics.randomness import TIE, below, draw
from lowlevel.compiled import kernel, subroutine

_ADMITTED, _OFFSPRING, _CHAMPION, _LAST, _LEAVING = range(5)
"""The index of a TIE draw: which of the rules it belongs to, so that no two rules share a draw."""


@subroutine
def _drawn(fitness: Any, value: Any, first: Any, seed: Any, cell: Any, generation: Any, tie: Any, number: Any) -> Any:
    """Return one of the individuals whose fitness is ``value``, each with equal probability; ``first`` is the first.

    Draws have coordinates, so drawing nothing in the frequent case without a tie shifts no other draw.
    """
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
    """Return the best individual; of several, a drawn one."""
    best = np.argmin(fitness)
    return _drawn(fitness, fitness[best], best, seed, cell, generation, tie, 0)


@subroutine
def _worst(fitness: Any, seed: Any, cell: Any, generation: Any, tie: Any, number: Any) -> Any:
    """Return the worst individual; of several, a drawn one."""
    worst = np.argmax(fitness)
    return _drawn(fitness, fitness[worst], worst, seed, cell, generation, tie, number)


@subroutine
def admit_row(
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
    """Admit immigrants to one row, see `admit`. ``itself`` is the row's index as a sender, ``cell`` keys the draws."""
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
    """Let each immigrant in turn replace the worst individual of its row, if it is better than that.

    Of several worst individuals a drawn one leaves. A slot that names the row itself, as on small tori, brings no
    immigrant: an island must not be flooded with copies of its own best.

    Args:
        genomes: the demes, shape (rows, deme, genome_bytes), changed in place.
        fitness: the demes' fitness, shape (rows, deme), changed in place.
        emigrants: the emigrants of all senders, shape (senders, at least count, genome_bytes).
        emigrant_fitness: the emigrants' fitness, shape (senders, at least count).
        source_row: the sender in each slot, shape (rows, slots). Sender r is row r's own cell.
        count: the number of immigrants from each slot.
        seed: the run's seed, for the draws.
        cells: the rows' cells, for the draws, shape (rows,).
        generation: the generation that is being bred, for the draws.
    """
    for row in range(fitness.shape[0]):
        into, its_fitness = genomes[row], fitness[row]
        admit_row(
            into, its_fitness, emigrants, emigrant_fitness, source_row[row], count, row, seed, cells[row], generation
        )


@subroutine
def replace_local_row(
    genomes: Any,
    fitness: Any,
    offspring: Any,
    offspring_fitness: Any,
    elitist: Any,
    seed: Any,
    cell: Any,
    generation: Any,
) -> Any:
    """Replace the individual of one row, see `replace_local`."""
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
    """Let the best offspring replace the single individual of each row (Ahuactzin et al. 1992, §6).

    With ``elitist`` the individual stays if it is better. Of several best offspring a drawn one replaces it: the first
    would always be a child of the same neighbour.
    """
    for row in range(fitness.shape[0]):
        its = offspring_fitness[row]
        replace_local_row(genomes[row], fitness[row], offspring[row], its, elitist, seed, cells[row], generation)


@subroutine
def _bring_back(
    genomes: Any, fitness: Any, champion: Any, champion_fitness: Any, seed: Any, cell: Any, generation: Any
) -> Any:
    """Let the best individual of the old deme replace the worst of the new one, if none in the new one is as good."""
    if champion_fitness < np.min(fitness):
        worst = _worst(fitness, seed, cell, generation, _LAST, 0)
        genomes[worst] = champion
        fitness[worst] = champion_fitness


@subroutine
def replace_families_row(
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
    """Replace one row's deme by families, see `replace_families`."""
    # Copies: an individual may be a parent in several couples, and its place is overwritten by one of the first.
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
    """Let each couple leave the best of itself and its two offspring (Ahuactzin et al. 1992, §3.1 step 4).

    Couple j fills place j of the new deme, so there must be as many couples as individuals. The paper says nothing of
    ties. Here an offspring as good as the better parent replaces it. Of two equal parents, and of two equal offspring,
    the first one is taken: both were drawn in the same way, so neither has an advantage by it. With ``elitist`` the
    best individual of the old deme replaces the worst of the new one if none as good was left.
    """
    for row in range(fitness.shape[0]):
        into, its_fitness, its_couples, cell = genomes[row], fitness[row], couples[row], cells[row]
        children, their_fitness = offspring[row], offspring_fitness[row]
        replace_families_row(into, its_fitness, its_couples, children, their_fitness, elitist, seed, cell, generation)


@subroutine
def _draw_leaving(order: Any, fitness: Any, stay: Any, seed: Any, cell: Any, generation: Any) -> Any:
    """Shuffle the ties at the border, so that those that leave, from place ``stay`` of ``order`` on, are a fair sample.

    The tied individuals are those as fit as the best of the leaving ones. Only the leaving places are filled by the
    shuffle (Fisher and Yates), from the last one down.
    """
    value = fitness[order[stay]]
    first, last = stay, stay
    while first > 0 and fitness[order[first - 1]] == value:
        first -= 1
    if first == stay:  # no tie across the border: it is clear who leaves
        return
    while last < order.size - 1 and fitness[order[last + 1]] == value:
        last += 1
    for place in range(last, stay - 1, -1):
        other = first + below(draw(seed, cell, generation, TIE, _LEAVING, place), place - first + 1)
        order[place], order[other] = order[other], order[place]


@subroutine
def replace_worst_row(
    genomes: Any,
    fitness: Any,
    offspring: Any,
    offspring_fitness: Any,
    elitist: Any,
    seed: Any,
    cell: Any,
    generation: Any,
) -> Any:
    """Replace the worst individuals of one row, see `replace_worst`."""
    order = np.argsort(fitness, kind="mergesort")
    stay = fitness.size - offspring_fitness.size
    _draw_leaving(order, fitness, stay, seed, cell, generation)
    # If any individual stays, a best one does, and `_bring_back` changes nothing: then it need not be drawn.
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
    """Let offspring replace as many of the worst individuals of each row, even if the offspring are less fit.

    Of equally fit individuals at the border a drawn sample leaves. With ``elitist`` the best individual of the old deme
    replaces the worst of the new one if all were replaced and none of the offspring is as good.
    """
    for row in range(fitness.shape[0]):
        its = offspring_fitness[row]
        replace_worst_row(genomes[row], fitness[row], offspring[row], its, elitist, seed, cells[row], generation)
