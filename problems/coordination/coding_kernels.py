"""The compiled operators of sequences of synchronisation points (SPs), §3.2; see `sequences`.

The table of the operators (see `genetics.operators`) holds whether the length varies, N1, N2, NMAX, and whether the
recipe is tuned; the probability that the result of a crossover is mutated; the seconds of a move of robot 1 by 0, 1, ..
cells; those of robot 2; and the summed-area table, (N1 + 1, N2 + 1).

*Unstated* marks choices that the paper leaves open.
"""

from typing import Any, NamedTuple

import numpy as np

from genetics.arrays import Genomes
from genetics.operators import INITIALISE, VARIATION, Table
from genetics.randomness import CROSS, INITIAL, MUTATE, below, draw, unit
from genetics.sequence_kernels import numbers_of
from lowlevel.compiled import kernel, subroutine
from lowlevel.pointers import integers, reals
from problems.coordination.sequences import coordinate, diagram_of, read, rectangle, repair, write

MUTMAX = 10  # cells, the farthest that a slight mutation shifts a coordinate (§3.2)
MUTANTS = 0.5  # share of the offspring that are made by mutation alone (*unstated*)
STRONG = 0.5  # share of the mutations that are strong (*unstated*)
EACH = 0.5  # probability that a strong mutation first mutates either of its two SPs slightly (*unstated*)

REBUILT = 0.35  # share of the tuned mutations that are `_rebuild`
STRETCH = 4  # the most SPs that `_rebuild` replaces
RECHAINED = 0.35  # share of the tuned mutations that are `_rechain`
SITES = 40  # random cells among which `_rechain` looks for the best sequence
SWEEPS = 3  # passes of `_settle_all` through the new SPs and their neighbours


class Chance(NamedTuple):
    """The coordinates of the random numbers for one offspring; with purpose and number they determine each draw."""

    seed: Any
    cell: Any
    generation: Any
    child: Any


# Each decision about an offspring has a draw number of its own, so no draw depends on which others were made.
# Purpose CROSS:
_ALONE, _CUT = 0, 1
# Purpose MUTATE. _SLIGHT and _SLIGHT_TOO take three numbers each: whether to shift, and two shifts (or only these).
_AFTER, _STRONGLY, _PLACE, _INSERT, _SLIGHT, _SLIGHT_TOO, _GONE, _NEW, _REBUILD = 0, 1, 2, 3, 5, 8, 11, 12, 13


@subroutine
def _share(chance: Any, purpose: Any, number: Any) -> Any:
    """Draw a float in [0, 1)."""
    return unit(draw(chance.seed, chance.cell, chance.generation, purpose, chance.child, number))


@subroutine
def _choice(chance: Any, purpose: Any, number: Any, limit: Any) -> Any:
    """Draw an integer in [0, limit)."""
    return below(draw(chance.seed, chance.cell, chance.generation, purpose, chance.child, number), limit)


@subroutine
def _sort(points: Any) -> Any:
    """Sort each coordinate by itself, in increasing order, so that the points increase in both."""
    for axis in range(2):
        for place in range(1, points.shape[0]):
            value, hole = points[place, axis], place
            while hole > 0 and points[hole - 1, axis] > value:
                points[hole, axis] = points[hole - 1, axis]
                hole -= 1
            points[hole, axis] = value


@kernel(INITIALISE)
def initialise(deme: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Fill first demes with sorted uniform draws (§3.2, initial population).

    The length is NMAX or, if it varies, n in 1..NMAX with probability ∝ n.
    """
    variable, sides, most = integers(table, 0)[0, 0], integers(table, 0)[0, 1:3], integers(table, 0)[0, 3]
    points = np.empty((most, 2), np.int64)
    for individual in range(deme.shape[0]):
        chance = Chance(seed, cell, generation, individual)
        count = most
        if variable:  # of most * (most + 1) / 2 tickets, length n has n
            ticket = _choice(chance, INITIAL, 0, most * (most + 1) // 2)
            count = np.int64((1.0 + np.sqrt(1.0 + 8.0 * ticket)) / 2.0)
        for place in range(2 * count):
            points[place >> 1, place & 1] = _choice(chance, INITIAL, 1 + place, sides[place & 1])
        _sort(points[:count])
        write(points, count, numbers_of(deme[individual]))


@subroutine
def _cross_variable(first: Any, count: Any, second: Any, others: Any, chance: Any) -> Any:
    """Cross two sequences: ``first`` up to an SP P, then ``second`` from Q on (§3.2, figure 1).

    Q is the first SP of ``second`` that is greater than P in both coordinates. The child replaces ``first``, which is
    unchanged if there is no Q or no room. Returns the child's count.
    """
    cut = _choice(chance, CROSS, _CUT, count)
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
    """Cross two sequences at one point between SPs; the child replaces ``first``.

    *Unstated*: §3.1 leaves the operators to its reference.
    """
    if count > 1:
        cut = 1 + _choice(chance, CROSS, _CUT, count - 1)
        first[cut:count] = second[cut:count]
        repair(first, count)


@subroutine
def _shift(points: Any, place: Any, diagram: Any, chance: Any, number: Any) -> Any:
    """Mutate one SP slightly: shift it by two independent integers within ±MUTMAX (§3.2). The caller must repair."""
    for axis in range(2):
        shift = _choice(chance, MUTATE, number + axis, 2 * MUTMAX + 1) - MUTMAX
        points[place, axis] = min(max(points[place, axis] + shift, 0), diagram.last[axis])


@subroutine
def _make_room(points: Any, count: Any, place: Any, gone: Any, new: Any) -> Any:
    """Replace ``gone`` SPs from ``place`` on by room for ``new`` ones, and return the new count."""
    if new > gone:
        for later in range(count - 1, place + gone - 1, -1):
            points[later + new - gone] = points[later]
    elif new < gone:
        for later in range(place + gone, count):
            points[later + new - gone] = points[later]
    return count + new - gone


@subroutine
def _strengthen(points: Any, count: Any, diagram: Any, chance: Any) -> Any:
    """Mutate strongly: insert an SP between two, each of which may be mutated slightly before (§3.2, figure 2).

    If there is only one SP, the end takes the place of the second. Returns the new count.
    """
    place = _choice(chance, MUTATE, _PLACE, max(count - 1, 1))
    for which, number in ((place, _SLIGHT), (place + 1, _SLIGHT_TOO)):
        if which < count and _share(chance, MUTATE, number) < EACH:
            _shift(points, which, diagram, chance, number + 1)
    repair(points, count)
    x, y = points[place, 0], points[place, 1]
    width = coordinate(points, count, place + 1, 0, diagram) - x
    height = coordinate(points, count, place + 1, 1, diagram) - y
    if min(width, height) < 2 or count == points.shape[0]:
        return count
    count = _make_room(points, count, place + 1, 0, 1)
    points[place + 1, 0] = x + 1 + _choice(chance, MUTATE, _INSERT, width - 1)
    points[place + 1, 1] = y + 1 + _choice(chance, MUTATE, _INSERT + 1, height - 1)
    return count


@subroutine
def _scatter(points: Any, count: Any, place: Any, new: Any, diagram: Any, chance: Any, number: Any) -> Any:
    """Draw ``new`` SPs from ``place`` on uniformly between the SPs before and after them, each coordinate sorted."""
    for axis in range(2):
        low = coordinate(points, count, place - 1, axis, diagram)
        high = coordinate(points, count, place + new, axis, diagram)
        for each in range(new):
            points[place + each, axis] = low + _choice(chance, MUTATE, number + 2 * each + axis, high - low + 1)
    _sort(points[place : place + new])


@subroutine
def _settle(points: Any, count: Any, place: Any, diagram: Any) -> Any:
    """Move an SP, within ±MUTMAX, to where its two rectangles hold the fewest obstacle cells; then, take least time."""
    left, bottom = coordinate(points, count, place - 1, 0, diagram), coordinate(points, count, place - 1, 1, diagram)
    right, top = coordinate(points, count, place + 1, 0, diagram), coordinate(points, count, place + 1, 1, diagram)
    x, y = points[place, 0], points[place, 1]
    least, fewest = np.inf, np.int64(diagram.sums.size) * 2
    for i in range(max(left, x - MUTMAX), min(right, x + MUTMAX) + 1):
        for j in range(max(bottom, y - MUTMAX), min(top, y + MUTMAX) + 1):
            before, hit = rectangle(diagram, left, bottom, i, j)
            after, hit_too = rectangle(diagram, i, j, right, top)
            obstacles, time = hit + hit_too, before + after
            if obstacles < fewest or (obstacles == fewest and time < least):
                fewest, least = obstacles, time
                points[place, 0], points[place, 1] = i, j


@subroutine
def _settle_all(points: Any, count: Any, place: Any, new: Any, diagram: Any) -> Any:
    """Settle ``new`` SPs from ``place`` on and their two neighbours one after another, in `SWEEPS` passes."""
    for _ in range(SWEEPS):
        for each in range(max(place - 1, 0), min(place + new + 1, count)):
            _settle(points, count, each, diagram)


@subroutine
def _rebuild(points: Any, count: Any, variable: Any, diagram: Any, chance: Any) -> Any:
    """Replace a few consecutive SPs by random ones, settle these and their neighbours, and return the new count.

    This tuned mutation is not of the paper. It brings individuals from one side of an obstacle to the other.
    """
    place = _choice(chance, MUTATE, _PLACE, count + 1 if variable else count)
    following = min(STRETCH, count - place)
    if variable:
        gone = _choice(chance, MUTATE, _GONE, following + 1)
        new = 1 + _choice(chance, MUTATE, _NEW, gone + 2)
    else:
        gone = 1 + _choice(chance, MUTATE, _GONE, following)
        new = gone
    if count - gone + new > points.shape[0]:
        return count
    count = _make_room(points, count, place, gone, new)
    _scatter(points, count, place, new, diagram, chance, _REBUILD)
    _settle_all(points, count, place, new, diagram)
    return count


@subroutine
def _slide(site: Any, side: Any, low: Any, high: Any, diagram: Any) -> Any:
    """Move a site out of an obstacle to one of four sides, but not out of the box: good SPs lie beside obstacles."""
    axis, step = side >> 1, 2 * (side & 1) - 1
    while low[axis] < site[axis] < high[axis] and rectangle(diagram, site[0], site[1], site[0], site[1])[1] > 0:
        site[axis] += step


@subroutine
def _order(sites: Any) -> Any:
    """Sort sites by the first coordinate, then by the second."""
    for place in range(1, sites.shape[0]):
        x, y, hole = sites[place, 0], sites[place, 1], place
        while hole > 0 and (sites[hole - 1, 0] > x or (sites[hole - 1, 0] == x and sites[hole - 1, 1] > y)):
            sites[hole] = sites[hole - 1]
            hole -= 1
        sites[hole, 0], sites[hole, 1] = x, y


@subroutine
def _sites(low: Any, high: Any, diagram: Any, chance: Any) -> Any:
    """Return the corner ``low`` of a box, `SITES` random cells of it in order, and its corner ``high``."""
    sites = np.empty((SITES + 2, 2), np.int64)
    sites[0], sites[-1] = low, high
    for each in range(SITES):
        site, number = sites[1 + each], _REBUILD + 3 * each
        for axis in range(2):
            site[axis] = low[axis] + _choice(chance, MUTATE, number + axis, high[axis] - low[axis] + 1)
        _slide(site, _choice(chance, MUTATE, number + 2, 4), low, high, diagram)
    _order(sites[1:-1])
    return sites


@subroutine
def _best_before(sites: Any, diagram: Any) -> Any:
    """Return for each site its predecessor in the best sequence from the first site, by dynamic programming.

    The best sequence has the fewest obstacle cells in its rectangles and, of such, takes the least time.
    """
    count = sites.shape[0]
    fewest, least, before = np.zeros(count, np.int64), np.zeros(count), np.zeros(count, np.int64)
    for to in range(1, count):
        fewest[to] = diagram.sums.size * 2 * count  # more than any sequence has
        for place in range(to):  # sites are sorted, so all predecessors come earlier
            if sites[place, 1] > sites[to, 1] or fewest[place] > fewest[to]:
                continue
            time, hit = rectangle(diagram, sites[place, 0], sites[place, 1], sites[to, 0], sites[to, 1])
            time, hit = time + least[place], hit + fewest[place]
            if hit < fewest[to] or (hit == fewest[to] and time < least[to]):
                fewest[to], least[to], before[to] = hit, time, place
    return before


@subroutine
def _chain(sites: Any, diagram: Any) -> Any:
    """Return the SPs of the best sequence from the first to the last site, without these two."""
    before = _best_before(sites, diagram)
    first, site = sites.shape[0], before[-1]
    links = np.empty_like(sites)
    while site > 0:
        first -= 1
        links[first] = sites[site]
        site = before[site]
    return links[first:]


@subroutine
def _rechain(points: Any, count: Any, variable: Any, diagram: Any, chance: Any) -> Any:
    """Replace a stretch of any length by the best sequence through random cells, settle it, and return the new count.

    This tuned mutation is not of the paper. It brings individuals to the other side of several obstacles at once. If
    the sequence has too few SPs, the end of the stretch is repeated; if it has too many, nothing changes.
    """
    place = _choice(chance, MUTATE, _PLACE, count)
    gone = min(_choice(chance, MUTATE, _GONE, count + 1), count - place)
    low, high = np.empty(2, np.int64), np.empty(2, np.int64)
    for axis in range(2):
        low[axis] = coordinate(points, count, place - 1, axis, diagram)
        high[axis] = coordinate(points, count, place + gone, axis, diagram)
    chain = _chain(_sites(low, high, diagram, chance), diagram)
    found, needed = chain.shape[0], 1 - (count - gone) if variable else gone
    new = max(found, needed)
    if count - gone + new > points.shape[0]:
        return count
    count = _make_room(points, count, place, gone, new)
    points[place : place + found] = chain
    for each in range(found, new):
        points[place + each] = high
    _settle_all(points, count, place, new, diagram)
    return count


@subroutine
def _mutate(points: Any, count: Any, variable: Any, tuned: Any, diagram: Any, chance: Any) -> Any:
    """Mutate a sequence slightly, or in one of the recipe's other ways, and return the new count."""
    which = _share(chance, MUTATE, _STRONGLY)
    if which >= (REBUILT + RECHAINED if tuned else STRONG):
        _shift(points, _choice(chance, MUTATE, _PLACE, count), diagram, chance, _SLIGHT)
        repair(points, count)
        return count
    if tuned and which >= REBUILT:
        return _rechain(points, count, variable, diagram, chance)
    if tuned:
        return _rebuild(points, count, variable, diagram, chance)
    if variable:
        return _strengthen(points, count, diagram, chance)
    _scatter(points, count, _choice(chance, MUTATE, _PLACE, count), 1, diagram, chance, _REBUILD)  # *unstated*
    return count


@kernel(VARIATION)
def variation(couples: Genomes, offspring: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Make one offspring of each parent: a mutant of it, or its child with the other parent, perhaps mutated.

    See §3.2, evolutionary algorithm characteristics.
    """
    layout, mutated, diagram = integers(table, 0)[0], reals(table, 1)[0, 0], diagram_of(table, 2)
    variable, tuned = layout[0] != 0, layout[4] != 0
    room = (numbers_of(offspring[0]).size - 1) // 2
    own, other = np.empty((room, 2), np.int64), np.empty((room, 2), np.int64)
    for child in range(offspring.shape[0]):
        chance = Chance(seed, cell, generation, child)
        count = read(numbers_of(couples[child >> 1, child & 1]), own)
        alone = _share(chance, CROSS, _ALONE) < MUTANTS
        if not alone:
            others = read(numbers_of(couples[child >> 1, 1 - (child & 1)]), other)
            if variable:
                count = _cross_variable(own, count, other, others, chance)
            else:
                _cross_fixed(own, other, count, chance)
        if alone or _share(chance, MUTATE, _AFTER) < mutated:
            count = _mutate(own, count, variable, tuned, diagram, chance)
        write(own, count, numbers_of(offspring[child]))
