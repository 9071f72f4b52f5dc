"""The variation of the tuned recipe: paths are joined where they are nearest, and offspring are shortened.

Whatever is done to a free path leaves it free. An offspring of paths that are not free is a new one from larger trees,
or a parent whose blocked stretch has been mended.
"""

from typing import Any

import numpy as np

from genetics.arrays import Genomes
from genetics.operators import VARIATION, Table
from genetics.randomness import MUTATE
from genetics.sequence_kernels import numbers_of
from lowlevel import pointers
from lowlevel.compiled import kernel, subroutine
from problems.robot_path.layout_kernels import (
    MOST_POINTS,
    RATE,
    dice_of,
    distance,
    is_free_all_along,
    is_same,
    is_step_free,
    length_of,
    pick,
    read_way,
    task_of,
    toss,
    write_way,
)
from problems.robot_path.making_kernels import STEP, find_way, free_line, go_straight, search_in
from problems.robot_path.shortening_kernels import insert, shorten
from problems.robot_path.tree_kernels import Search, grow

_TRIES = 12  # to shorten the first offspring of a cell
_FEW_TRIES = 1  # to shorten another one
_FRESH_BUDGET = 1000  # tests of a tree that looks for a shorter way of another kind


@subroutine
def _join(one: Any, ones: Any, other: Any, others: Any, child: Any, task: Any, dice: Any) -> Any:
    """Fill a child: the first parent up to a point, and from the point of the other that is nearest; 0 if not free.

    Returns the number of points.
    """
    if ones < 3 or others < 3:
        return 0
    cut = 1 + pick(dice, ones - 2)
    best = 1
    for place in range(2, others - 1):
        if distance(one[cut], other[place]) < distance(one[cut], other[best]):
            best = place
    if cut + 1 + others - best > MOST_POINTS or not is_step_free(task, one[cut], other[best]):
        return 0
    count = cut + 1
    child[:count] = one[:count]
    for place in range(best, others):
        if not is_same(other[place], child[count - 1]):
            child[count] = other[place]
            count += 1
    return count


@subroutine
def _mend(way: Any, count: Any, task: Any, search: Any, dice: Any, part: Any) -> Any:
    """Replace the first blocked segment by a way from trees; return the number of points, 0 if there is none.

    Points that are not free themselves are left out before.
    """
    kept = 1
    for place in range(1, count):
        if place == count - 1 or is_step_free(task, way[place], way[place]):
            way[kept] = way[place]
            kept += 1
    count = kept
    for place in range(count - 1):
        if not is_step_free(task, way[place], way[place + 1]):
            points, _ = grow(part, way[place], way[place + 1 : place + 2], task, search, dice)
            if points == 0 or count + points > MOST_POINTS:
                return 0
            for each in range(1, points - 1):
                count = insert(way, count, place + each, part[each])
            return count
    return count


@subroutine
def _renew(numbers: Any, parent: Any, task: Any, way: Any, part: Any, dice: Any) -> Any:
    """Write an offspring of a path that is not free: the free line, a mended path or a new one; else the parent."""
    numbers[:] = parent
    straight = free_line(task)
    if straight >= 0:
        go_straight(numbers, task, way, straight)
        return
    search = search_in(dice.generation)
    if parent[0] > 1 and toss(dice) < 0.5:
        count, goal = read_way(parent, task, way)
        count = _mend(way, count, task, search, dice, part)
        if count > 0:
            write_way(way, count, goal, task, numbers)
        return
    find_way(numbers, task, way, search, dice)


@subroutine
def _vary(numbers: Any, one: Any, other: Any, is_other_free: Any, task: Any, ways: Any, dice: Any) -> Any:
    """Write an offspring of a free path and another one: joined, if that is possible, and shortened."""
    first, second, child = ways[0], ways[1], ways[2]
    numbers[:] = one
    count, goal = read_way(one, task, first)
    if is_other_free:
        others, its_goal = read_way(other, task, second)
        joined = _join(first, count, second, others, child, task, dice)
        # A detour is not worth shortening.
        if joined > 0 and length_of(child, joined) < 1.3 * length_of(first, count):
            first[:joined] = child[:joined]
            count, goal = joined, its_goal
    count = shorten(first, count, task, dice, _TRIES if dice.individual == 0 else _FEW_TRIES)
    write_way(first, count, goal, task, numbers)


@subroutine
def _look_elsewhere(numbers: Any, task: Any, ways: Any, dice: Any) -> Any:
    """Replace an offspring by a shorter way, if trees that look for shorter ways only find one."""
    count, _ = read_way(numbers, task, ways[0])
    length, before = length_of(ways[0], count), numbers.copy()
    find_way(numbers, task, ways[0], Search(_FRESH_BUDGET, STEP, 0.98 * length), dice)
    count, _ = read_way(numbers, task, ways[0])
    # Points are drawn where a shorter way can lead, but the way through several of them may be longer.
    if length_of(ways[0], count) >= length:
        numbers[:] = before


@subroutine
def _is_free(parent: Any, task: Any, way: Any) -> Any:
    """Return whether a parent's path is free. The memo of segments knows parents that were tested before."""
    count, _ = read_way(numbers_of(parent), task, way)
    return is_free_all_along(task, way, count)


@kernel(VARIATION, may_be_long=True)
def variation(couples: Genomes, offspring: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Join, shorten and renew paths."""
    task, rate = task_of(table), pointers.reals(table, RATE)[0, 0]
    ways = np.empty((3, MOST_POINTS, task.joints))
    free = np.zeros(2, np.bool_)
    for couple in range(couples.shape[0]):
        for parent in range(2):
            free[parent] = _is_free(couples[couple, parent], task, ways[0])
        for child in range(2):
            number = 2 * couple + child
            dice = dice_of(seed, cell, generation, MUTATE, number)
            numbers = numbers_of(offspring[number])
            one, other = numbers_of(couples[couple, child]), numbers_of(couples[couple, 1 - child])
            if free[child]:
                _vary(numbers, one, other, free[1 - child], task, ways, dice)
            elif free[1 - child]:
                _vary(numbers, other, one, False, task, ways, dice)
            elif number == 0:  # one tree for a cell and generation: the others would only keep its neighbours waiting
                _renew(numbers, one, task, ways[0], ways[1], dice)
            else:
                numbers[:] = one
            if number == 0 and (free[0] or free[1]) and toss(dice) < rate:
                _look_elsewhere(numbers, task, ways, dice)
