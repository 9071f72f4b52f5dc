"""The compiled fitness, first paths and crossovers (Fries, §3).

The first five parts of every table (see `genetics.operators`) are the fields of `walking.World`. The tables of
variation have further parts, which the docstrings of their kernels name.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Fitness, Genomes
from genetics.operators import FITNESS, INITIALISE, VARIATION, Table
from genetics.randomness import CROSS, INITIAL, MUTATE, below, draw, unit
from genetics.sequence_kernels import clear_after, numbers_of
from lowlevel.compiled import kernel, subroutine
from lowlevel.pointers import integers, reals
from problems.terrain.search import (
    find_best,
    line_steps,
    mark_path,
    mark_way,
    mark_window,
    room_for,
    write_path,
)
from problems.terrain.walking import GOAL, START, walk, world_of

_MORE = 5  # the first part of the table after the world
_MOST_LEGS = 3  # straight lines in a first path
_MOST_VIA = 3  # places on a detour
_WALLS = 4  # the most steps along walls, for each cell of the longer side


# Fitness --------------------------------------------------------------------------------------------------------------
@subroutine
def _bits_for(world: Any) -> Any:
    """Return the number of bits of a length: ⌈log2 n⌉ for a map whose longer side is n (§3.1)."""
    bits, side = 0, max(world.classes.shape[0], world.classes.shape[1])
    while 1 << bits < side:
        bits += 1
    return bits


@kernel(FITNESS)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Fill the cost of each clear path to the goal, and the penalty of each other path (§3.4)."""
    world = world_of(table)
    bits = _bits_for(world)
    moves = np.empty((genomes.shape[1] // 2, 2), np.int64)
    for individual in range(genomes.shape[0]):
        fitness[individual] = walk(world, numbers_of(genomes[individual]), bits, moves)[0]


@kernel("Tuple((int64[:,::1], float64))(uint8[::1], int64[:,::1])")
def follow(genome: Genomes, table: Table) -> tuple[NDArray[np.int64], float]:
    """Return the moves of a path, (moves, 2): heading and cells; and the cost of its clear steps."""
    world = world_of(table)
    moves = np.empty((genome.size // 2, 2), np.int64)
    _, cost, count = walk(world, numbers_of(genome), _bits_for(world), moves)
    return moves[:count].copy(), cost


# First paths ----------------------------------------------------------------------------------------------------------
@subroutine
def _place(world: Any, which: Any) -> Any:
    """Return the number of the start cell or the goal cell."""
    return world.settings[which] * world.classes.shape[1] + world.settings[which + 1]


@kernel(INITIALISE)
def found_random(deme: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Fill the deme with paths of random blocks, and one straight line in the whole population (§3.2).

    The paper does not state how many blocks a first path has. Here it is 2 to n + 1 with equal probability, but no more
    than a genome has room for.
    """
    world, room = world_of(table), room_for(world_of(table))
    bits = _bits_for(world)
    for individual in range(deme.shape[0]):
        numbers = numbers_of(deme[individual])
        if cell == 0 and individual == 0:
            write_path(room, line_steps(world, room, 0, _place(world, START), _place(world, GOAL)), bits, numbers)
            continue
        side = max(world.classes.shape[0], world.classes.shape[1])
        count = min(numbers.size - 1, 2 + below(draw(seed, cell, generation, INITIAL, individual, 0), side))
        for place in range(1, count + 1):
            numbers[place] = below(draw(seed, cell, generation, INITIAL, individual, place), 1 << (2 + bits))
        clear_after(numbers, count, 1)


@kernel(INITIALISE)
def found_lines(deme: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Fill the deme with straight lines through none to two random cells; the first of all goes through none."""
    world, room = world_of(table), room_for(world_of(table))
    bits = _bits_for(world)
    for individual in range(deme.shape[0]):
        legs = 1 + below(draw(seed, cell, generation, INITIAL, individual, 0), _MOST_LEGS)
        if cell == 0 and individual == 0:
            legs = 1
        at, count = _place(world, START), 0
        for leg in range(1, legs + 1):
            to = below(draw(seed, cell, generation, INITIAL, individual, leg), world.classes.size)
            if leg == legs:
                to = _place(world, GOAL)
            count = line_steps(world, room, count, at, to)
            at = to
        write_path(room, count, bits, numbers_of(deme[individual]))


# Crossing -------------------------------------------------------------------------------------------------------------
@subroutine
def _flip_bits(numbers: Any, width: Any, rate: Any, seed: Any, cell: Any, generation: Any, individual: Any) -> Any:
    """Change each bit of each block with a probability."""
    if rate <= 0.0:
        return
    for block in range(np.int64(numbers[0])):
        gene = np.int64(numbers[1 + block])
        for bit in range(width):
            if unit(draw(seed, cell, generation, MUTATE, individual, block * width + bit)) < rate:
                gene ^= 1 << bit
        numbers[1 + block] = gene


@kernel(VARIATION)
def one_point(couples: Genomes, offspring: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Cross couples at one point, then mutate bits (§3.3).

    After the world the table has [the crossover rate, the probability that a bit changes]. The point lies between any
    two bits of the shorter parent, at the same place in both, so offspring have their parents' lengths (unstated in the
    paper).
    """
    world, rates = world_of(table), reals(table, _MORE)[0]
    width = 2 + _bits_for(world)
    for couple in range(couples.shape[0]):
        parents = numbers_of(couples[couple, 0]), numbers_of(couples[couple, 1])
        shorter = min(np.int64(parents[0][0]), np.int64(parents[1][0]))
        cut = 0
        if unit(draw(seed, cell, generation, CROSS, couple, 0)) < rates[0]:
            cut = 1 + below(draw(seed, cell, generation, CROSS, couple, 1), shorter * width - 1)
        for child in range(2):
            number = 2 * couple + child
            head, tail = (parents[0], parents[1]) if child == 0 else (parents[1], parents[0])
            if cut == 0:
                tail = head
            numbers = numbers_of(offspring[number])
            numbers[:] = tail
            whole, rest = cut // width, cut % width
            numbers[1 : 1 + whole] = head[1 : 1 + whole]
            if rest > 0:
                # The cut lies within this block: its high bits are the head's, its low bits the tail's.
                kept = (1 << (width - rest)) - 1
                numbers[1 + whole] = (np.int64(head[1 + whole]) & ~kept) | (np.int64(tail[1 + whole]) & kept)
            _flip_bits(numbers, width, rates[1], seed, cell, generation, number)


@subroutine
def _near(world: Any, cell: Any, bits: Any, more_bits: Any) -> Any:
    """Return a random cell of the map within some rows and columns of another; the reach is log-uniform."""
    rows, columns = world.classes.shape
    # Between a sixteenth and the whole of the longer side.
    reach = 1 + np.int64(max(rows, columns) * 2.0 ** (-4.0 * unit(more_bits)))
    row = cell // columns - reach + below(bits, 2 * reach + 1)
    column = cell % columns - reach + below(bits << np.uint64(32), 2 * reach + 1)
    return min(max(row, 0), rows - 1) * columns + min(max(column, 0), columns - 1)


@kernel(VARIATION)
def merge(couples: Genomes, offspring: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Make each offspring the best path over the cells of both parents, a small window, and perhaps a detour.

    After the world the table has the probability of a detour, then how far the window reaches from its middle. The
    window lies around a random cell of one parent's path, or around the last place of the detour. A detour leads from a
    cell of the path by straight lines to one to three random cells, each near the one before, and back to the path.

    The parents' own cells are among those searched, so no offspring is worse than its parents, unless the best path has
    too many blocks; then the offspring is a copy of its parent.
    """
    world, room = world_of(table), room_for(world_of(table))
    rate, reach = reals(table, _MORE)[0, 0], integers(table, _MORE + 1)[0, 0]
    bits, walls = _bits_for(world), _WALLS * max(world.classes.shape[0], world.classes.shape[1])
    for number in range(2 * couples.shape[0]):
        own, other = couples[number // 2, number % 2], couples[number // 2, 1 - number % 2]
        stamp = 1 + number  # a stamp of its own for each search, so that no mark needs to be cleared
        mark_path(world, room, stamp, numbers_of(other), bits)
        length, hits = mark_path(world, room, stamp, numbers_of(own), bits)
        middle = np.int64(room.trail[below(draw(seed, cell, generation, CROSS, number, 0), length)])
        if hits > 0:  # one of the places where the path is blocked gets cells around what blocks it
            hit = np.int64(room.hits[below(draw(seed, cell, generation, CROSS, number, 2), hits)])
            here, there = np.int64(room.trail[hit]), np.int64(room.trail[hit + 1])
            mark_way(world, room, stamp, here, there, walls)
        if unit(draw(seed, cell, generation, MUTATE, number, 0)) < rate:
            places = 1 + below(draw(seed, cell, generation, MUTATE, number, 1), _MOST_VIA)
            for place in range(2, 2 + 2 * places, 2):
                via = _near(
                    world,
                    middle,
                    draw(seed, cell, generation, MUTATE, number, place),
                    draw(seed, cell, generation, MUTATE, number, place + 1),
                )
                mark_way(world, room, stamp, middle, via, walls)
                middle = via
            back = room.trail[below(draw(seed, cell, generation, CROSS, number, 1), length)]
            mark_way(world, room, stamp, middle, np.int64(back), walls)
        mark_window(world, room, stamp, middle, reach)
        numbers = numbers_of(offspring[number])
        if not write_path(room, find_best(world, room, stamp), bits, numbers):
            numbers[:] = numbers_of(own)


# Replanning -----------------------------------------------------------------------------------------------------------
@subroutine
def _mend(world: Any, room: Any, stamp: Any, bits: Any, walls: Any, reach: Any, numbers: Any) -> Any:
    """Replace a blocked path with the best one over its own cells, those along what blocks it, and windows there."""
    _, hits = mark_path(world, room, stamp, numbers, bits)
    if hits == 0:
        return
    last = -1 - reach
    for place in range(hits):
        hit = np.int64(room.hits[place])
        if hit > last + reach:  # else the window around the hit before reaches here
            here, there = np.int64(room.trail[hit]), np.int64(room.trail[hit + 1])
            mark_way(world, room, stamp, here, there, walls)
            mark_window(world, room, stamp, here, reach)
            last = hit
    unmended = numbers.copy()
    if not write_path(room, find_best(world, room, stamp), bits, numbers):
        numbers[:] = unmended


@kernel("uint8[:,::1](uint8[:,::1], int64[:,::1], int64[:,::1], int64)")
def led_on(genomes: Genomes, old_table: Table, new_table: Table, reach: int) -> Genomes:
    """Return what `problems.terrain.replanning.led_on` does; the tables are those of the old and the new fitness."""
    old, new = world_of(old_table), world_of(new_table)
    room, bits, columns = room_for(old), _bits_for(old), old.classes.shape[1]
    begin, goal = _place(new, START), _place(new, GOAL)
    walls = _WALLS * max(old.classes.shape[0], columns)
    # Zeros, since unused bytes of a genome must be 0.
    led = np.zeros_like(genomes)
    for individual in range(genomes.shape[0]):
        numbers = numbers_of(led[individual])
        # On the old map, for which the path was made. Odd stamps list old paths, even ones are those of mending.
        count, _ = mark_path(old, room, 2 * individual + 1, numbers_of(genomes[individual]), bits)
        joint, nearest = 0, np.inf
        for place in range(count):
            cell = np.int64(room.trail[place])
            away = np.hypot(
                np.float64(cell // columns - begin // columns), np.float64(cell % columns - begin % columns)
            )
            # Of equally near cells the last one, which leaves the shortest rest of the path.
            if away <= nearest:
                joint, nearest = place, away
        # From the new start to the path, along it, and from its end to the goal, if it does not end there.
        steps = line_steps(new, room, 0, begin, np.int64(room.trail[joint]))
        for place in range(joint + 1, count):
            steps = line_steps(new, room, steps, np.int64(room.trail[place - 1]), np.int64(room.trail[place]))
        steps = line_steps(new, room, steps, np.int64(room.trail[count - 1]), goal)
        if not write_path(room, steps, bits, numbers):
            write_path(room, line_steps(new, room, 0, begin, goal), bits, numbers)
        _mend(new, room, 2 * individual + 2, bits, walls, reach, numbers)
    return led
