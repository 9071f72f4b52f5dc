"""Ariadne's clew (Ahuactzin, Bessière, Mazer 1998; the paper recipe): SEARCH and EXPLORE alternate on the torus.

A Manhattan round moves one joint after another, each to a coded value. A *landmark* is a place that a round reaches
from the start or from an earlier landmark without contact. A genome is a clew, its list of landmarks, and a motion of
two rounds that begins at one of them and is cut at the first contact. In SEARCH a motion is the better the nearer it
comes to the goal; in EXPLORE the farther it ends from all landmarks. Where EXPLORE ends, the end of the motion joins
the clew, so landmarks spread over the torus with the individuals that carry them.

An item has one gene more than joints. Of a landmark the first is where its round begins: 0 the start, n the landmark n
of the genome, counted from 1. The last two items are the motion: the first gene of the one is the landmark where it
begins, that of the other is the phase, 0 SEARCH and 1 EXPLORE. The table is that of
`problems.robot_path.layout_kernels`.
"""

from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from genetics.arrays import Fitness, Genomes
from genetics.operators import FITNESS, INITIALISE, TABLE, VARIATION, Table
from genetics.randomness import INITIAL, MUTATE
from genetics.sequence_kernels import clear_after, numbers_of
from lowlevel import pointers
from lowlevel.compiled import kernel, subroutine
from problems.robot_path.clew import MOST_LANDMARKS, ROUNDS
from problems.robot_path.layout_kernels import (
    FINEST,
    MOST_POINTS,
    RATE,
    dice_of,
    distance,
    gene_of,
    is_free_all_along,
    is_step_free,
    length_of,
    pick,
    task_of,
    toss,
    value_of,
)

Floats = NDArray[np.float64]

CYCLE, SEARCHES = 8, 5
"""Generations of both phases, and how many of these belong to SEARCH."""
_NEARER, _FARTHER = 2000.0, 3000.0  # fitness: plus the distance from the goal; minus the distance from all landmarks
_HALVINGS = 6  # of a move, to find where it is cut


@subroutine
def _landmarks(numbers: Any) -> Any:
    return np.int64(numbers[0]) - ROUNDS


@subroutine
def _place(numbers: Any, landmark: Any, task: Any, point: Any) -> Any:
    """Fill the place of a landmark; 0 is the start."""
    if landmark == 0:
        point[:] = task.start
        return
    first = 2 + (landmark - 1) * (task.joints + 1)
    for joint in range(task.joints):
        point[joint] = value_of(task, joint, np.int64(numbers[first + joint]))


@subroutine
def _gene(numbers: Any, item: Any, task: Any) -> Any:
    """Return the first gene of an item."""
    return np.int64(numbers[1 + item * (task.joints + 1)])


@subroutine
def _move(way: Any, count: Any, joint: Any, value: Any, task: Any, is_known: Any) -> Any:
    """Append a move of one joint, as far as it is free; return the number of points, and whether it was cut.

    Args:
        way: ends at its point ``count`` - 1.
        count: its number of points.
        joint: the joint that moves.
        value: where to.
        task: the task.
        is_known: whether the move is known to be free.
    """
    here, there = way[count - 1], way[count]
    if here[joint] == value or count >= MOST_POINTS - 2:
        return count, False
    there[:] = here
    there[joint] = value
    if is_known or is_step_free(task, here, there):
        return count + 1, False
    low, high = 0.0, 1.0
    reached = here[joint]
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        there[joint] = value_of(task, joint, gene_of(task, joint, here[joint] + middle * (value - here[joint])))
        if is_step_free(task, here, there):
            low, reached = middle, there[joint]
        else:
            high = middle
    there[joint] = reached
    return (count + 1 if reached != here[joint] else count), True


@subroutine
def _round(numbers: Any, item: Any, task: Any, way: Any, count: Any, is_known: Any) -> Any:
    """Append the moves of an item; return the number of points, and whether the round was cut."""
    first = 2 + item * (task.joints + 1)
    for joint in range(task.joints):
        value = value_of(task, joint, np.int64(numbers[first + joint]))
        count, is_cut = _move(way, count, joint, value, task, is_known)
        if is_cut:
            return count, True
    return count, False


@subroutine
def _walk(numbers: Any, task: Any, way: Any, count: Any) -> Any:
    """Append the motion up to its first contact; return the number of points."""
    for item in range(_landmarks(numbers), np.int64(numbers[0])):
        count, is_cut = _round(numbers, item, task, way, count, False)
        if is_cut:
            break
    return count


@subroutine
def _origin(numbers: Any, task: Any) -> Any:
    """Return the landmark where the motion begins."""
    return min(_gene(numbers, _landmarks(numbers), task), _landmarks(numbers))


@subroutine
def _follow_clew(numbers: Any, task: Any, way: Any) -> Any:
    """Fill the way from the start to where the motion begins; return the number of points."""
    chain, length = np.empty(_landmarks(numbers) + 1, np.int64), 0
    landmark = _origin(numbers, task)
    while landmark > 0:
        chain[length] = landmark
        length += 1
        landmark = min(_gene(numbers, landmark - 1, task), landmark - 1)
    way[0] = task.start
    count = 1
    for place in range(length - 1, -1, -1):
        count, _ = _round(numbers, chain[place] - 1, task, way, count, True)
    return count


@subroutine
def _nearest_goal(point: Any, task: Any) -> Any:
    best = 0
    for goal in range(1, task.goals.shape[0]):
        if distance(point, task.goals[goal]) < distance(point, task.goals[best]):
            best = goal
    return best


@subroutine
def _finish(way: Any, count: Any, task: Any) -> Any:
    """Append a round to the nearest goal; return the number of points, and whether the goal is reached."""
    goal = task.goals[_nearest_goal(way[count - 1], task)]
    for joint in range(task.joints):
        count, is_cut = _move(way, count, joint, goal[joint], task, False)
        if is_cut:
            return count, False
    return count, True


@subroutine
def _search(numbers: Any, task: Any, way: Any) -> Any:
    """Return the fitness of a genome in SEARCH, and the number of points of its way, which ends at a goal.

    The last segment of a way that does not get there is a straight line, which is not free.
    """
    count = _walk(numbers, task, way, _follow_clew(numbers, task, way))
    stop, arrives = count, False
    left = distance(way[count - 1], task.goals[_nearest_goal(way[count - 1], task)])
    count, arrives = _finish(way, count, task)
    if arrives and is_free_all_along(task, way, count):
        return length_of(way, count), count
    way[stop] = task.goals[_nearest_goal(way[stop - 1], task)]
    return _NEARER + left, stop + 1


@subroutine
def _explore(numbers: Any, task: Any, way: Any, point: Any) -> Any:
    """Return the fitness of a genome in EXPLORE: the nearer its end is to a landmark, the worse."""
    _place(numbers, _origin(numbers, task), task, way[0])
    end = way[_walk(numbers, task, way, 1) - 1]
    nearest = np.inf
    for landmark in range(_landmarks(numbers) + 1):
        _place(numbers, landmark, task, point)
        nearest = min(nearest, distance(end, point))
    return _FARTHER - nearest


@subroutine
def _is_exploring(numbers: Any, task: Any) -> Any:
    return _gene(numbers, np.int64(numbers[0]) - 1, task) == 1


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Fill in the length of paths that reach a goal, rad, or how the motion does in its phase."""
    task = task_of(table)
    way, point = np.empty((MOST_POINTS, task.joints)), np.empty(task.joints)
    for individual in range(genomes.shape[0]):
        numbers = numbers_of(genomes[individual])
        if _is_exploring(numbers, task):
            fitness[individual] = _explore(numbers, task, way, point)
        else:
            fitness[individual], _ = _search(numbers, task, way)


@kernel(types.void(types.uint8[::1], types.float64[:, ::1], types.float64[::1], TABLE), may_be_long=True)
def follow(genome: Genomes, path: Floats, figures: Floats, table: Table) -> None:
    """Fill the path, and the figures: number of points, fitness, and a lower bound of the clearance."""
    task, numbers = task_of(table), numbers_of(genome)
    figures[1], count = _search(numbers, task, path)
    if _is_exploring(numbers, task):
        figures[1] = _explore(numbers, task, np.empty((MOST_POINTS, task.joints)), np.empty(task.joints))
    figures[0], figures[2] = count, task.scene.clearance


# Variation ------------------------------------------------------------------------------------------------------------
@subroutine
def _draw_motion(numbers: Any, phase: Any, task: Any, dice: Any) -> Any:
    """Draw the motion anew."""
    width = task.joints + 1
    for item in range(_landmarks(numbers), np.int64(numbers[0])):
        for gene in range(1, width):
            numbers[1 + item * width + gene] = pick(dice, FINEST + 1)
    numbers[1 + _landmarks(numbers) * width] = pick(dice, _landmarks(numbers) + 1)
    numbers[1 + (np.int64(numbers[0]) - 1) * width] = phase


@subroutine
def _add_landmark(numbers: Any, origin: Any, point: Any, task: Any) -> Any:
    """Add a landmark behind the others, if there is room, and return its number; else that of its origin."""
    width, known = task.joints + 1, _landmarks(numbers)
    if known >= MOST_LANDMARKS:
        return origin
    last = 1 + np.int64(numbers[0]) * width
    for place in range(last - 1, known * width, -1):  # the motion gives way
        numbers[place + width] = numbers[place]
    first = 1 + known * width
    numbers[first] = origin
    for joint in range(task.joints):
        numbers[first + 1 + joint] = gene_of(task, joint, point[joint])
    numbers[0] += 1
    return known + 1


@subroutine
def _settle(numbers: Any, task: Any, way: Any) -> Any:
    """Let the end of the motion join the clew: a landmark for each of its rounds that moves."""
    origin = _origin(numbers, task)
    _place(numbers, origin, task, way[0])
    for number in range(ROUNDS):
        # `_add_landmark` moves the motion behind the new landmark, so its items are counted from the end.
        item = np.int64(numbers[0]) - ROUNDS + number
        count, is_cut = _round(numbers, item, task, way, 1, False)
        if count > 1:
            way[0] = way[count - 1]
            origin = _add_landmark(numbers, origin, way[0], task)
        if is_cut:
            break


@subroutine
def _cross(child: Any, one: Any, other: Any, phase: Any, rate: Any, task: Any, dice: Any) -> Any:
    """Fill a child: the clew of one parent, a motion of both by one-point crossover, and mutated genes."""
    child[:] = one
    width, cut = task.joints + 1, pick(dice, ROUNDS * (task.joints + 1))
    mine, others = 1 + _landmarks(one) * width, 1 + _landmarks(other) * width
    for gene in range(ROUNDS * width):
        if gene >= cut:
            child[mine + gene] = other[others + gene]
        if toss(dice) < rate:
            child[mine + gene] = pick(dice, FINEST + 1 if gene % width > 0 else _landmarks(one) + 1)
    child[mine] = min(np.int64(child[mine]), _landmarks(one))
    child[mine + width] = phase
    clear_after(child, np.int64(child[0]), width)


@kernel(INITIALISE, may_be_long=True)
def initialise(deme: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Fill the deme with random motions from the start."""
    task = task_of(table)
    for individual in range(deme.shape[0]):
        numbers = numbers_of(deme[individual])
        clear_after(numbers, ROUNDS, task.joints + 1)
        _draw_motion(numbers, 0, task, dice_of(seed, cell, generation, INITIAL, individual))


@kernel(VARIATION, may_be_long=True)
def variation(couples: Genomes, offspring: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Cross and mutate motions; where EXPLORE ends, let their ends join the clews and draw motions anew."""
    task, rate = task_of(table), pointers.reals(table, RATE)[0, 0]
    way = np.empty((MOST_POINTS, task.joints))
    step = generation % CYCLE
    phase = 0 if step < SEARCHES else 1
    for couple in range(couples.shape[0]):
        for child in range(2):
            dice = dice_of(seed, cell, generation, MUTATE, 2 * couple + child)
            one, other = numbers_of(couples[couple, child]), numbers_of(couples[couple, 1 - child])
            numbers = numbers_of(offspring[2 * couple + child])
            if step == 0:
                numbers[:] = one
                _settle(numbers, task, way)
                _draw_motion(numbers, phase, task, dice)
            else:
                _cross(numbers, one, other, phase, rate, task, dice)
