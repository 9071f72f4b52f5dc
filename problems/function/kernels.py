"""The compiled values of the known functions, of many genomes at once.

All have the signature `genetics.operators.FITNESS`. The table of functions of numbers: bits of each parameter (0: they
are float64), whether by Gray code, parameters; then the bounds. That of functions of bits: bits of each parameter,
whether by Gray code, parameters; then what the function says.
"""

from typing import Any

import numpy as np
from numba import types

from genetics.arrays import Fitness, Genomes
from genetics.bit_kernels import integers_of
from genetics.operators import FITNESS, Table
from lowlevel.clocks import thread_nanoseconds
from lowlevel.compiled import inlined, kernel, subroutine
from lowlevel.pointers import integers, reals


@subroutine
def _points(genomes: Any, table: Any) -> Any:
    """The numbers that genomes code, (n, parameters)."""
    layout, bounds = integers(table, 0)[0], reals(table, 1)[0]
    bits, gray, parameters = layout[0], layout[1] != 0, layout[2]
    if bits == 0:
        return genomes.view(np.float64)
    points = np.empty((genomes.shape[0], parameters))
    values = np.empty(parameters, np.int64)
    low, high, steps = bounds[0], bounds[1], (np.int64(1) << bits) - 1
    for row in range(genomes.shape[0]):
        integers_of(genomes[row], bits, gray, values)
        for parameter in range(parameters):
            points[row, parameter] = low + (high - low) * values[parameter] / steps
    return points


@kernel(FITNESS, may_be_long=True)
def sphere(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Σ x²: one smooth valley."""
    points = _points(genomes, table)
    for row in range(fitness.size):
        value = 0.0
        for x in points[row]:
            value += x * x
        fitness[row] = value


# The Taylor series of sin πx from x²¹ down to x; beyond that there is nothing left of |x| ≤ ½ in float64.
_SINE = tuple(np.cumprod([np.pi, *(-np.pi * np.pi / (n * (n + 1)) for n in range(2, 22, 2))])[::-1].tolist())


@inlined
def _wave(x: Any) -> Any:
    """1 − cos 2πx = 2 sin² πx, of sums and products only: vectorised, and the same on every machine.

    A library's cosine is neither: its last bit depends on the library and the processor.
    """
    rest = x - np.rint(x)
    square = rest * rest
    sine = 0.0
    for factor in _SINE:
        sine = sine * square + factor
    sine *= rest
    return 2.0 * sine * sine


@kernel(FITNESS, may_be_long=True)
def rastrigin(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """10 n + Σ (x² − 10 cos 2πx): a grid of valleys, the deepest in the middle."""
    points = _points(genomes, table)
    terms = np.empty(points.shape)
    numbers, parts = points.reshape(points.size), terms.reshape(points.size)
    if integers(table, 0)[0, 0] == 0:
        for place in range(parts.size):
            parts[place] = numbers[place] * numbers[place] + 10.0 * _wave(numbers[place])
    else:  # as ever: the histories of bit strings hold their fitness to the last bit
        for place in range(parts.size):
            parts[place] = numbers[place] * numbers[place] + 10.0 * (1.0 - np.cos(2.0 * np.pi * numbers[place]))
    for row in range(fitness.size):
        value = 0.0
        for term in terms[row]:  # one after the other: another order would be another sum
            value += term
        fitness[row] = value


@kernel(FITNESS, may_be_long=True)
def ackley(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """20 + e − 20 exp(−0.2 √(Σ x² / n)) − exp(Σ cos 2πx / n): a plain of dents around one funnel."""
    points = _points(genomes, table)
    for row in range(fitness.size):
        squares, waves = 0.0, 0.0
        for x in points[row]:
            squares += x * x
            waves += np.cos(2.0 * np.pi * x)
        count = points.shape[1]
        funnel = 20.0 * (1.0 - np.exp(-0.2 * np.sqrt(squares / count)))
        fitness[row] = funnel + np.e - np.exp(waves / count)


@kernel(FITNESS, may_be_long=True)
def rosenbrock(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Σ 100 (x_{i+1} − x_i²)² + (1 − x_i)²: a bent, narrow valley."""
    points = _points(genomes, table)
    for row in range(fitness.size):
        value = 0.0
        for number in range(points.shape[1] - 1):
            x, following = points[row, number], points[row, number + 1]
            value += 100.0 * (following - x * x) ** 2 + (1.0 - x) ** 2
        fitness[row] = value


@subroutine
def _ones(octet: Any) -> Any:
    """How many bits of a byte are 1: of each two, then of each four, then of all eight."""
    twos = octet - ((octet >> 1) & 0x55)
    fours = (twos & 0x33) + ((twos >> 2) & 0x33)
    return (fours + (fours >> 4)) & 0x0F


@kernel(FITNESS, may_be_long=True)
def onemax(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """The number of zeros."""
    length, last = integers(table, 0)[0, 2], genomes.shape[1] - 1
    for row in range(fitness.size):
        zeros = length - _ones(genomes[row, last] >> (8 * (last + 1) - length))
        for place in range(last):
            zeros -= _ones(genomes[row, place])
        fitness[row] = zeros


@kernel(FITNESS, may_be_long=True)
def trap(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """For each block of bits 0 if all are 1, else 1 + the number of ones: each step leads away from the optimum."""
    bits = np.empty(integers(table, 0)[0, 2], np.int64)
    block = integers(table, 1)[0, 0]
    for row in range(fitness.size):
        integers_of(genomes[row], 1, False, bits)
        value = 0
        for start in range(0, bits.size, block):
            ones = np.sum(bits[start : start + block])
            if ones < block:
                value += 1 + ones
        fitness[row] = value


@kernel(FITNESS, may_be_long=True)
def partition(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Edges cut + squared sizes of the parts − an offset; a vertex belongs to the part label modulo parts.

    The table goes on with the parts and the offset, and then the edges, shape (edges, 2).
    """
    layout, parts, offset = integers(table, 0)[0], integers(table, 1)[0, 0], integers(table, 1)[0, 1]
    edges = integers(table, 2)
    labels = np.empty(layout[2], np.int64)
    sizes = np.empty(parts, np.int64)
    for row in range(fitness.size):
        integers_of(genomes[row], layout[0], False, labels)
        sizes[:] = 0
        for label in labels:
            sizes[label % parts] += 1
        total = np.int64(-offset)
        for size in sizes:
            total += size * size
        for edge in range(edges.shape[0]):
            total += labels[edges[edge, 0]] % parts != labels[edges[edge, 1]] % parts
        fitness[row] = total


@kernel(types.void(types.int64), may_be_long=True)
def spend(nanoseconds: int) -> None:
    """Use up as much processor time of this thread."""
    time = np.zeros(2, np.int64)
    until = thread_nanoseconds(time) + nanoseconds
    while thread_nanoseconds(time) < until:
        pass
