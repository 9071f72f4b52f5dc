"""The compiled values of the known functions, of many points at once."""

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Fitness
from genetics.compiled import kernel

Points = NDArray[np.float64]  # (n, dimension)
Integers = NDArray[np.int64]


@kernel("float64[::1](float64[:,::1])")
def sphere(points: Points) -> Fitness:
    """Σ x²: one smooth valley."""
    values = np.zeros(points.shape[0])
    for row in range(points.shape[0]):
        for x in points[row]:
            values[row] += x * x
    return values


@kernel("float64[::1](float64[:,::1])")
def rastrigin(points: Points) -> Fitness:
    """10 n + Σ (x² − 10 cos 2πx): a grid of valleys, the deepest in the middle."""
    values = np.zeros(points.shape[0])
    for row in range(points.shape[0]):
        for x in points[row]:
            values[row] += x * x + 10.0 * (1.0 - np.cos(2.0 * np.pi * x))
    return values


@kernel("float64[::1](float64[:,::1])")
def ackley(points: Points) -> Fitness:
    """20 + e − 20 exp(−0.2 √(Σ x² / n)) − exp(Σ cos 2πx / n): a plain of dents around one funnel."""
    values = np.empty(points.shape[0])
    for row in range(points.shape[0]):
        squares, waves = 0.0, 0.0
        for x in points[row]:
            squares += x * x
            waves += np.cos(2.0 * np.pi * x)
        count = points.shape[1]
        funnel = 20.0 * (1.0 - np.exp(-0.2 * np.sqrt(squares / count)))
        values[row] = funnel + np.e - np.exp(waves / count)
    return values


@kernel("float64[::1](float64[:,::1])")
def rosenbrock(points: Points) -> Fitness:
    """Σ 100 (x_{i+1} − x_i²)² + (1 − x_i)²: a bent, narrow valley."""
    values = np.zeros(points.shape[0])
    for row in range(points.shape[0]):
        for number in range(points.shape[1] - 1):
            x, following = points[row, number], points[row, number + 1]
            values[row] += 100.0 * (following - x * x) ** 2 + (1.0 - x) ** 2
    return values


@kernel("float64[::1](int64[:,::1])")
def onemax(bits: Integers) -> Fitness:
    """The number of zeros."""
    values = np.zeros(bits.shape[0])
    for row in range(bits.shape[0]):
        for bit in bits[row]:
            values[row] += 1 - bit
    return values


@kernel("float64[::1](int64[:,::1], int64)")
def trap(bits: Integers, block: int) -> Fitness:
    """For each block of bits 0 if all are 1, else 1 + the number of ones: each step leads away from the optimum."""
    values = np.zeros(bits.shape[0])
    for row in range(bits.shape[0]):
        for start in range(0, bits.shape[1], block):
            ones = 0
            for bit in bits[row, start : start + block]:
                ones += bit
            if ones < block:
                values[row] += 1 + ones
    return values


@kernel("float64[::1](int64[:,::1], int64[:,::1], int64, int64)")
def partition(labels: Integers, edges: Integers, parts: int, offset: int) -> Fitness:
    """Edges cut + squared sizes of the parts − ``offset``; a vertex belongs to the part label modulo parts."""
    values = np.empty(labels.shape[0])
    sizes = np.empty(parts, np.int64)
    for row in range(labels.shape[0]):
        sizes[:] = 0
        for vertex in range(labels.shape[1]):
            sizes[labels[row, vertex] % parts] += 1
        total = np.int64(-offset)
        for size in sizes:
            total += size * size
        for edge in range(edges.shape[0]):
            total += labels[row, edges[edge, 0]] % parts != labels[row, edges[edge, 1]] % parts
        values[row] = total
    return values
