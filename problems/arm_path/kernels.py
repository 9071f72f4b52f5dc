"""The compiled scan of Manhattan motions over lazily computed slices (Ahuactzin, Talbi, Bessière, Mazer 1992, §4).

A joint's *place* is a number: one of its 2^q codes, or 2^q for the angle of the start, or 2^q + 1 for that of the goal,
which need not be coded angles. Every configuration of a scan consists of places. A *slice*, the legal ranges of one
joint with the others fixed, therefore has the places of the other joints as its key. A slice is computed on first use
and cached. With two links every slice has a slot of its own and stays; with more, another slice may evict it. The cache
never changes a fitness.

The table (see `genetics.operators`) holds the fields of `Sizes`; the codes nearest to start and goal, shape (2, links);
link lengths (m); the angle of each place (rad), shape (links, places); base x, y, the radius of a link plus clearance,
and the least distance between axes of links that are not neighbours (m); the obstacles' corners, starts and thickness;
the arrays of `Slices`; and working memory.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Fitness, Genomes
from genetics.bit_kernels import integers_of, recombine_row
from genetics.operators import FITNESS, VARIATION, Table
from lowlevel.compiled import kernel, subroutine
from lowlevel.pointers import integers, reals
from problems.arm_path.ranges import FULL_TURN, MOST_RANGES, Room, legal_ranges, stays
from problems.planar_arm.kernels import Arm, Obstacles

Floats = NDArray[np.float64]

_NO_TURN = 1e-12  # rad, less is rounding
_MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)  # 2^64 divided by the golden ratio: it mixes the bits of a hash


class Sizes(NamedTuple):
    """The numbers at the first place of the table."""

    bits: Any
    gray: Any
    self_collision: Any
    turns: Any  # whether joints turn full circles, without limits
    skips: Any  # whether a blocked move is left out; otherwise it ends the scan
    forward: Any  # the number of moves that lead away from the start; the others lead away from the goal


class Slices(NamedTuple):
    """The cache of slices."""

    keys: Any  # (slots, links + 1): the places of all joints (its own is ignored), and its joint from 1; 0 if empty
    counts: Any  # (slots,): the number of ranges
    ranges: Any  # (slots, 2 * MOST_RANGES), rad
    tally: Any  # (2,): the number of slices computed so far, and of the coded angles in their ranges


class Task(NamedTuple):
    """The views of the table that a scan needs. The arrays from ``room`` on are working memory, reused by each scan."""

    sizes: Any
    arm: Any
    obstacles: Any
    nearest: Any  # (2, links): the codes nearest to start and goal
    angles: Any  # (links, places), rad
    levels: Any  # 2^q, which is also the place of the start; that of the goal follows
    slices: Any
    room: Any
    places: Any  # (links,): a configuration
    between: Any  # (links,): the configuration that `_sees` looks at
    corners: Any  # (moves + 2, links): those from the start are filled from the first row, from the goal from the last
    codes: Any  # (moves,): the decoded genome
    turned: Any  # (moves,): the angle by which each move turned its joint, rad; 0 if it was blocked
    standing: Any  # (links,): the angles at which a slice is computed, rad


@subroutine
def _task_of(table: Any) -> Any:
    head, angles, place = integers(table, 0)[0], reals(table, 3), reals(table, 4)[0]
    sizes = Sizes(head[0], head[1] != 0, head[2] != 0, head[3] != 0, head[4] != 0, head[5])
    arm = Arm(reals(table, 2)[0], place[:2], place[2], place[3], sizes.self_collision)
    obstacles = Obstacles(reals(table, 5), integers(table, 6)[0], reals(table, 7)[0])
    slices = Slices(integers(table, 8), integers(table, 9)[0], reals(table, 10), integers(table, 11)[0])
    room = Room(reals(table, 12), reals(table, 13)[0], reals(table, 14))
    places, codes, turned = integers(table, 15), integers(table, 16)[0], reals(table, 17)[0]
    return Task(
        sizes,
        arm,
        obstacles,
        integers(table, 1),
        angles,
        angles.shape[1] - 2,
        slices,
        room,
        places[0],
        places[1],
        places[2:],
        codes,
        turned,
        reals(table, 18)[0],
    )


@subroutine
def _slot(joint: Any, places: Any, slices: Any, levels: Any) -> Any:
    """Return the slot for the slice of a joint: unique for two links, a hash of its key for more."""
    if places.size == 2:
        return joint * (levels + 2) + places[1 - joint]
    mixed = np.uint64(joint)
    for other in range(places.size):
        if other != joint:
            mixed = (mixed ^ np.uint64(places[other])) * _MULTIPLIER
            mixed ^= mixed >> np.uint64(29)
    return np.int64(mixed % np.uint64(slices.counts.size))


@subroutine
def _is_kept(key: Any, joint: Any, places: Any) -> Any:
    """Return whether a slot's key is that of the slice of a joint with the others at their places."""
    if key[places.size] != joint + 1:
        return False
    same = True
    for other in range(places.size):
        same = same and (other == joint or key[other] == places[other])
    return same


@subroutine
def _slice(task: Any, joint: Any, places: Any) -> Any:
    """Return the slot with a joint's legal ranges, which are computed now if they are not cached."""
    slices = task.slices
    slot = _slot(joint, places, slices, task.levels)
    if not _is_kept(slices.keys[slot], joint, places):
        for other in range(places.size):
            slices.keys[slot, other] = places[other]
            task.standing[other] = task.angles[other, places[other]]
        slices.keys[slot, places.size] = joint + 1
        ranges = slices.ranges[slot].reshape(MOST_RANGES, 2)
        slices.counts[slot] = legal_ranges(joint, task.standing, task.arm, task.obstacles, task.room, ranges)
        slices.tally[0] += 1
        for place in range(task.levels):
            slices.tally[1] += stays(ranges, slices.counts[slot], task.angles[joint, place], 0.0)
    return slot


@subroutine
def _shorter(angle: Any) -> Any:
    """Return the same angle in (-π, π]."""
    return angle - FULL_TURN * np.ceil((angle - np.pi) / FULL_TURN)


@subroutine
def _difference(task: Any, joint: Any, begin: Any, end: Any) -> Any:
    """Return the turn of a joint from one place to another, rad: by the shorter sense if it has no limits."""
    turn = task.angles[joint, end] - task.angles[joint, begin]
    return _shorter(turn) if task.sizes.turns else turn


@subroutine
def _turn(task: Any, joint: Any, places: Any, end: Any) -> Any:
    """Return whether a joint can turn to the place ``end``, and the turn, rad.

    The shorter sense is tried first; then, without limits, the other one.
    """
    turn = _difference(task, joint, places[joint], end)
    if turn == 0.0:
        return True, turn
    slot = _slice(task, joint, places)
    ranges, count = task.slices.ranges[slot].reshape(MOST_RANGES, 2), task.slices.counts[slot]
    angle = task.angles[joint, places[joint]]
    if stays(ranges, count, angle, turn):
        return True, turn
    if not task.sizes.turns:
        return False, turn
    turn += FULL_TURN if turn < 0.0 else -FULL_TURN
    return stays(ranges, count, angle, turn), turn


@subroutine
def _sees(task: Any, places: Any, target: Any, ascending: Any) -> Any:
    """Return whether the joints can turn to a target one after another, in ascending or descending order.

    The turns are tested from the last one back: the nearer to the goal, the more individuals share the slice, so it is
    more likely to be cached.
    """
    between, links = task.between, places.size
    between[:] = target
    for number in range(links):
        joint = links - 1 - number if ascending else number
        between[joint] = places[joint]
        if not _turn(task, joint, between, target[joint])[0]:
            return False
    return True


@subroutine
def _order(task: Any, places: Any, target: Any) -> Any:
    """Return MP(places, target) of §4: 1 if the ascending order of joints is free, -1 if the descending is, else 0."""
    if _sees(task, places, target, True):
        return 1
    return -1 if _sees(task, places, target, False) else 0


@subroutine
def _move(task: Any, move: Any, places: Any, following: Any) -> Any:
    """Fill ``following`` with the places after a coded move, and return whether the move is free.

    After a blocked move the places are unchanged.
    """
    joint = move % places.size
    free, turn = _turn(task, joint, places, task.codes[move])
    task.turned[move] = turn if free else 0.0
    following[:] = places
    if free:
        following[joint] = task.codes[move]
    return free


@subroutine
def _distance_to_goal(task: Any, places: Any) -> Any:
    """Return the distance of a configuration from the goal, rad."""
    squared = 0.0
    for joint in range(places.size):  # `levels + 1` is the place of the goal
        squared += _difference(task, joint, places[joint], task.levels + 1) ** 2
    return np.sqrt(squared)


@subroutine
def _scan_from_start(task: Any) -> Any:
    """Scan the moves from the start on (§4).

    Returns:
        the fitness, the corner that determines it, and the order of MP from there (see `_order`). That is the first
        corner that sees the goal; if there is none, the last corner or, if blocked moves are left out, the corner
        nearest to the goal.
    """
    corners, sizes = task.corners, task.sizes
    goal = corners[-1]
    nearest, where = np.inf, 0
    corners[0] = task.levels  # S_0
    moved = True
    for move in range(sizes.forward + 1):
        if moved:  # otherwise this corner is the one before
            order = _order(task, corners[move], goal)
            if order != 0:
                return 0.0, move, order
            away = _distance_to_goal(task, corners[move])
            if away < nearest or not sizes.skips:
                nearest, where = away, move
        if move < sizes.forward:
            moved = _move(task, move, corners[move], corners[move + 1])
            if not (moved or sizes.skips):
                break
    return nearest, where, 0


@subroutine
def _scan(task: Any) -> Any:
    """Scan from the start and, if no corner sees the goal, from the goal backwards until two corners see each other.

    Returns:
        the fitness, the number of moves from the start, the order of MP after them, and the number of moves from the
        goal.
    """
    corners, forward = task.corners, task.sizes.forward
    corners[-1] = task.levels + 1
    fitness, where, order = _scan_from_start(task)
    if fitness > 0.0:
        for move in range(forward, task.codes.size):
            here = corners.shape[0] - 1 - (move - forward)
            if not _move(task, move, corners[here], corners[here - 1]):
                continue
            for corner in range(forward + 1):
                if corner == 0 or task.turned[corner - 1] != 0.0:  # skip corners that repeat the one before
                    order = _order(task, corners[corner], corners[here - 1])
                    if order != 0:
                        return 0.0, corner, order, move + 1 - forward
    return fitness, where, order, 0


@subroutine
def _carry_out(genome: Any, task: Any) -> Any:
    """Decode a genome and `_scan` its moves."""
    integers_of(genome, task.sizes.bits, task.sizes.gray, task.codes)
    return _scan(task)


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Compute the fitness of coded motions (§4): 0 if a corner sees the goal, else the distance from it, rad."""
    task = _task_of(table)
    for row in range(fitness.size):
        fitness[row] = _carry_out(genomes[row], task)[0]


@subroutine
def _go_on(path: Any, row: Any, joint: Any, turn: Any) -> Any:
    """Append a turn to a path, merged with the last move if that is of the same joint; return the last row."""
    if row > 0 and path[row, joint] != path[row - 1, joint]:
        path[row, joint] += turn
        return row - 1 if abs(path[row, joint] - path[row - 1, joint]) < _NO_TURN else row
    if turn == 0.0:
        return row
    path[row + 1] = path[row]
    path[row + 1, joint] += turn
    return row + 1


@kernel("float64[:,::1](uint8[::1], int64[:,::1])")
def follow(genome: Genomes, table: Table) -> Floats:
    """Return the path of a coded motion with its final moves to the goal, if it sees the goal.

    The path consists of unwrapped joint angles, rad, shape (rows, links).
    """
    task = _task_of(table)
    _, moves, order, backward = _carry_out(genome, task)
    corners, links, forward = task.corners, task.places.size, task.sizes.forward
    path = np.empty((1 + moves + links + backward, links))
    row = 0
    path[0] = task.angles[:, task.levels]
    for move in range(moves):
        row = _go_on(path, row, move % links, task.turned[move])
    task.places[:] = corners[moves]
    # MP's turns lead to the goal or, if the scan met one, to the corner that the moves from the goal have reached.
    for number in range(links if order != 0 else 0):
        joint = number if order > 0 else links - 1 - number
        end = corners[-1 - backward, joint]
        row = _go_on(path, row, joint, _turn(task, joint, task.places, end)[1])
        task.places[joint] = end
    for move in range(forward + backward - 1, forward - 1, -1):  # the moves from the goal, undone
        row = _go_on(path, row, move % links, -task.turned[move])
    return path[: row + 1].copy()


@kernel("void(uint8[::1], uint8[:,::1], int64[:,::1])")
def mark(computed: Genomes, cells: Genomes, table: Table) -> None:
    """Set the cells of two joints to 1 that lie in the legal ranges of some slices.

    Args:
        computed: whether each slot's slice counts, shape (2 * (levels + 2),).
        cells: shape (levels, levels). A cell is a pair of codes; it stands for all angles that are nearest to them.
        table: see the module.
    """
    task = _task_of(table)
    for slot in range(computed.size):
        if not computed[slot]:
            continue
        joint, place = slot // (task.levels + 2), slot % (task.levels + 2)
        task.places[1 - joint] = place
        _slice(task, joint, task.places)
        ranges, count = task.slices.ranges[slot].reshape(MOST_RANGES, 2), task.slices.counts[slot]
        fixed = place if place < task.levels else task.nearest[place - task.levels, 1 - joint]
        for code in range(task.levels):
            if stays(ranges, count, task.angles[joint, code], 0.0):
                cells[(code, fixed) if joint == 0 else (fixed, code)] = 1


@kernel(VARIATION)
def variation(couples: Genomes, offspring: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Recombine couples as `coding.CoarseToFine.recombine` does.

    The table of this operator holds the length and whether crossover is uniform, the mutation rate, `coding.FINER_AT`
    and the masks.
    """
    choices, finer_at, masks = integers(table, 0)[0], integers(table, 2)[0], integers(table, 3)
    rate = reals(table, 1)[0, 0]
    recombine_row(couples, offspring, seed, cell, generation, choices[0], choices[1] != 0, rate)
    stage = 0
    for finer in finer_at:
        stage += generation >= finer
    for child in range(offspring.shape[0]):
        for byte in range(offspring.shape[1]):
            offspring[child, byte] &= np.uint8(masks[stage, byte])


@kernel("float64[:,::1](int64, float64[::1], int64[:,::1])")
def ranges_at(joint: int, configuration: Floats, table: Table) -> Floats:
    """Return the legal ranges of a joint with the others as in a free configuration, rad, shape (ranges, 2).

    The configuration need not consist of places, so the ranges are not cached.
    """
    task = _task_of(table)
    ranges = np.empty((MOST_RANGES, 2))
    task.standing[:] = configuration
    count = legal_ranges(joint, task.standing, task.arm, task.obstacles, task.room, ranges)
    return ranges[:count].copy()


@kernel("boolean(float64[:,::1], float64, float64)")
def may_turn(ranges: Floats, angle: float, turn: float) -> bool:
    """Return whether a joint that stands at ``angle`` and turns by ``turn``, rad, stays in one of its legal ranges."""
    free: bool = stays(ranges, ranges.shape[0], angle, turn)
    return free
