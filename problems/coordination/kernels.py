"""The compiled fitness of sequences of synchronisation points (SPs), §3.2; see `sequences`.

The table of the fitness (see `genetics.operators`) holds whether the genome is a bit string, the bits of each number
and the room for SPs; the seconds of a move of robot 1 by 0, 1, .. cells; those of robot 2; the summed-area table,
(N1 + 1, N2 + 1); and K.
"""

from typing import Any

import numpy as np

from genetics.arrays import Fitness, Genomes
from genetics.bit_kernels import integers_of
from genetics.operators import FITNESS, Table
from genetics.sequence_kernels import numbers_of
from lowlevel.compiled import kernel, subroutine
from lowlevel.pointers import integers, reals
from problems.coordination.sequences import Points, diagram_of, measure, read, repair


@subroutine
def _scale(values: Any, bits: Any, last: Any, points: Any) -> Any:
    """Fill ``points`` with integers of ``bits`` bits scaled to coordinates from 0 to ``last``, rounded to nearest."""
    greatest = (np.int64(1) << bits) - 1
    for place in range(values.size):
        points[place >> 1, place & 1] = (2 * values[place] * last[place & 1] + greatest) // (2 * greatest)


@subroutine
def _points_of(genome: Any, layout: Any, last: Any, values: Any, points: Any) -> Any:
    """Fill ``points`` with the SPs that a genome codes, repaired, and return their count."""
    if layout[0] == 0:
        return read(numbers_of(genome), points)
    integers_of(genome, layout[1], False, values)
    _scale(values, layout[1], last, points)
    repair(points, layout[2])
    return layout[2]


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Compute the fitness (§3.2): the seconds of a valid sequence, K + nco of another."""
    layout, diagram = integers(table, 0)[0], diagram_of(table, 1)
    offset = reals(table, 4)[0, 0]
    points, values = np.empty((layout[2], 2), np.int64), np.empty(2 * layout[2], np.int64)
    for row in range(fitness.size):
        count = _points_of(genomes[row], layout, diagram.last, values, points)
        time, obstacles = measure(points, count, diagram)
        fitness[row] = time if obstacles == 0 else offset + obstacles


@kernel("Tuple((int64[:,::1], float64))(uint8[::1], int64[:,::1])")
def follow(genome: Genomes, table: Table) -> tuple[Points, float]:
    """Return the SPs that a genome codes, shape (n, 2), and the seconds that the sequence takes."""
    layout, diagram = integers(table, 0)[0], diagram_of(table, 1)
    points, values = np.empty((layout[2], 2), np.int64), np.empty(2 * layout[2], np.int64)
    count = _points_of(genome, layout, diagram.last, values, points)
    return points[:count].copy(), measure(points, count, diagram)[0]
