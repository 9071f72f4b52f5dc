"""The compiled count of the obstacles that a path crosses (Eldershaw and Cameron).

A path is the start, the coded nodes and the goal, joined by straight segments. Lengths are those of
`problems.sphere_path.space`. Along a periodic axis a segment goes the shorter way, so that rows of a path are unwrapped.

The table (see `genetics.operators`): bits of each component, whether by Gray code, nodes; for each axis, in rows, the
place of code 0, the step from one code to the next, the period (0 if there is none), the start and the goal; the length
weight and the length of the straight way; and the fields of `problems.sphere_path.hierarchy.Hierarchy`.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Cells, Fitness, Genomes
from genetics.bit_kernels import integers_of
from genetics.compiled import kernel, subroutine
from genetics.operators import FITNESS, Table, integers, reals

Floats = NDArray[np.float64]

_LOW, _STEP, _PERIOD, _START, _GOAL = range(5)  # rows of the axes


class Way(NamedTuple):
    """A path, and what is asked of it again and again."""

    codes: Any  # (nodes · axes,)
    places: Any  # (nodes + 2, axes): start, nodes, goal
    steps: Any  # (nodes + 1, axes): from each place to the next
    inverse: Any  # (nodes + 1,): 1 / squared length of each segment, 0 if it has none
    offset: Any  # (axes,): room for `_segment_is_near`
    turned: Any  # (axes,): likewise


@subroutine
def _room_for(table: Any) -> Any:
    nodes, count = integers(table, 0)[0, 2], reals(table, 1).shape[1]
    way = Way(
        np.empty(nodes * count, np.int64),
        np.empty((nodes + 2, count)),
        np.empty((nodes + 1, count)),
        np.empty(nodes + 1),
        np.empty(count),
        np.empty(count, np.int64),
    )
    way.places[0] = reals(table, 1)[_START]
    return way


@subroutine
def _follow(genome: Any, table: Any, way: Any) -> Any:
    """Decode a genome into a path, unwrapped; returns its length."""
    layout, axes = integers(table, 0)[0], reals(table, 1)
    integers_of(genome, layout[0], layout[1] != 0, way.codes)
    count = axes.shape[1]
    length = 0.0
    for segment in range(way.inverse.size):
        squared = 0.0
        for axis in range(count):
            if segment == way.inverse.size - 1:
                place = axes[_GOAL, axis]
            else:
                place = axes[_LOW, axis] + axes[_STEP, axis] * way.codes[segment * count + axis]
            step = place - way.places[segment, axis]
            period = axes[_PERIOD, axis]
            if period > 0.0:
                step -= period * np.floor(step / period + 0.5)
                place = way.places[segment, axis] + step
            way.places[segment + 1, axis] = place
            way.steps[segment, axis] = step
            squared += step * step
        way.inverse[segment] = 1.0 / squared if squared > 0.0 else 0.0
        length += np.sqrt(squared)
    return length


@subroutine
def _squared_distance(offset: Any, step: Any, inverse: Any) -> Any:
    """Of the point ``offset`` to the segment from the origin to ``step``."""
    along = 0.0
    for axis in range(offset.size):
        along += offset[axis] * step[axis]
    share = min(1.0, max(0.0, along * inverse))
    squared = 0.0
    for axis in range(offset.size):
        away = offset[axis] - share * step[axis]
        squared += away * away
    return squared


@subroutine
def _segment_is_near(way: Any, segment: Any, sphere: Any, periods: Any) -> Any:
    """Whether a segment comes nearer to a sphere's centre than its reach, or to that of one of its images.

    Along a periodic axis the image nearest to the segment's begin counts, and the next one in the segment's sense: the
    segment is half a period long at most, so any other is at least that far away. A sphere that reaches farther, which
    only a bounding one may, counts as near.
    """
    step, reach, turnable = way.steps[segment], sphere[-1], 0
    for axis in range(step.size):
        offset, period = sphere[axis] - way.places[segment, axis], periods[axis]
        if period > 0.0:
            if reach > 0.5 * period:
                return True
            offset -= period * np.floor(offset / period + 0.5)
            if offset * step[axis] < 0.0 and period - abs(offset) - abs(step[axis]) < reach:
                way.turned[turnable] = axis
                turnable += 1
        way.offset[axis] = offset
    for choice in range(1 << turnable):
        for bit in range(turnable):
            axis = way.turned[bit]
            # Of the two images on either side of the begin, that which the choice says.
            if ((choice >> bit) & 1 == 1) == (way.offset[axis] * step[axis] < 0.0):
                way.offset[axis] -= np.copysign(periods[axis], way.offset[axis])
        if _squared_distance(way.offset, step, way.inverse[segment]) < reach * reach:
            return True
    return False


@subroutine
def _is_near(way: Any, sphere: Any, periods: Any) -> Any:
    """Whether any segment of a path comes nearer to a sphere's centre than its reach."""
    for segment in range(way.inverse.size):
        if _segment_is_near(way, segment, sphere, periods):
            return True
    return False


@subroutine
def _crossed(way: Any, table: Any) -> Any:
    """The number of obstacles crossed, each counted once; what a bounding sphere holds is skipped if that is not near."""
    periods, spheres, following = reals(table, 1)[_PERIOD], reals(table, 3), integers(table, 4)[0]
    crossed, sphere = 0, 0
    while sphere < following.size:
        if _is_near(way, spheres[sphere], periods):
            crossed += following[sphere] == sphere + 1
            sphere += 1
        else:
            sphere = following[sphere]
    return crossed


@subroutine
def _judge(genome: Any, table: Any, way: Any) -> Any:
    weights = reals(table, 2)[0]
    length = _follow(genome, table, way)
    detour = (length - weights[1]) / length if length > 0.0 else 0.0
    return _crossed(way, table) + weights[0] * max(0.0, detour)


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """The number of obstacles that coded paths cross, and a share of 1 for their detours."""
    way = _room_for(table)
    for row in range(fitness.size):
        fitness[row] = _judge(genomes[row], table, way)


@kernel("Tuple((float64[:,:,::1], int64[::1]))(uint8[:,::1], int64[:,::1])")
def follow(genomes: Genomes, table: Table) -> tuple[Floats, Cells]:
    """The paths that genomes code, shape (n, nodes + 2, axes), and how many obstacles each crosses, shape (n,)."""
    way = _room_for(table)
    paths, crossed = np.empty((genomes.shape[0], *way.places.shape)), np.empty(genomes.shape[0], np.int64)
    for row in range(genomes.shape[0]):
        _follow(genomes[row], table, way)
        paths[row] = way.places
        crossed[row] = _crossed(way, table)
    return paths, crossed
