"""A small coding of variable length for tests: lists of (digit, weight) items, cut and spliced."""

import numba
import numpy as np
from hypothesis import strategies as st

from genetics import Sequence
from genetics.operators import FITNESS, INITIALISE, VARIATION, Operator
from genetics.randomness import CROSS, INITIAL, MUTATE, below, draw, unit
from genetics.sequence_kernels import clear_after, numbers_of
from lowlevel.pointers import integers, reals
from problems import Problem

GENES = ((0, 9), (7, 1000))


@numba.njit(INITIALISE)  # these are not kept on disk, as kernels are
def found(deme, seed, cell, generation, table):
    """Lists of random length and random genes."""
    limits = integers(table, 0)[0]
    width = (limits.size - 3) // 2
    for individual in range(deme.shape[0]):
        numbers = numbers_of(deme[individual])
        bits = draw(seed, cell, generation, INITIAL, individual, 0)
        numbers[0] = limits[0] + below(bits, limits[1] - limits[0] + 1)
        for place in range(numbers[0] * width):
            low, high = limits[2 + 2 * (place % width)], limits[3 + 2 * (place % width)]
            bits = draw(seed, cell, generation, INITIAL, individual, 1 + place)
            numbers[1 + place] = low + below(bits, high - low + 1)


@numba.njit(VARIATION)
def mate(couples, offspring, seed, cell, generation, table):
    """The head of one parent and the tail of the other, as much as there is room for; the first fills up the least."""
    limits, rate = integers(table, 0)[0], reals(table, 1)[0, 0]
    width = (limits.size - 3) // 2
    for child in range(offspring.shape[0]):
        couple, turn = child >> 1, child & 1
        first, second = numbers_of(couples[couple, turn]), numbers_of(couples[couple, 1 - turn])
        into, tail_of = numbers_of(offspring[child]), np.int64(second[0])
        head = below(draw(seed, cell, generation, CROSS, couple, 2 * turn), np.int64(first[0]) + 1)
        tail = below(draw(seed, cell, generation, CROSS, couple, 2 * turn + 1), tail_of + 1)
        count = max(limits[0], min(limits[1], head + tail))
        for place in range(count * width):
            item, gene = place // width, place % width
            if head <= item < head + tail:
                into[1 + place] = second[1 + (tail_of - tail + item - head) * width + gene]
            else:
                into[1 + place] = first[1 + place]
            if unit(draw(seed, cell, generation, MUTATE, child, 2 * place)) < rate:
                low, high = limits[2 + 2 * gene], limits[3 + 2 * gene]
                into[1 + place] = low + below(
                    draw(seed, cell, generation, MUTATE, child, 2 * place + 1), high - low + 1
                )
        clear_after(into, count, width)


class Lists(Sequence):
    """Lists of items whose digit is 0 to 9 and whose weight is 7 to 1000."""

    crossovers = ("splice",)

    def __init__(self, least=1, most=6, genes=GENES):
        super().__init__(least, most, genes)

    def initialise(self):
        return Operator.of(found, self.alphabet.items)

    def variation(self, recipe):
        return Operator.of(mate, self.alphabet.items, float(recipe.mutation))


@numba.njit(FITNESS)
def distance(genomes, fitness, table):
    """How far the sum of all genes is from what it shall be; a list that begins with a 3 is infeasible."""
    wanted = integers(table, 0)[0, 0]
    for row in range(fitness.size):
        numbers = numbers_of(genomes[row])
        total = 0
        for gene in numbers[1:]:
            total += gene
        fitness[row] = np.inf if numbers[0] > 0 and numbers[1] == 3 else abs(wanted - total)


class Adding(Problem):
    """Genes that add up to a number."""

    total: int = 2026

    @property
    def coding(self):
        return Lists()

    @property
    def fitness_kernel(self):
        return Operator.of(distance, self.total)

    def evaluate(self, genomes):
        return Operator.of(distance, self.total).fitness(genomes)


class AddingSlowly(Adding):
    """The same, not compiled into the generation."""

    @property
    def fitness_kernel(self):
        return None


def items_of(coding):
    """Strategy for items of a coding."""
    item = st.tuples(*[st.integers(low, high) for low, high in coding.genes])
    return st.lists(item, min_size=coding.least, max_size=coding.most)
