"""The compiled side of `genetics.permutation`: first demes, crossover and mutation of orders of items."""

from typing import Any

import numpy as np

from genetics.arrays import Genomes
from genetics.operators import INITIALISE, VARIATION, Table
from genetics.randomness import CROSS, INITIAL, MUTATE, below, draw, unit
from genetics.sequence_kernels import numbers_of
from lowlevel.compiled import kernel, subroutine
from lowlevel.pointers import integers, reals

_HALF = np.uint64(32)
_MOST_EDGES = 4  # of an item: two in either parent


@kernel(INITIALISE)
def initialise(deme: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Fill a deme with random orders, all equally probable (Fisher and Yates). The table has the number of items."""
    size = integers(table, 0)[0, 0]
    for individual in range(deme.shape[0]):
        numbers = numbers_of(deme[individual])
        numbers[0] = size
        order = numbers[1:]
        for place in range(size):  # the shuffle "inside out": it fills the order as it goes
            other = below(draw(seed, cell, generation, INITIAL, individual, place), place + 1)
            order[place] = order[other]
            order[other] = place


@subroutine
def _order(first: Any, second: Any, child: Any, start: Any, end: Any) -> Any:
    """Order crossover (OX, Davis 1985): make one offspring.

    It has the first parent's items from place ``start`` to ``end``, both included. The other items come in the order in
    which the second parent has them, read and written from place ``end`` + 1 on, around the end.
    """
    size = first.size
    taken = np.zeros(size, np.bool_)
    for place in range(start, end + 1):
        child[place] = first[place]
        taken[first[place]] = True
    into = end + 1
    for step in range(size):
        item = second[(end + 1 + step) % size]
        if not taken[item]:
            child[into % size] = item
            into += 1


@subroutine
def _connect(order: Any, edges: Any, degree: Any) -> Any:
    """Add the edges of ``order``, taken as a ring, that are not known yet.

    Args:
        order: a parent.
        edges: each item's neighbours, shape (size, _MOST_EDGES).
        degree: how many neighbours of each item are known, shape (size,).
    """
    size = order.size
    for place in range(size):
        one, other = order[place], order[(place + 1) % size]
        known = one == other  # a ring of one item
        for edge in range(degree[one]):
            known = known or edges[one, edge] == other
        if not known:
            edges[one, degree[one]], edges[other, degree[other]] = other, one
            degree[one] += 1
            degree[other] += 1


@subroutine
def _edge(first: Any, second: Any, child: Any, seed: Any, cell: Any, generation: Any, couple: Any, turn: Any) -> Any:
    """Edge recombination (Whitley, Starkweather and Fuquay 1989): make one offspring.

    It begins with the ``first`` parent's first item. The next item is the unvisited neighbour, in either parent, that
    has the fewest unvisited neighbours itself; of several a drawn one. If no neighbour is unvisited, the next item is
    drawn from all unvisited ones. ``turn``, 0 or 1, is the offspring's number, so that both have draws of their own.
    """
    size = first.size
    edges, degree = np.empty((size, _MOST_EDGES), np.int64), np.zeros(size, np.int64)
    _connect(first, edges, degree)
    _connect(second, edges, degree)
    # The first entries of `remaining` are the unvisited items, in any order. `place_of` says where in it an item is, -1
    # for a visited one. So an item is removed in constant time, and one can be drawn by its place.
    remaining, place_of, neighbours_left = np.arange(size), np.arange(size), degree.copy()
    item = np.int64(first[0])
    for place in range(size):
        child[place] = item
        # The unvisited items stay in one piece: the last of them fills the gap.
        rest = size - place - 1
        gap, last = place_of[item], remaining[rest]
        remaining[gap], place_of[last] = last, gap
        place_of[item] = -1
        if rest == 0:
            return
        # First find the fewest and count the ties, then take the drawn one of these.
        fewest, count = _MOST_EDGES + 1, 0
        for edge in range(degree[item]):
            other = edges[item, edge]
            neighbours_left[other] -= 1
            if place_of[other] >= 0 and neighbours_left[other] <= fewest:
                count = count + 1 if neighbours_left[other] == fewest else 1
                fewest = neighbours_left[other]
        bits = draw(seed, cell, generation, CROSS, couple, 2 * place + turn)
        if count == 0:
            item = remaining[below(bits, rest)]
        else:
            chosen = below(bits, count)
            for edge in range(degree[child[place]]):
                other = edges[child[place], edge]
                if place_of[other] >= 0 and neighbours_left[other] == fewest:
                    if chosen == 0:
                        item = other
                    chosen -= 1


@subroutine
def _mutate(order: Any, seed: Any, cell: Any, generation: Any, child: Any, rate: Any, inversions: Any) -> Any:
    """With probability ``rate``, reverse the stretch between two drawn places or exchange the items at them.

    ``inversions`` is the probability of the reversal. The order must have at least two items.
    """
    bits = draw(seed, cell, generation, MUTATE, child, 0)
    if unit(bits) >= rate:
        return
    places = draw(seed, cell, generation, MUTATE, child, 1)
    one = below(places, order.size)
    other = below(places << _HALF, order.size - 1)  # any place but the first drawn
    other += other >= one
    start, end = min(one, other), max(one, other)
    if unit(draw(seed, cell, generation, MUTATE, child, 2)) < inversions:
        while start < end:
            order[start], order[end] = order[end], order[start]
            start += 1
            end -= 1
    else:
        order[start], order[end] = order[end], order[start]


@kernel(VARIATION)
def variation(couples: Genomes, offspring: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Cross by order or by edges, then mutate. The table has two entries: by edges; rate and share of inversions."""
    by_edges, choices = integers(table, 0)[0, 0] != 0, reals(table, 1)[0]
    for couple in range(couples.shape[0]):
        first, second = numbers_of(couples[couple, 0])[1:], numbers_of(couples[couple, 1])[1:]
        for turn in range(2):
            into = numbers_of(offspring[2 * couple + turn])
            into[0] = first.size
            one, other, child = (first, second, into[1:]) if turn == 0 else (second, first, into[1:])
            if by_edges:
                _edge(one, other, child, seed, cell, generation, couple, turn)
            else:
                cuts = draw(seed, cell, generation, CROSS, couple, 0)  # the same for both offspring of the couple
                start, end = below(cuts, first.size), below(cuts << _HALF, first.size)
                _order(one, other, child, min(start, end), max(start, end))
            if first.size > 1:
                _mutate(child, seed, cell, generation, 2 * couple + turn, choices[0], choices[1])
