"""The compiled operators of §IV: how trajectories are made, crossed and mutated.

An item of the genome is a node: for each joint a gene, 0 at the start and the greatest at the goal, and the torque
level of the stretch that ends there. The last item is the goal; the start is no item. New nodes lie on the grid; genes
may be finer than the grid, for nodes anywhere in the box.

Every random draw has a number. Where a function may make several draws, the caller leaves it a range of numbers wide
enough for all of them, so that no two decisions about one individual share a draw.

The parts of the table of both operators: joints, most items, least level and whether the operators refine; the greatest
gene and the grid steps of each joint, shape (2, joints); the crossover's radius and the rate of mutation.
"""

from typing import Any, NamedTuple

import numpy as np

from genetics.arrays import Genomes
from genetics.operators import INITIALISE, VARIATION, Table
from genetics.randomness import CROSS, INITIAL, MUTATE, below, draw, normal, unit
from genetics.sequence_kernels import clear_after, numbers_of
from lowlevel import pointers
from lowlevel.compiled import kernel, subroutine
from problems.min_time.levels import LEVELS

MOST_COPIES = 2
"""How often the same trajectory may be among the offspring (§IV)."""

_DESTROY, _DYNAMIC = 1.0 / 6.0, 1.0 / 3.0
"""Probabilities of the destroy and dynamic mutations, as shares of the position mutation's.

With the paper recipe's rate of 0.3 for the position they are 0.05 and 0.1.
"""

_SECOND_LIFE = 1 << 20  # first number of the draws for the trajectory that replaces an extra copy
_FINEST = 6.0  # the finest shift of a node is 2 ** -6 of the coarsest


class Shape(NamedTuple):
    """The layout of genomes."""

    joints: Any
    width: Any  # genes of an item
    most: Any  # the greatest number of items
    least_level: Any  # of torque; the greatest is `LEVELS`
    greatest: Any  # (joints,), genes at the goal
    cells: Any  # (joints,), steps of the grid


class Dice(NamedTuple):
    """The coordinates that all random draws of a cell in a generation share."""

    seed: Any
    cell: Any
    generation: Any


@subroutine
def _shape_of(table: Any) -> Any:
    layout, sizes = pointers.integers(table, 0)[0], pointers.integers(table, 1)
    return Shape(layout[0], layout[0] + 1, layout[1], layout[2], sizes[0], sizes[1])


@subroutine
def _gene(place: Any, greatest: Any, cells: Any) -> Any:
    """Return the gene nearest to a line of the grid."""
    return 0 if cells == 0 else (place * greatest + cells // 2) // cells


@subroutine
def _level(bits: Any, shape: Any) -> Any:
    return shape.least_level + below(bits, LEVELS + 1 - shape.least_level)


@subroutine
def _is_same(numbers: Any, one: Any, other: Any, shape: Any) -> Any:
    """Return whether two items are at the same place; item -1 is the start."""
    for joint in range(shape.joints):
        gene = 0 if other < 0 else numbers[1 + other * shape.width + joint]
        if numbers[1 + one * shape.width + joint] != gene:
            return False
    return True


@subroutine
def _tidy(numbers: Any, shape: Any) -> Any:
    """Set the last item to the goal, and leave out nodes that repeat the one before and ways there and back.

    So no curve stands still on its way.
    """
    width, items = shape.width, np.int64(numbers[0])
    last = 1 + (items - 1) * width
    numbers[last : last + shape.joints] = shape.greatest
    count = 0
    for item in range(items):
        # Items move forwards in place: count never exceeds item.
        if item > count:
            numbers[1 + count * width : 1 + (count + 1) * width] = numbers[1 + item * width : 1 + (item + 1) * width]
        # A way there and back: the node before goes, and this one coincides with the one before that.
        if count > 0 and _is_same(numbers, count, count - 2, shape):
            count -= 1
        elif (count == 0 and item == items - 1) or not _is_same(numbers, count, count - 1, shape):
            count += 1
    clear_after(numbers, count, width)


# The relative transition scheme (figure 1) -------------------------------------------------------------------------
@subroutine
def _draw_move(move: Any, place: Any, shape: Any, dice: Any, individual: Any, number: Any) -> Any:
    """Fill a move to a neighbour with at most one joint away from the goal; return the number of the next draw.

    A move has the probability 2 ** (joints towards - joints away), relative to others. That is a product over the
    joints, so each joint is drawn by itself with weights 2 : 1 : 1/2 (4 : 2 : 1 below), and the whole move is drawn
    anew until it is allowed.
    """
    while True:
        away, moving = 0, 0
        for joint in range(shape.joints):
            towards = 4 if place[joint] < shape.cells[joint] else 0
            back = 1 if place[joint] > 0 else 0
            ticket = below(draw(dice.seed, dice.cell, dice.generation, INITIAL, individual, number), towards + 2 + back)
            number += 1
            move[joint] = 1 if ticket < towards else (0 if ticket < towards + 2 else -1)
            away += move[joint] < 0
            moving += move[joint] != 0
        if moving > 0 and away <= 1:
            return number


@subroutine
def _grow(numbers: Any, shape: Any, dice: Any, individual: Any, number: Any) -> Any:
    """Fill a random trajectory from the start to the goal, which always arrives.

    Once the items that are left are only just enough, each joint that is not at its goal moves towards it.
    """
    place, move = np.zeros(shape.joints, np.int64), np.zeros(shape.joints, np.int64)
    count = 0
    while count == 0 or np.any(place < shape.cells):
        needed = np.max(shape.cells - place)
        # Beyond this, only moves towards the goal are made, for all joints at once: as many as the joint with most to
        # go needs.
        if shape.most - count <= needed + 1 or needed == 0:  # a move away would take two items
            for joint in range(shape.joints):
                move[joint] = 1 if place[joint] < shape.cells[joint] else 0
        else:
            number = _draw_move(move, place, shape, dice, individual, number)
        first = 1 + count * shape.width
        for joint in range(shape.joints):
            place[joint] += move[joint]
            numbers[first + joint] = _gene(place[joint], shape.greatest[joint], shape.cells[joint])
        level = draw(dice.seed, dice.cell, dice.generation, INITIAL, individual, number)
        numbers[first + shape.joints] = _level(level, shape)
        number += 1
        count += 1
    clear_after(numbers, count, shape.width)
    _tidy(numbers, shape)


@kernel(INITIALISE)
def initialise(deme: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Fill the deme with random trajectories by the relative transition scheme."""
    shape, dice = _shape_of(table), Dice(seed, cell, generation)
    for individual in range(deme.shape[0]):
        _grow(numbers_of(deme[individual]), shape, dice, individual, 0)


# Analogous crossover (§IV) --------------------------------------------------------------------------------------------
@subroutine
def _nearest(numbers: Any, place: Any, shape: Any) -> Any:
    """Return the intermediate node (-1: none) nearest to a place in the unit box, and the squared distance."""
    best, best_distance = -1, np.inf
    for item in range(np.int64(numbers[0]) - 1):
        distance = 0.0
        for joint in range(shape.joints):
            if shape.greatest[joint] > 0:
                off = numbers[1 + item * shape.width + joint] / shape.greatest[joint] - place[joint]
                distance += off * off
        if distance < best_distance:
            best, best_distance = item, distance
    return best, best_distance


@subroutine
def _join(child: Any, head: Any, last: Any, tail: Any, first: Any, shape: Any) -> Any:
    """Fill items of ``head`` up to ``last``, then of ``tail`` from ``first`` on; if there is no room, copy ``head``."""
    width, count = shape.width, np.int64(tail[0]) - first
    if last + 1 + count > shape.most:
        child[:] = head
        return
    split = 1 + (last + 1) * width
    child[:split] = head[:split]
    child[split : split + count * width] = tail[1 + first * width : 1 + (first + count) * width]
    clear_after(child, last + 1 + count, width)


@subroutine
def _cross(one: Any, other: Any, child: Any, second: Any, radius: Any, shape: Any, dice: Any, couple: Any) -> Any:
    """Cut one parent at an intermediate node, the other at its node nearest to that, if it is within the radius.

    Without such a node the offspring are copies of their parents.
    """
    child[:], second[:] = one, other
    inner = np.int64(one[0]) - 1
    if inner < 1:
        return
    cut = below(draw(dice.seed, dice.cell, dice.generation, CROSS, couple, 0), inner)
    place = np.zeros(shape.joints)
    for joint in range(shape.joints):
        if shape.greatest[joint] > 0:
            place[joint] = one[1 + cut * shape.width + joint] / shape.greatest[joint]
    # The cut is an intermediate node of both parents, so start and goal are never cut off.
    match, distance = _nearest(other, place, shape)
    if match >= 0 and distance <= radius * radius:
        _join(child, one, cut, other, match + 1, shape)
        _join(second, other, match, one, cut + 1, shape)


# Mutations (§IV) ------------------------------------------------------------------------------------------------------
@subroutine
def _bits(dice: Any, child: Any, number: Any) -> Any:
    return draw(dice.seed, dice.cell, dice.generation, MUTATE, child, number)


@subroutine
def _shift(numbers: Any, item: Any, size: Any, shape: Any, dice: Any, child: Any, number: Any) -> Any:
    """Move a node within the box by a normal deviate in each joint, whose standard deviation is ``size`` grid steps."""
    for joint in range(shape.joints):
        greatest = shape.greatest[joint]
        if greatest > 0:
            deviate = normal(_bits(dice, child, number + 2 * joint), _bits(dice, child, number + 2 * joint + 1))
            place = 1 + item * shape.width + joint
            shifted = numbers[place] + np.rint(deviate * size * greatest / shape.cells[joint])
            numbers[place] = np.int64(min(np.float64(greatest), max(0.0, shifted)))


@subroutine
def _change_some(numbers: Any, dynamic: Any, size: Any, shape: Any, dice: Any, child: Any, number: Any) -> Any:
    """Shift one node, or draw the level of one stretch anew; with probability 1/2 change one more, and so on (§IV)."""
    for _ in range(shape.most):
        if dynamic:
            item = below(_bits(dice, child, number + 1), np.int64(numbers[0]))
            numbers[1 + item * shape.width + shape.joints] = _level(_bits(dice, child, number + 2), shape)
        elif numbers[0] > 1:
            item = below(_bits(dice, child, number + 1), np.int64(numbers[0]) - 1)
            _shift(numbers, item, size, shape, dice, child, number + 2)
        if unit(_bits(dice, child, number)) < 0.5:
            return
        number += 2 + 2 * shape.joints


@subroutine
def _mutate(numbers: Any, rate: Any, shape: Any, dice: Any, child: Any) -> Any:
    """Apply the destroy, position and dynamic operators, each with its probability.

    Each of them has its own number for the decision (0, 1, 2) and its own range of numbers for what follows.
    """
    if unit(_bits(dice, child, 0)) < rate * _DESTROY:
        _grow(numbers, shape, dice, child, 0)
    stride = (2 + 2 * shape.joints) * (shape.most + 1)
    if unit(_bits(dice, child, 1)) < rate:
        _change_some(numbers, False, 0.5, shape, dice, child, 3)
    if unit(_bits(dice, child, 2)) < rate * _DYNAMIC:
        _change_some(numbers, True, 0.0, shape, dice, child, 3 + stride)


# Refinement: the tuned recipe's mutations --------------------------------------------------------------------------
@subroutine
def _leave_out(numbers: Any, item: Any, shape: Any) -> Any:
    """Leave out one of a trajectory's nodes."""
    width, count = shape.width, np.int64(numbers[0])
    for place in range(1 + item * width, 1 + (count - 1) * width):
        numbers[place] = numbers[place + width]
    clear_after(numbers, count - 1, width)


@subroutine
def _put_in(numbers: Any, item: Any, shape: Any) -> Any:
    """Put in a node half way to an item; both stretches have that item's level."""
    width, count = shape.width, np.int64(numbers[0])
    for place in range(count * width, item * width, -1):
        numbers[place + width] = numbers[place]
    first = 1 + item * width
    for joint in range(shape.joints):
        before = np.int64(numbers[first - width + joint]) if item > 0 else 0
        numbers[first + joint] = (before + np.int64(numbers[first + joint]) + 1) // 2
    numbers[0] = count + 1


@subroutine
def _refine(numbers: Any, rate: Any, shape: Any, dice: Any, child: Any) -> Any:
    """Make small changes of all sizes: leave out, put in and shift nodes, raise levels.

    Levels are never lowered: less torque never makes a given curve faster.
    """
    count = np.int64(numbers[0])
    # With half of the rate a node is left out, with the other half one is put in. Fewer nodes make quicker curves, but
    # some curves need one more.
    kind = unit(_bits(dice, child, 0))
    if kind < 0.5 * rate and count > 2:
        _leave_out(numbers, below(_bits(dice, child, 1), count - 1), shape)
    elif kind < rate and count < shape.most:
        _put_in(numbers, below(_bits(dice, child, 1), count), shape)
    size = 2.0 ** (1.0 - _FINEST * unit(_bits(dice, child, 2)))
    for joint in range(shape.joints):  # genes are integers: shifts far below half a gene would all be rounded to 0
        if shape.greatest[joint] > 0:
            size = max(size, 0.5 * shape.cells[joint] / shape.greatest[joint])
    number = 3
    # A shift is tried on most offspring; the others keep the nodes as crossover or the change above left them.
    if unit(_bits(dice, child, number)) < 0.8:
        _change_some(numbers, False, size, shape, dice, child, number + 1)
    number += (2 + 2 * shape.joints) * (shape.most + 1) + 1
    if shape.least_level < LEVELS:
        for item in range(np.int64(numbers[0])):
            if unit(_bits(dice, child, number + 2 * item)) < rate:
                place = 1 + item * shape.width + shape.joints
                numbers[place] = max(np.int64(numbers[place]), _level(_bits(dice, child, number + 2 * item + 1), shape))


@subroutine
def _copies_before(offspring: Any, child: Any) -> Any:
    """Return how many of the earlier offspring are the same."""
    copies = 0
    for other in range(child):
        if np.array_equal(offspring[other], offspring[child]):
            copies += 1
    return copies


@kernel(VARIATION)
def variation(couples: Genomes, offspring: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Cross and mutate; random trajectories replace extra copies of the same trajectory (§IV)."""
    shape, dice = _shape_of(table), Dice(seed, cell, generation)
    refining, rates = pointers.integers(table, 0)[0, 3] != 0, pointers.reals(table, 2)[0]
    for couple in range(couples.shape[0]):
        one, other = numbers_of(couples[couple, 0]), numbers_of(couples[couple, 1])
        # The second offspring is the cut seen from the other parent: its head, and the first one's tail.
        first, second = numbers_of(offspring[2 * couple]), numbers_of(offspring[2 * couple + 1])
        _cross(one, other, first, second, rates[0], shape, dice, couple)
    for child in range(offspring.shape[0]):
        numbers = numbers_of(offspring[child])
        if refining:
            _refine(numbers, rates[1], shape, dice, child)
        else:
            _mutate(numbers, rates[1], shape, dice, child)
        _tidy(numbers, shape)
        # Copies are counted among the offspring of this cell; a third one of the same trajectory is replaced.
        if _copies_before(offspring, child) >= MOST_COPIES:
            _grow(numbers, shape, dice, child, _SECOND_LIFE)
