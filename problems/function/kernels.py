"""The compiled known functions, which evaluate many genomes in one call.

All have the signature `genetics.operators.FITNESS`. The first place of their tables holds the bits of each parameter (0
if it is float64), whether they are in Gray code, and the number of parameters. For functions of numbers, the bounds
follow; for others, what the function's docstring says.
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
    """Return the numbers that genomes code, shape (n, parameters)."""
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
    """Compute Σ x²: one smooth valley."""
    points = _points(genomes, table)
    for row in range(fitness.size):
        value = 0.0
        for x in points[row]:
            value += x * x
        fitness[row] = value


# The coefficients of the Taylor series of sin πx, from x²¹ down to x. For |x| ≤ ½ further terms vanish in float64.
_SINE = tuple(np.cumprod([np.pi, *(-np.pi * np.pi / (n * (n + 1)) for n in range(2, 22, 2))])[::-1].tolist())


@inlined
def _wave(x: Any) -> Any:
    """Return 1 − cos 2πx = 2 sin² πx, computed with sums and products only.

    So the loop is vectorised, and the value is the same on every machine. Neither holds for a library's cosine, whose
    last bit depends on the library and the processor.
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
    """Compute 10 n + Σ (x² − 10 cos 2πx): a grid of valleys, the deepest in the middle."""
    points = _points(genomes, table)
    terms = np.empty(points.shape)
    numbers, parts = points.reshape(points.size), terms.reshape(points.size)
    if integers(table, 0)[0, 0] == 0:
        for place in range(parts.size):
            parts[place] = numbers[place] * numbers[place] + 10.0 * _wave(numbers[place])
    else:  # coded numbers keep the library's cosine: recorded histories hold their fitness to the last bit
        for place in range(parts.size):
            parts[place] = numbers[place] * numbers[place] + 10.0 * (1.0 - np.cos(2.0 * np.pi * numbers[place]))
    for row in range(fitness.size):
        value = 0.0
        for term in terms[row]:  # in this order: another one would round differently
            value += term
        fitness[row] = value


@kernel(FITNESS, may_be_long=True)
def ackley(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Compute 20 + e − 20 exp(−0.2 √(Σ x² / n)) − exp(Σ cos 2πx / n): a plain of dents around one funnel."""
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
    """Compute Σ 100 (x_{i+1} − x_i²)² + (1 − x_i)²: a bent, narrow valley."""
    points = _points(genomes, table)
    for row in range(fitness.size):
        value = 0.0
        for number in range(points.shape[1] - 1):
            x, following = points[row, number], points[row, number + 1]
            value += 100.0 * (following - x * x) ** 2 + (1.0 - x) ** 2
        fitness[row] = value


@subroutine
def _ones(octet: Any) -> Any:
    """Return how many bits of a byte are 1: count in pairs, then in fours, then in all eight."""
    twos = octet - ((octet >> 1) & 0x55)
    fours = (twos & 0x33) + ((twos >> 2) & 0x33)
    return (fours + (fours >> 4)) & 0x0F


@kernel(FITNESS, may_be_long=True)
def onemax(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Compute the number of zeros. Genomes are packed, eight bits to a byte; the last byte may be partly used."""
    length, last = integers(table, 0)[0, 2], genomes.shape[1] - 1  # 8 · (last + 1) − length bits at the end are unused
    for row in range(fitness.size):
        zeros = length - _ones(genomes[row, last] >> (8 * (last + 1) - length))
        for place in range(last):
            zeros -= _ones(genomes[row, place])
        fitness[row] = zeros


@kernel(FITNESS, may_be_long=True)
def trap(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Compute the sum over blocks of bits: 0 if all are 1, else 1 + the number of ones.

    The fewer ones, the better, so each improvement leads away from the optimum. The table goes on with the bits of a
    block.
    """
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
    """Compute cut edges + squared sizes of the parts − an offset.

    A vertex belongs to the part with the number label modulo parts, since labels of whole bits may exceed the parts.
    The table goes on with the number of parts and the offset, then the edges, shape (edges, 2).
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
    """Use up processor time of this thread."""
    time = np.zeros(2, np.int64)
    # Processor time, not wall-clock time: on a busy machine an evaluation must cost the same amount of work.
    until = thread_nanoseconds(time) + nanoseconds
    while thread_nanoseconds(time) < until:
        pass
