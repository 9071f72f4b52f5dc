"""A small problem on permutations for tests: the shortest way through places on a line, compiled and not."""

import numba
import numpy as np

from genetics import Permutation
from genetics.operators import FITNESS, Operator
from genetics.sequence_kernels import numbers_of
from problems import Problem

PLACES = 9


@numba.njit(FITNESS)
def way(genomes, fitness, table):
    """How far it is from each place to the next; ties are common."""
    for row in range(fitness.size):
        order, total = numbers_of(genomes[row])[1:], 0
        for step in range(1, order.size):
            total += abs(np.int64(order[step]) - np.int64(order[step - 1]))
        fitness[row] = total


class Visiting(Problem):
    """Places on a line in an order: 8 is the shortest way."""

    @property
    def coding(self):
        return Permutation(PLACES)

    @property
    def fitness_kernel(self):
        return Operator.of(way)

    def evaluate(self, genomes):
        return Operator.of(way).fitness(genomes)


class VisitingSlowly(Visiting):
    """The same, not compiled into the generation."""

    @property
    def fitness_kernel(self):
        return None
