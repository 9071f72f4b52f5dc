"""The compiled count of the obstacles that a path crosses (Eldershaw and Cameron).

A path is the start, the coded nodes and the goal, joined by straight segments. Lengths are those of
`problems.sphere_path.space`. Along a periodic axis a segment goes the shorter way: rows of a path are unwrapped.

The parts of the table (see `genetics.operators`), in the order in which `SpherePath` packs them:
    integers 0: bits of each component, whether they are a Gray code, the number of nodes
    reals 1: rows of one number for each axis: the place of code 0, the step from one code to the next, the period (0
        if there is none), the start, the goal
    reals 2: the length weight, the length of the straight way, that of the box's diagonal, the widest radius
    3 to 6: the fields of `problems.sphere_path.hierarchy.Hierarchy`
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Cells, Fitness, Genomes
from genetics.bit_kernels import integers_of
from genetics.operators import FITNESS, Table
from lowlevel.compiled import kernel, subroutine
from lowlevel.pointers import integers, reals
from problems.sphere_path.hierarchy import TOGETHER

Floats = NDArray[np.float64]

_LOW, _STEP, _PERIOD, _START, _GOAL = range(5)  # rows of the axes


class Way(NamedTuple):
    """The working arrays of one path; each evaluation overwrites them."""

    codes: Any  # (nodes · axes,)
    places: Any  # (nodes + 2, axes): start, nodes, goal
    origin: Any  # (axes,): the beginning of a segment, within the bounds
    step: Any  # (axes,): the way from there to its end
    begin: Any  # (axes,): the beginning of the segment's image
    turn: Any  # (axes,): by how many periods the image is shifted
    first: Any  # (axes,): the first shift that must be looked at
    last: Any  # (axes,): the last one
    along: Any  # (TOGETHER,): for several obstacles, the place of the nearest point along the segment
    squared: Any  # (TOGETHER,): and its squared distance
    counted: Any  # (groups, TOGETHER): whether the path has crossed an obstacle already


@subroutine
def _room_for(table: Any) -> Any:
    nodes, count = integers(table, 0)[0, 2], reals(table, 1).shape[1]
    groups = reals(table, 6).shape[0] // (count + 1)
    way = Way(
        np.empty(nodes * count, np.int64),
        np.empty((nodes + 2, count)),
        np.empty(count),
        np.empty(count),
        np.empty(count),
        np.empty(count),
        np.empty(count),
        np.empty(count),
        np.empty(TOGETHER),
        np.empty(TOGETHER),
        np.empty((groups, TOGETHER), np.bool_),
    )
    way.places[0] = reals(table, 1)[_START]
    return way


@subroutine
def _follow(genome: Any, table: Any, way: Any) -> Any:
    """Decode a genome into a path, unwrapped; return the path's length."""
    layout, axes = integers(table, 0)[0], reals(table, 1)
    integers_of(genome, layout[0], layout[1] != 0, way.codes)
    count, last = axes.shape[1], way.places.shape[0] - 1
    length = 0.0
    for row in range(1, last + 1):
        squared = 0.0
        for axis in range(count):
            if row == last:
                place = axes[_GOAL, axis]
            else:
                place = axes[_LOW, axis] + axes[_STEP, axis] * way.codes[(row - 1) * count + axis]
            step = place - way.places[row - 1, axis]
            if axes[_PERIOD, axis] > 0.0:
                # The shorter way: the step is reduced to at most half a period, and the place is unwrapped accordingly.
                step -= axes[_PERIOD, axis] * np.floor(step / axes[_PERIOD, axis] + 0.5)
                place = way.places[row - 1, axis] + step
            way.places[row, axis] = place
            squared += step * step
        length += np.sqrt(squared)
    return length


@subroutine
def _is_near(way: Any, sphere: Any, inverse: Any) -> Any:
    """Return whether the segment comes nearer to a bounding sphere's centre than its radius."""
    along = 0.0
    for axis in range(way.step.size):
        along += (sphere[axis] - way.begin[axis]) * way.step[axis]
    share = min(1.0, max(0.0, along * inverse))
    squared = 0.0
    for axis in range(way.step.size):
        away = sphere[axis] - way.begin[axis] - share * way.step[axis]
        squared += away * away
    return squared < sphere[-1] * sphere[-1]


@subroutine
def _count_group(way: Any, obstacles: Any, counted: Any, inverse: Any) -> Any:
    """Return how many obstacles of a group the segment crosses that were not counted before.

    The loops of arithmetic over lanes have no branches, so that the compiler vectorises them.
    """
    along, squared, axes = way.along, way.squared, way.step.size
    along[:], squared[:] = 0.0, 0.0
    for axis in range(axes):
        begin, step = way.begin[axis], way.step[axis]
        for lane in range(TOGETHER):
            along[lane] += (obstacles[axis, lane] - begin) * step
    for axis in range(axes):
        begin, step = way.begin[axis], way.step[axis]
        for lane in range(TOGETHER):
            away = obstacles[axis, lane] - begin - min(1.0, max(0.0, along[lane] * inverse)) * step
            squared[lane] += away * away
    crossed = 0
    for lane in range(TOGETHER):
        if squared[lane] < obstacles[axes, lane] and not counted[lane]:
            counted[lane] = True
            crossed += 1
    return crossed


@subroutine
def _count(way: Any, table: Any) -> Any:
    """Return how many obstacles the segment crosses that were not counted before, by a walk through the tree."""
    spheres, following, group, obstacles = (
        reals(table, 3),
        integers(table, 4)[0],
        integers(table, 5)[0],
        reals(table, 6),
    )
    rows = spheres.shape[1]
    squared = 0.0
    for axis in range(rows - 1):
        squared += way.step[axis] * way.step[axis]
    # A segment of no length is a point: the share along it is 0.
    inverse = 1.0 / squared if squared > 0.0 else 0.0
    crossed, place = 0, 0
    while place < following.size:
        if not _is_near(way, spheres[place], inverse):
            place = following[place]  # nothing that this sphere holds can be crossed
            continue
        which = group[place]
        if which >= 0:
            members = obstacles[which * rows : (which + 1) * rows]
            crossed += _count_group(way, members, way.counted[which], inverse)
        place += 1
    return crossed


@subroutine
def _turn_to_first(way: Any, axes: Any, widest: Any) -> Any:
    """Choose the images of a segment that may be near to an obstacle, and begin with the first.

    Along a periodic axis all obstacles have their centres within the bounds, and no radius is greater than ``widest``,
    which is at most half a period (`validation` refuses others). A segment is no longer than half a period. So at most
    one image on either side of the segment can reach an obstacle.
    """
    for axis in range(way.step.size):
        low, period = axes[_LOW, axis], axes[_PERIOD, axis]
        way.first[axis] = way.last[axis] = 0.0
        if period > 0.0:
            # The segment begins within the bounds, as the obstacles' centres do.
            way.origin[axis] -= period * np.floor((way.origin[axis] - low) / period)
            end = way.origin[axis] + way.step[axis]
            if max(way.origin[axis], end) - period > low - widest:
                way.first[axis] = -1.0
            if min(way.origin[axis], end) < low + widest:
                way.last[axis] = 1.0
        way.turn[axis] = way.first[axis]
        way.begin[axis] = way.origin[axis] + period * way.turn[axis]


@subroutine
def _turn_to_next(way: Any, axes: Any) -> Any:
    """Go on to the next combination of shifts, as an odometer does; return whether there is one."""
    for axis in range(way.step.size):
        more = way.turn[axis] < way.last[axis]
        way.turn[axis] = way.turn[axis] + 1.0 if more else way.first[axis]
        way.begin[axis] = way.origin[axis] + axes[_PERIOD, axis] * way.turn[axis]
        if more:
            return True
    return False


@subroutine
def _crossed(way: Any, table: Any) -> Any:
    """Return the number of obstacles crossed, each counted once, however many segments cross it."""
    axes, widest = reals(table, 1), reals(table, 2)[0, 3]
    # Counted over all segments and images of a path: an obstacle that several of them cross counts once.
    way.counted[:] = False
    crossed = 0
    for segment in range(way.places.shape[0] - 1):
        for axis in range(way.step.size):
            way.origin[axis] = way.places[segment, axis]
            way.step[axis] = way.places[segment + 1, axis] - way.places[segment, axis]
        _turn_to_first(way, axes, widest)
        crossed += _count(way, table)
        while _turn_to_next(way, axes):
            crossed += _count(way, table)
    return crossed


@subroutine
def _evaluate(genome: Any, table: Any, way: Any) -> Any:
    weights = reals(table, 2)[0]
    # Rounding may make the straight path shorter than the straight way.
    detour = max(0.0, _follow(genome, table, way) - weights[1])
    return _crossed(way, table) + weights[0] * detour / (detour + weights[2])


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Fill the number of obstacles that coded paths cross, plus less than the length weight for their detours."""
    way = _room_for(table)
    for row in range(fitness.size):
        fitness[row] = _evaluate(genomes[row], table, way)


@kernel("Tuple((float64[:,:,::1], int64[::1]))(uint8[:,::1], int64[:,::1])")
def follow(genomes: Genomes, table: Table) -> tuple[Floats, Cells]:
    """Return the paths that genomes code, (n, nodes + 2, axes), and how many obstacles each crosses, (n,)."""
    way = _room_for(table)
    paths, crossed = np.empty((genomes.shape[0], *way.places.shape)), np.empty(genomes.shape[0], np.int64)
    for row in range(genomes.shape[0]):
        _follow(genomes[row], table, way)
        paths[row] = way.places
        crossed[row] = _crossed(way, table)
    return paths, crossed
