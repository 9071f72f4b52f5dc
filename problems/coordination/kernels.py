"""The compiled fitness and operators of sequences of synchronisation points (SPs), §3.2.

A sequence in hand is an array of SPs, int64 of shape (room, 2), and their count. The start (0, 0) and the end are no
part of it. The obstacles of a rectangle are counted by a summed-area table, whatever its size.

The table of the fitness (see `genetics.operators`): whether the genome is a bit string, bits of each number, the room
for SPs, N1, N2; seconds of a move of robot 1 by 0, 1, .. cells; of robot 2; the summed-area table (N1 + 1, N2 + 1);
K. The table of the operators: whether of variable length, N1, N2, NMAX, whether tuned; the probability that what comes
of a crossover is mutated.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Fitness, Genomes
from genetics.bit_kernels import integers_of
from genetics.compiled import kernel, subroutine
from genetics.operators import FITNESS, FOUNDING, MATING, Table, integers, reals
from genetics.randomness import CROSS, INITIAL, MUTATE, below, draw, unit
from genetics.sequence_kernels import clear_after, numbers_of

Points = NDArray[np.int64]  # (n, 2)

MUTMAX = 10  # cells, the farthest that a slight mutation shifts a coordinate (§3.2)
MUTANTS = 0.5  # of the offspring come of mutation alone
STRONG = 0.5  # of the mutations are strong
EACH = 0.5  # probability that a strong mutation first mutates one of its two SPs slightly


# Sequences ------------------------------------------------------------------------------------------------------------
@subroutine
def _repair(points: Any, count: Any) -> Any:
    """From the last SP to the first: a conflicting coordinate takes the next SP's (§3.2, restrictions)."""
    for place in range(count - 2, -1, -1):
        for axis in range(2):
            points[place, axis] = min(points[place, axis], points[place + 1, axis])


@subroutine
def _read(numbers: Any, points: Any) -> Any:
    """The SPs of a sequence's numbers; returns how many."""
    count = np.int64(numbers[0])
    for place in range(count):
        points[place, 0], points[place, 1] = numbers[1 + 2 * place], numbers[2 + 2 * place]
    _repair(points, count)
    return count


@subroutine
def _write(points: Any, count: Any, numbers: Any) -> Any:
    """The inverse of `_read`."""
    clear_after(numbers, count, 2)
    for place in range(count):
        numbers[1 + 2 * place], numbers[2 + 2 * place] = points[place, 0], points[place, 1]


@subroutine
def _scale(values: Any, bits: Any, last: Any, points: Any) -> Any:
    """Integers of ``bits`` bits as the nearest coordinates, 0 to ``last`` (N1 − 1, N2 − 1)."""
    greatest = (np.int64(1) << bits) - 1
    for place in range(values.size):
        points[place >> 1, place & 1] = (2 * values[place] * last[place & 1] + greatest) // (2 * greatest)


# Fitness --------------------------------------------------------------------------------------------------------------
class Diagram(NamedTuple):
    """Where the robots collide and how fast they are."""

    last: Any  # (2,): N1 − 1, N2 − 1
    times_1: Any  # (N1,), s
    times_2: Any  # (N2,), s
    sums: Any  # (N1 + 1, N2 + 1): obstacle cells with smaller indices in both
    offset: Any  # K, s


@subroutine
def _diagram_of(table: Any) -> Any:
    last = integers(table, 0)[0, 3:5] - 1
    return Diagram(last, reals(table, 1)[0], reals(table, 2)[0], integers(table, 3), reals(table, 4)[0, 0])


@subroutine
def _points_of(genome: Any, layout: Any, last: Any, values: Any, points: Any) -> Any:
    """The SPs that a genome stands for, increasing; returns how many."""
    if layout[0] == 0:
        return _read(numbers_of(genome), points)
    integers_of(genome, layout[1], False, values)
    _scale(values, layout[1], last, points)
    _repair(points, layout[2])
    return layout[2]


@subroutine
def _measure(points: Any, count: Any, diagram: Any) -> Any:
    """Seconds that a sequence takes, and the obstacle cells in its rectangles, counted once in each (§3.2, fitness).

    A rectangle has both its corners; one without extent, between two SPs at one cell, is none.
    """
    sums = diagram.sums
    time, obstacles = 0.0, np.int64(0)
    left, bottom = np.int64(0), np.int64(0)
    for place in range(count + 1):
        right, top = diagram.last[0], diagram.last[1]
        if place < count:
            right, top = points[place, 0], points[place, 1]
        if right == left and top == bottom:
            continue
        obstacles += sums[right + 1, top + 1] - sums[left, top + 1] - sums[right + 1, bottom] + sums[left, bottom]
        time += max(diagram.times_1[right - left], diagram.times_2[top - bottom])
        left, bottom = right, top
    return time, obstacles


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Seconds of a valid sequence; K + nco of another (§3.2)."""
    layout, diagram = integers(table, 0)[0], _diagram_of(table)
    points, values = np.empty((layout[2], 2), np.int64), np.empty(2 * layout[2], np.int64)
    for row in range(fitness.size):
        count = _points_of(genomes[row], layout, diagram.last, values, points)
        time, obstacles = _measure(points, count, diagram)
        fitness[row] = time if obstacles == 0 else diagram.offset + obstacles


@kernel("Tuple((int64[:,::1], float64))(uint8[::1], int64[:,::1])")
def follow(genome: Genomes, table: Table) -> tuple[Points, float]:
    """The SPs, shape (n, 2), that a genome stands for, and the seconds they take."""
    layout, diagram = integers(table, 0)[0], _diagram_of(table)
    points, values = np.empty((layout[2], 2), np.int64), np.empty(2 * layout[2], np.int64)
    count = _points_of(genome, layout, diagram.last, values, points)
    return points[:count].copy(), _measure(points, count, diagram)[0]


# Operators ------------------------------------------------------------------------------------------------------------
class Chance(NamedTuple):
    """What the draws for one offspring are keyed by."""

    seed: Any
    cell: Any
    generation: Any
    child: Any


# The numbers of an offspring's draws of purpose MUTATE; a slight mutation takes three.
_WHETHER, _WHICH, _PLACE, _INSERT, _SLIGHT, _SLIGHT_TOO = 0, 1, 2, 3, 5, 8


@subroutine
def _share(chance: Any, purpose: Any, number: Any) -> Any:
    """A float in [0, 1)."""
    return unit(draw(chance.seed, chance.cell, chance.generation, purpose, chance.child, number))


@subroutine
def _choice(chance: Any, purpose: Any, number: Any, limit: Any) -> Any:
    """An integer in [0, limit)."""
    return below(draw(chance.seed, chance.cell, chance.generation, purpose, chance.child, number), limit)


@subroutine
def _sort(points: Any, count: Any) -> Any:
    """Each coordinate by itself in increasing order."""
    for axis in range(2):
        points[:count, axis].sort()


@kernel(FOUNDING)
def founding(deme: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Sorted uniform draws; n SPs with probability ∝ n on 1..NMAX, or always NMAX (§3.2, initial population)."""
    variable, sides, most = integers(table, 0)[0, 0], integers(table, 0)[0, 1:3], integers(table, 0)[0, 3]
    points = np.empty((most, 2), np.int64)
    for individual in range(deme.shape[0]):
        chance = Chance(seed, cell, generation, individual)
        count = most
        if variable:  # of most * (most + 1) / 2 tickets, n has n
            ticket = _choice(chance, INITIAL, 0, most * (most + 1) // 2)
            count = np.int64((1.0 + np.sqrt(1.0 + 8.0 * ticket)) / 2.0)
        for place in range(2 * count):
            points[place >> 1, place & 1] = _choice(chance, INITIAL, 1 + place, sides[place & 1])
        _sort(points, count)
        _write(points, count, numbers_of(deme[individual]))


@subroutine
def _cross_variable(first: Any, count: Any, second: Any, others: Any, chance: Any) -> Any:
    """``first`` up to P, then ``second`` from Q, its first SP beyond P in both coordinates (§3.2, figure 1).

    Leaves the child in ``first`` and returns its count; it stays a copy if there is no Q, or no room.
    """
    cut = _choice(chance, CROSS, 1, count)
    for place in range(others):
        if second[place, 0] > first[cut, 0] and second[place, 1] > first[cut, 1]:
            crossed = cut + 1 + others - place
            if crossed > first.shape[0]:
                return count
            first[cut + 1 : crossed] = second[place:others]
            return crossed
    return count


@subroutine
def _cross_fixed(first: Any, second: Any, count: Any, chance: Any) -> Any:
    """One-point crossover at an SP, in place (*unstated*: §3.1 leaves the operators to its reference)."""
    cut = 1 + _choice(chance, CROSS, 1, count - 1) if count > 1 else 1
    first[cut:count] = second[cut:count]
    _repair(first, count)


@subroutine
def _shift(points: Any, place: Any, sides: Any, chance: Any, number: Any) -> Any:
    """The slight mutation of one SP: two independent integers within ±MUTMAX (§3.2); to be repaired."""
    for axis in range(2):
        shift = _choice(chance, MUTATE, number + axis, 2 * MUTMAX + 1) - MUTMAX
        points[place, axis] = min(max(points[place, axis] + shift, 0), sides[axis] - 1)


@subroutine
def _corner(points: Any, count: Any, place: Any, axis: Any, sides: Any) -> Any:
    """A coordinate of an SP, of the start (−1) or of the end (``count``)."""
    if place < 0:
        return np.int64(0)
    return points[place, axis] if place < count else sides[axis] - 1


@subroutine
def _insert(points: Any, count: Any, place: Any, i: Any, j: Any) -> Any:
    """Put an SP at ``place``; returns the new count."""
    for later in range(count, place, -1):
        points[later] = points[later - 1]
    points[place, 0], points[place, 1] = i, j
    return count + 1


@subroutine
def _strengthen(points: Any, count: Any, sides: Any, chance: Any) -> Any:
    """The strong mutation: an SP more between two that are mutated slightly (§3.2, figure 2); returns the new count.

    The end takes the place of the second SP where there is one only.
    """
    place = _choice(chance, MUTATE, _PLACE, max(count - 1, 1))
    for which, number in ((place, _SLIGHT), (place + 1, _SLIGHT_TOO)):
        if which < count and _share(chance, MUTATE, number) < EACH:
            _shift(points, which, sides, chance, number + 1)
    _repair(points, count)
    i, j = points[place, 0], points[place, 1]
    width = _corner(points, count, place + 1, 0, sides) - i
    height = _corner(points, count, place + 1, 1, sides) - j
    if min(width, height) < 2 or count == points.shape[0]:
        return count
    i += 1 + _choice(chance, MUTATE, _INSERT, width - 1)
    j += 1 + _choice(chance, MUTATE, _INSERT + 1, height - 1)
    return _insert(points, count, place + 1, i, j)


@subroutine
def _redraw(points: Any, count: Any, sides: Any, chance: Any) -> Any:
    """The strong mutation of fixed lengths: an SP anywhere between its neighbours (*unstated*)."""
    place = _choice(chance, MUTATE, _PLACE, count)
    for axis in range(2):
        low = _corner(points, count, place - 1, axis, sides)
        high = _corner(points, count, place + 1, axis, sides)
        points[place, axis] = low + _choice(chance, MUTATE, _INSERT + axis, high - low + 1)


@subroutine
def _mutate(points: Any, count: Any, sides: Any, variable: Any, chance: Any) -> Any:
    """A slight or a strong mutation; returns the new count."""
    if _share(chance, MUTATE, _WHICH) >= STRONG:
        _shift(points, _choice(chance, MUTATE, _PLACE, count), sides, chance, _SLIGHT)
        _repair(points, count)
    elif variable:
        count = _strengthen(points, count, sides, chance)
    else:
        _redraw(points, count, sides, chance)
    return count


@kernel(MATING)
def mating(couples: Genomes, offspring: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Each parent with the other one: a mutant of it, or their child, perhaps mutated (§3.2, characteristics)."""
    layout, mutated = integers(table, 0)[0], reals(table, 1)[0, 0]
    variable, sides, tuned = layout[0] != 0, layout[1:3], layout[4] != 0
    room = (numbers_of(offspring[0]).size - 1) // 2
    own, other = np.empty((room, 2), np.int64), np.empty((room, 2), np.int64)
    for child in range(offspring.shape[0]):
        chance = Chance(seed, cell, generation, child)
        count = _read(numbers_of(couples[child >> 1, child & 1]), own)
        mutant = _share(chance, CROSS, 0) < MUTANTS
        if not mutant:
            others = _read(numbers_of(couples[child >> 1, 1 - (child & 1)]), other)
            if variable:
                count = _cross_variable(own, count, other, others, chance)
            else:
                _cross_fixed(own, other, count, chance)
        if mutant or _share(chance, MUTATE, _WHETHER) < mutated:
            count = _mutate(own, count, sides, variable, chance)
        _write(own, count, numbers_of(offspring[child]))
