"""The compiled scan of Manhattan motions over lazily computed slices (Ahuactzin, Talbi, Bessière, Mazer 1992, §4).

A joint's *place* is a number: that of one of its 2^q coded angles, or of the start (2^q) or the goal (2^q + 1), which
need be none of them. All configurations that a scan meets are made of places, so a slice, the legal ranges of one joint
with the others fixed, has the places of the others for a key. Slices are computed when they are first asked for, and
kept: for ever if there are two links, so that each slice has a slot of its own; else until another one needs the slot.
What is kept never shows in a fitness.

The table (see `genetics.operators`): the fields of `Sizes`; the numbers of the coded angles next to start and goal,
shape (2, links); lengths (m); the angle of each place (rad), shape (links, places); base, half a link's thickness with
the clearance, and its thickness with that (m); the obstacles' corners, starts and thickness; the arrays of `Slices`;
and those that are only written to.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Fitness, Genomes
from genetics.bit_kernels import integers_of, recombine_row
from genetics.operators import FITNESS, MATING, Table
from lowlevel.compiled import kernel, subroutine
from lowlevel.pointers import integers, reals
from problems.arm_path.ranges import FULL_TURN, MOST_RANGES, Arm, Obstacles, Room, legal_ranges, stays

Floats = NDArray[np.float64]

_NO_TURN = 1e-12  # rad
_MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)


class Sizes(NamedTuple):
    """Numbers at the head of the table."""

    bits: Any
    gray: Any
    self_collision: Any
    turns: Any  # whether joints turn all the way round
    skips: Any  # whether a blocked move is left out, else it ends the scan
    forward: Any  # moves from the start on; the others lead away from the goal


class Slices(NamedTuple):
    """The slices that are kept."""

    keys: Any  # (slots, links + 1): the places of all joints, that of the slice's own left out, and its number, from 1
    counts: Any  # (slots,): how many ranges
    ranges: Any  # (slots, 2 * MOST_RANGES), rad
    tally: Any  # (2,): slices computed so far, and the coded cells in their ranges


class Task(NamedTuple):
    """What a scan needs."""

    sizes: Any
    arm: Any
    obstacles: Any
    nearest: Any  # (2, links): the coded angles next to start and goal
    angles: Any  # (links, places), rad
    levels: Any  # 2^q; the places of start and goal follow
    slices: Any
    room: Any
    places: Any  # (links,): where the arm stands
    between: Any  # (links,): a configuration of `_sees`
    corners: Any  # (moves + 2, links): from the start on, and, from the last row back, from the goal on
    codes: Any  # (moves,)
    turned: Any  # (moves,): by how much each move turned its joint, rad
    standing: Any  # (links,): angles, rad


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
    """Where the slice of a joint with the others at their places is kept."""
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
    if key[places.size] != joint + 1:
        return False
    same = True
    for other in range(places.size):
        same = same and (other == joint or key[other] == places[other])
    return same


@subroutine
def _slice(task: Any, joint: Any, places: Any) -> Any:
    """The slot of a joint's legal ranges with the others at their places, computed now if it is not kept."""
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
    """The same angle in (-π, π]."""
    return angle - FULL_TURN * np.ceil((angle - np.pi) / FULL_TURN)


@subroutine
def _difference(task: Any, joint: Any, begin: Any, end: Any) -> Any:
    """By how much a joint turns from one place to another, the shorter way if it can choose, rad."""
    turn = task.angles[joint, end] - task.angles[joint, begin]
    return _shorter(turn) if task.sizes.turns else turn


@subroutine
def _turn(task: Any, joint: Any, places: Any, end: Any) -> Any:
    """Turn a joint to another place by the shorter sense, else by the other; whether one is free, and the turn, rad."""
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
    """Whether the joints can turn to a target one after another, the first first or the last first.

    The last turn is looked at first: the nearer to the goal, the more individuals share a slice.
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
    """MP(places, target) of §4: 1 if the first joint may turn first, -1 if the last one may, else 0."""
    if _sees(task, places, target, True):
        return 1
    return -1 if _sees(task, places, target, False) else 0


@subroutine
def _move(task: Any, move: Any, places: Any, following: Any) -> Any:
    """Carry a coded move out from some places to the ``following``, if it is free; returns whether it is."""
    joint = move % places.size
    free, turn = _turn(task, joint, places, task.codes[move])
    task.turned[move] = turn if free else 0.0
    following[:] = places
    if free:
        following[joint] = task.codes[move]
    return free


@subroutine
def _away(task: Any, places: Any) -> Any:
    """How far places are from the goal, rad."""
    squared = 0.0
    for joint in range(places.size):
        squared += _difference(task, joint, places[joint], task.levels + 1) ** 2
    return np.sqrt(squared)


@subroutine
def _scan_from_start(task: Any) -> Any:
    """The scan of §4, through the moves from the start on.

    Returns the fitness, the number of the corner where it was found, and how MP leads from there to the goal. If
    blocked moves are left out, the corner nearest to the goal counts.
    """
    corners, sizes = task.corners, task.sizes
    goal = corners[-1]
    nearest, where = np.inf, 0
    corners[0] = task.levels  # S_0
    moved = True
    for move in range(sizes.forward + 1):
        if moved:
            order = _order(task, corners[move], goal)
            if order != 0:
                return 0.0, move, order
            away = _away(task, corners[move])
            if away < nearest or not sizes.skips:
                nearest, where = away, move
        if move < sizes.forward:
            moved = _move(task, move, corners[move], corners[move + 1])
            if not (moved or sizes.skips):
                break
    return nearest, where, 0


@subroutine
def _scan(task: Any) -> Any:
    """Scan from the start on and, if that does not see the goal, from the goal on, until the two see each other.

    Returns the fitness, the moves from the start, how MP goes on, and the moves from the goal.
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
                if corner == 0 or task.turned[corner - 1] != 0.0:
                    order = _order(task, corners[corner], corners[here - 1])
                    if order != 0:
                        return 0.0, corner, order, move + 1 - forward
    return fitness, where, order, 0


@subroutine
def _carry_out(genome: Any, task: Any) -> Any:
    """`_scan` for the moves that a genome codes."""
    integers_of(genome, task.sizes.bits, task.sizes.gray, task.codes)
    return _scan(task)


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """How far each coded motion ends from the goal, rad; 0 if the goal is seen from one of its corners (§4)."""
    task = _task_of(table)
    for row in range(fitness.size):
        fitness[row] = _carry_out(genomes[row], task)[0]


@subroutine
def _go_on(path: Any, row: Any, joint: Any, turn: Any) -> Any:
    """Turn a joint at the end of a path, in the last move if that turned the same joint; returns the last row."""
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
    """The path of a coded motion, with what leads from its end to the goal: unwrapped joint angles, (rows, links)."""
    task = _task_of(table)
    _, moves, order, backward = _carry_out(genome, task)
    corners, links, forward = task.corners, task.places.size, task.sizes.forward
    path = np.empty((1 + moves + links + backward, links))
    row = 0
    path[0] = task.angles[:, task.levels]
    for move in range(moves):
        row = _go_on(path, row, move % links, task.turned[move])
    task.places[:] = corners[moves]
    for number in range(links if order != 0 else 0):
        joint = number if order > 0 else links - 1 - number
        end = corners[-1 - backward, joint]
        row = _go_on(path, row, joint, _turn(task, joint, task.places, end)[1])
        task.places[joint] = end
    for move in range(forward + backward - 1, forward - 1, -1):
        row = _go_on(path, row, move % links, -task.turned[move])
    return path[: row + 1].copy()


@kernel("void(uint8[::1], uint8[:,::1], int64[:,::1])")
def mark(computed: Genomes, cells: Genomes, table: Table) -> None:
    """Mark the cells in the legal ranges of some slices of two joints with 1, (levels, levels).

    ``computed`` says of each slot whether that slice counts. A cell is a pair of coded angles, with what is nearest to
    it.
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


@kernel(MATING)
def variation(couples: Genomes, offspring: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """`coding.CoarseToFine.recombine` for one row; its table: length and uniform, rate, `coding.FINER_AT`, masks."""
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
    """The legal ranges of a joint with the others as in any free configuration, rad, shape (ranges, 2)."""
    task = _task_of(table)
    ranges = np.empty((MOST_RANGES, 2))
    task.standing[:] = configuration
    count = legal_ranges(joint, task.standing, task.arm, task.obstacles, task.room, ranges)
    return ranges[:count].copy()


@kernel("boolean(float64[:,::1], float64, float64)")
def may_turn(ranges: Floats, angle: float, turn: float) -> bool:
    """Whether a joint that stands at ``angle`` and turns by ``turn``, rad, keeps within one of its legal ranges."""
    free: bool = stays(ranges, ranges.shape[0], angle, turn)
    return free
