"""Selection of parents, the same for every coding.

The place of an individual in its deme's array must not matter. So individuals of equal fitness are selected with equal
probability, as if each had the mean of their ranks.

Here and in the other modules a rule often exists twice: as a subroutine for one row, which other compiled code calls
(`pair`), and as a kernel for many rows, which Python calls (`pairs`).
"""

from typing import Any

import numpy as np

from genetics.arrays import Cells, Fitness, Genomes
from genetics.randomness import SELECT, below, draw, unit
from lowlevel.compiled import kernel, subroutine

_HALF = np.uint64(32)


@subroutine
def pair_with(own: Any, emigrants: Any, source_row: Any, count: Any, couples: Any) -> Any:
    """Fill ``couples``, shape (slots * count, 2, genome_bytes): `couples_with` for one row."""
    for couple in range(couples.shape[0]):
        couples[couple, 0] = own
        couples[couple, 1] = emigrants[source_row[couple // count], couple % count]


@kernel("uint8[:,:,:,::1](uint8[:,:,::1], uint8[:,:,::1], int64[:,::1], int64)")
def couples_with(genomes: Genomes, emigrants: Genomes, source_row: Cells, count: int) -> Genomes:
    """Couple each row's single individual with each of its immigrants (Ahuactzin et al. 1992, §6).

    Args:
        genomes: the demes, shape (rows, 1, genome_bytes).
        emigrants: the emigrants of all senders, shape (senders, at least count, genome_bytes).
        source_row: the sender in each slot, shape (rows, slots).
        count: the number of immigrants from each slot.

    Returns:
        The couples, shape (rows, slots * count, 2, genome_bytes).
    """
    rows, slots = source_row.shape
    couples = np.empty((rows, slots * count, 2, genomes.shape[2]), np.uint8)
    for row in range(rows):
        pair_with(genomes[row, 0], emigrants, source_row[row], count, couples[row])
    return couples


@subroutine
def first_unsound(fitness: Any) -> Any:
    """Return the first index of a value that is not a valid fitness (NaN or -inf), or -1."""
    for index in range(fitness.size):
        if not fitness[index] > -np.inf:  # NaN compares false
            return index
    return -1


@kernel("int64(float64[::1])")
def unsound(fitness: Fitness) -> int:
    """Call `first_unsound` from Python."""
    index: int = first_unsound(fitness)
    return index


@subroutine
def _ranking(fitness: Any) -> Any:
    """Return the individuals from best to worst, and for each place the first and last place of equal fitness."""
    order = np.argsort(fitness, kind="mergesort")  # stable, so the order is the same on every machine
    count = order.size
    first, last = np.empty(count, np.int64), np.empty(count, np.int64)
    for place in range(count):
        as_before = place > 0 and fitness[order[place]] == fitness[order[place - 1]]
        first[place] = first[place - 1] if as_before else place
    for place in range(count - 1, -1, -1):
        as_after = place < count - 1 and first[place + 1] == first[place]
        last[place] = last[place + 1] if as_after else place
    return order, first, last


@subroutine
def _one_as_fit(order: Any, first: Any, last: Any, place: Any, bits: Any) -> Any:
    """Return one of the individuals as fit as the one at ``place``, each with equal probability.

    The low half of ``bits`` chooses: the place itself was drawn from the high half, so the two are independent.
    """
    equals = last[place] - first[place] + 1
    if equals == 1:
        return order[place]
    return order[first[place] + below(bits << _HALF, equals)]


@subroutine
def _place_by_rank(count: Any, bits: Any) -> Any:
    """Return a place with a probability proportional to its weight: n for the first of n places, 1 for the last."""
    ticket = below(bits, count * (count + 1) // 2)
    # The place of weight w holds the tickets from w(w - 1)/2 to w(w + 1)/2 - 1. Float64 is accurate enough to tell the
    # limits apart for every ticket that `below` can return.
    return count - np.int64((1.0 + np.sqrt(1.0 + 8.0 * ticket)) / 2.0)


@subroutine
def _place_at_most(first: Any, last: Any, bits: Any, chosen: Any, most: Any) -> Any:
    """Return a place by mean rank among those chosen fewer than ``most`` times, and count it; -1 if there is none."""
    count = first.size
    tickets = 0
    for place in range(count):
        if chosen[place] < most:
            tickets += 2 * count - first[place] - last[place]  # twice the mean weight, to stay with integers
    if tickets == 0:
        return -1
    ticket = np.int64(unit(bits) * tickets)  # for the largest demes there are more than 2**32, too many for `below`
    for place in range(count):
        if chosen[place] < most:
            ticket -= 2 * count - first[place] - last[place]
            if ticket < 0:
                chosen[place] += 1
                return place
    return -1


@subroutine
def pair(
    fitness: Any, seed: Any, cell: Any, generation: Any, better_half: Any, most_selections: Any, couples: Any
) -> Any:
    """Fill ``couples``, shape (count, 2), with indices into the deme: `pairs` for one row."""
    order, first, last = _ranking(fitness)
    count = order.size
    bits = np.empty(couples.size, np.uint64)
    for parent in range(bits.size):  # a loop of its own, which LLVM can vectorise
        bits[parent] = draw(seed, cell, generation, SELECT, parent >> 1, parent & 1)
    chosen = np.zeros(count if most_selections > 0 else 0, np.int64)
    for parent in range(bits.size):
        place = -1
        if most_selections > 0 and not better_half:
            place = _place_at_most(first, last, bits[parent], chosen, most_selections)
        if place >= 0:
            mate = order[place]
        else:
            place = below(bits[parent], (count + 1) // 2) if better_half else _place_by_rank(count, bits[parent])
            mate = _one_as_fit(order, first, last, place, bits[parent])
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
    """Select ``count`` couples of each row, by rank (Ahuactzin et al. 1992, §3.1 steps 3, 4) or from the better half.

    Equally fit individuals are selected with the probability of their mean rank. If ``most_selections`` is positive, no
    individual is selected by rank more often than that, as long as there are others. The parents of a couple are drawn
    independently and may be the same individual.

    Returns:
        Indices into each row's deme, shape (rows, count, 2).
    """
    rows = fitness.shape[0]
    couples = np.empty((rows, count, 2), np.int64)
    for row in range(rows):
        pair(fitness[row], seed, cells[row], generation, better_half, most_selections, couples[row])
    return couples
