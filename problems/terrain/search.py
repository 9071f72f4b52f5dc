"""Find the best path within some cells of a map: the tuned recipe crosses two paths and mends one this way.

Cells are marked (those of both parents, a window, a detour). Dijkstra's algorithm finds the path of least fitness over
marked cells. Blocked steps are allowed at the penalty that the fitness has for them, so paths through obstacles are
crossed and mended like others.

All functions are subroutines of the kernels. A cell's number is row · columns + column.
"""

from typing import Any, NamedTuple

import numpy as np

from genetics.sequence_kernels import clear_after
from lowlevel.compiled import subroutine
from problems.terrain.walking import D_COLUMN, D_ROW, GOAL, START, is_clear, is_passable, length_of, turn_of

HAIR = 1e-7  # the cost of a turn: of equally good paths the straighter one is found, which takes fewer blocks


class Room(NamedTuple):
    """The working arrays of searches.

    A mark or a cost counts only where its stamp is that of the current search. So nothing is cleared between searches,
    and on a large map each costs only as much as the cells that it visits.
    """

    marked: Any  # (cells,): the stamp of the search that marked a cell last
    reached: Any  # (cells,): the stamp of the search that reached a cell last
    cost: Any  # (cells,): the least cost known so far
    came: Any  # (cells,): the heading by which a cell is entered
    steps: Any  # (8 * cells,): the headings of a path
    trail: Any  # (cells,): the cells of the path that is being changed
    hits: Any  # (cells,): places in the trail from which a step is blocked
    keys: Any  # (8 * cells + 1,): the heap's keys, the costs of cells when they were pushed
    heap: Any  # (8 * cells + 1,): the cells; each of a cell's eight steps pushes one at most, and the start is one more


@subroutine
def room_for(world: Any) -> Any:
    """Return working arrays for searches with stamps of 1 and more; 0 marks nothing."""
    cells = world.classes.size
    return Room(
        np.zeros(cells, np.int32),
        np.zeros(cells, np.int32),
        np.empty(cells),
        np.empty(cells, np.int8),
        np.empty(8 * cells, np.int8),
        np.empty(cells, np.int32),
        np.empty(cells, np.int32),
        np.empty(8 * cells + 1),
        np.empty(8 * cells + 1, np.int32),
    )


# Marks ----------------------------------------------------------------------------------------------------------------
@subroutine
def is_on_map(world: Any, row: Any, column: Any) -> Any:
    """Return whether a cell is on the map, passable or not."""
    return 0 <= row < world.classes.shape[0] and 0 <= column < world.classes.shape[1]


@subroutine
def heading_of(d_row: Any, d_column: Any) -> Any:
    """Return the heading of a step to a neighbouring cell."""
    for heading in range(8):
        if D_ROW[heading] == d_row and D_COLUMN[heading] == d_column:
            return heading
    return 0


@subroutine
def mark_wall(world: Any, room: Any, stamp: Any, cell: Any, heading: Any, side: Any, most: Any) -> Any:
    """Mark the cells along what blocks a step from a passable cell: follow the wall with one hand on it.

    The wall is at the right hand (side 1) or at the left (side -1). Stop after ``most`` steps, or at the first cell
    again; return how many steps are left.
    """
    columns = world.classes.shape[1]
    row, column = cell // columns, cell % columns
    while most > 0:
        tried = 0
        # Turn away from the wall until a step is clear; after eight tries the cell is shut in.
        while tried < 8 and not is_clear(world, row + D_ROW[heading], column + D_COLUMN[heading], heading):
            heading = (heading + side) & 7
            tried += 1
        if tried == 8:
            return most
        row, column = row + D_ROW[heading], column + D_COLUMN[heading]
        room.marked[row * columns + column] = stamp
        most -= 1
        if row * columns + column == cell:
            return most
        heading = (heading - 3 * side) & 7  # turn towards the wall by 135°: the next try begins beside it
    return most


@subroutine
def mark_way(world: Any, room: Any, stamp: Any, begin: Any, end: Any, most: Any) -> Any:
    """Mark the cells nearest to the straight line between two cells, and up to ``most`` cells along what blocks it."""
    columns = world.classes.shape[1]
    row, column = begin // columns, begin % columns
    d_row, d_column = end // columns - row, end % columns - column
    steps = max(abs(d_row), abs(d_column))
    room.marked[begin] = stamp
    at_row, at_column = row, column
    for step in range(1, steps + 1):
        # Rounded division in integers: the cell nearest to the line at each step along its longer side.
        to_row = row + (2 * step * d_row + steps) // (2 * steps)
        to_column = column + (2 * step * d_column + steps) // (2 * steps)
        heading = heading_of(to_row - at_row, to_column - at_column)
        if most > 0 and is_passable(world, at_row, at_column) and not is_clear(world, to_row, to_column, heading):
            cell, half = at_row * columns + at_column, most // 2
            most = mark_wall(world, room, stamp, cell, heading, 1, half) + mark_wall(
                world, room, stamp, cell, heading, -1, half
            )
        at_row, at_column = to_row, to_column
        room.marked[at_row * columns + at_column] = stamp


@subroutine
def mark_path(world: Any, room: Any, stamp: Any, numbers: Any, bits: Any) -> Any:
    """Mark the cells of a genome's path until the goal or the edge of the map, and list them.

    From the end of a path that misses the goal, a straight line on to the goal is marked too, so that the marked cells
    always connect start and goal. The path's cells are listed in the trail, at most as many as the map has; the places
    in the trail from which a step is blocked are listed in the hits. Return the lengths of both lists.
    """
    columns = world.classes.shape[1]
    row, column = world.settings[START], world.settings[START + 1]
    goal = world.settings[GOAL] * columns + world.settings[GOAL + 1]
    heading = np.int64(numbers[1]) & 7
    at, count, hits, astray = row * columns + column, 1, 0, False
    room.marked[at], room.trail[0] = stamp, at
    for block in range(2, numbers[0] + 1):
        gene = np.int64(numbers[block])
        heading = (heading + turn_of(gene, bits)) & 7
        for _ in range(length_of(gene, bits)):
            row, column = row + D_ROW[heading], column + D_COLUMN[heading]
            astray = not is_on_map(world, row, column)
            if astray or at == goal or count == room.trail.size:
                break
            # A blocked step from an impassable cell is no hit: walls are followed from passable ground.
            was_passable = is_passable(world, row - D_ROW[heading], column - D_COLUMN[heading])
            if was_passable and not is_clear(world, row, column, heading):
                room.hits[hits] = count - 1
                hits += 1
            at = row * columns + column
            room.marked[at], room.trail[count] = stamp, at
            count += 1
        if astray or at == goal:
            break
    if at != goal:
        mark_way(world, room, stamp, at, goal, 0)
    return count, hits


@subroutine
def mark_window(world: Any, room: Any, stamp: Any, center: Any, reach: Any) -> Any:
    """Mark a square of cells around one, cut off at the edges of the map."""
    rows, columns = world.classes.shape
    row, column = center // columns, center % columns
    for r in range(max(0, row - reach), min(rows, row + reach + 1)):
        for c in range(max(0, column - reach), min(columns, column + reach + 1)):
            room.marked[r * columns + c] = stamp


# Dijkstra -------------------------------------------------------------------------------------------------------------
@subroutine
def _push(room: Any, size: Any, key: Any, cell: Any) -> Any:
    place = size
    while place > 0 and room.keys[(place - 1) >> 1] > key:
        parent = (place - 1) >> 1
        room.keys[place], room.heap[place] = room.keys[parent], room.heap[parent]
        place = parent
    room.keys[place], room.heap[place] = key, cell
    return size + 1


@subroutine
def _pop(room: Any, size: Any) -> Any:
    """Remove the first entry of the heap, which the caller has read; return the heap's size then."""
    size -= 1
    key, cell = room.keys[size], room.heap[size]
    place = 0
    while 2 * place + 1 < size:
        child = 2 * place + 1
        if child + 1 < size and room.keys[child + 1] < room.keys[child]:
            child += 1
        if room.keys[child] >= key:
            break
        room.keys[place], room.heap[place] = room.keys[child], room.heap[child]
        place = child
    room.keys[place], room.heap[place] = key, cell
    return size


@subroutine
def find_best(world: Any, room: Any, stamp: Any) -> Any:
    """Find the path of least fitness from the start to the goal over marked cells, which must connect them.

    Fill ``steps`` with its headings, and return how many there are.
    """
    columns = world.classes.shape[1]
    start = world.settings[START] * columns + world.settings[START + 1]
    goal = world.settings[GOAL] * columns + world.settings[GOAL + 1]
    room.cost[start], room.reached[start], room.came[start] = 0.0, stamp, -1
    size = _push(room, 0, 0.0, start)
    while size > 0:
        key, cell = room.keys[0], room.heap[0]
        if cell == goal:
            break
        size = _pop(room, size)
        if key > room.cost[cell]:  # an outdated entry: the cell was pushed again at a lower cost
            continue
        row, column = cell // columns, cell % columns
        for heading in range(8):
            to_row, to_column = row + D_ROW[heading], column + D_COLUMN[heading]
            if not is_on_map(world, to_row, to_column):
                continue
            to = to_row * columns + to_column
            if room.marked[to] != stamp:
                continue
            if is_clear(world, to_row, to_column, heading):
                # The same costs and penalty as in `walking.walk`, so that the search minimises the fitness.
                cost = key + world.costs[world.classes[to_row, to_column], heading]
            else:
                cost = key + world.penalty
            if heading != room.came[cell]:
                cost += HAIR
            if room.reached[to] != stamp or cost < room.cost[to]:
                room.cost[to], room.reached[to], room.came[to] = cost, stamp, heading
                size = _push(room, size, cost, to)
    return _trace(world, room, start, goal)


@subroutine
def _trace(world: Any, room: Any, start: Any, goal: Any) -> Any:
    """Fill ``steps`` with the headings that led to the goal, and return how many there are."""
    columns = world.classes.shape[1]
    cell, count = goal, 0
    while cell != start:
        heading = room.came[cell]
        room.steps[count] = heading
        cell -= D_ROW[heading] * columns + D_COLUMN[heading]
        count += 1
    # Read backwards from the goal.
    room.steps[:count] = room.steps[:count][::-1].copy()
    return count


# Paths as blocks ------------------------------------------------------------------------------------------------------
@subroutine
def line_steps(world: Any, room: Any, count: Any, begin: Any, end: Any) -> Any:
    """Append the headings of the closest approximation to a straight line (§3.2); return how many there are then."""
    columns = world.classes.shape[1]
    row, column = begin // columns, begin % columns
    d_row, d_column = end // columns - row, end % columns - column
    steps = max(abs(d_row), abs(d_column))
    at_row, at_column = 0, 0
    for step in range(1, steps + 1):
        to_row, to_column = (2 * step * d_row + steps) // (2 * steps), (2 * step * d_column + steps) // (2 * steps)
        room.steps[count] = heading_of(to_row - at_row, to_column - at_column)
        at_row, at_column = to_row, to_column
        count += 1
    return count


@subroutine
def write_path(room: Any, count: Any, bits: Any, numbers: Any) -> Any:
    """Write the first ``count`` steps as blocks; return whether there was room for all of them.

    A block turns by at most 45°, so a sharper turn takes blocks of length 0 before the block that moves on.
    """
    most = numbers.size - 1
    heading = np.int64(room.steps[0]) if count > 0 else 0
    numbers[1] = heading
    blocks, step = 1, 0
    while step < count:
        now, run = np.int64(room.steps[step]), 1
        # A straight run is one block, unless it is longer than a block's greatest length.
        while step + run < count and room.steps[step + run] == now and run + 1 < 1 << bits:
            run += 1
        turn = ((now - heading + 4) & 7) - 4
        side = 1 if turn > 0 else -1
        while abs(turn) > 1 and blocks < most:
            numbers[1 + blocks] = (1 if side > 0 else 2) << bits
            turn -= side
            blocks += 1
        if blocks == most:
            break
        numbers[1 + blocks] = ((1 if turn > 0 else 2 if turn < 0 else 0) << bits) | run
        heading = now
        step += run
        blocks += 1
    clear_after(numbers, blocks, 1)
    return step == count
