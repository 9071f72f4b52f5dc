"""Which host gets which cells of a job: blocks of cells, so that few of a topology's edges lead from host to host.

Pure functions; `coordinator.jobs.scheduler` calls them. Results never depend on the placement: a cell's random draws
are keyed by the cell.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from topologies.topology import ROOT, Topology

Integers = NDArray[np.int64]


def fewest_hosts(free: Sequence[int], cells: int) -> list[int]:
    """Return how many cells each host gets, so that few hosts are used.

    Args:
        free: the number of free nodes of each host.
        cells: the number of cells, at most the sum of these.

    Returns:
        the share of each host, in the order of ``free``; the host with the fewest free nodes of those used may have
        nodes left.
    """
    shares, left = [0] * len(free), cells
    for host in sorted(range(len(free)), key=lambda each: (-free[each], each)):
        shares[host] = min(free[host], left)
        left -= shares[host]
    return shares


def host_of_cells(topology: Topology, shares: Sequence[int], labels: Sequence[str]) -> Integers:
    """Return the host of each cell, shape (cells,), with few edges between hosts, racks and blocks.

    The cells are put into several orders, and each order is dealt out host by host. Of these the one with the fewest
    crossing edges is returned. An order runs through bands of a rectangle, so that each host gets a block; hosts that
    follow each other get blocks that touch. Metis was not taken: the sizes of its parts are only about those asked for.

    Args:
        topology: the topology of the job.
        shares: how many cells each host gets; their sum is the number of cells.
        labels: the label of each host, such as ``block/rack/host``: hosts of one block, or rack, are near each other.
    """
    hosts = sorted((each for each in range(len(shares)) if shares[each]), key=lambda each: (labels[each], each))
    dealt = np.repeat(np.array(hosts, np.int64), [shares[each] for each in hosts])
    table, levels = topology.table(), _levels(labels)
    best, least = dealt, np.inf
    for order in _orders(topology, len(hosts)):
        of_cells = np.empty_like(dealt)
        of_cells[order] = dealt
        cost = sum(_crossing(table, level[of_cells]) for level in levels)
        if cost < least:
            best, least = of_cells, cost
    return best


def edges_between(topology: Topology, of_cells: Iterable[Hashable]) -> tuple[int, int]:
    """Return how many of a topology's edges lead from one host to another, and how many edges it has.

    An edge is a slot that names another cell: two cells that are neighbours of each other have two edges.
    """
    table = topology.table()
    own = np.arange(len(table))[:, None]
    numbers: dict[Hashable, int] = {}
    hosts = np.array([numbers.setdefault(host, len(numbers)) for host in of_cells], np.int64)
    return _crossing(table, hosts), int(np.count_nonzero(table != own))


def _crossing(table: Integers, of_cells: Integers) -> int:
    return int(np.count_nonzero(of_cells[table] != of_cells[:, None]))


def _levels(labels: Sequence[str]) -> list[Integers]:
    """Return for each level of the labels, the host itself last, a number for each host: shape (hosts,) each."""
    parts = [label.split("/") for label in labels]
    depth = max((len(each) for each in parts), default=0)
    above = [["/".join(each[:level]) for each in parts] for level in range(1, depth)]
    numbers = [np.unique(each, return_inverse=True)[1].astype(np.int64) for each in above]
    return [*numbers, np.arange(len(labels))]


def _orders(topology: Topology, hosts: int) -> Iterator[Integers]:
    """Yield orders of the cells in which cells that follow each other are near each other."""
    yield np.arange(topology.cells)
    rows, columns = getattr(topology, "rows", 0), getattr(topology, "columns", 0)
    if rows * columns != topology.cells:
        yield _from_the_root(topology)
        return
    cells = np.arange(topology.cells).reshape(rows, columns)
    for grid in (cells, cells.T):
        for bands in range(1, min(hosts, len(grid)) + 1):
            yield _in_bands(grid, bands)


def _in_bands(grid: Integers, bands: int) -> Integers:
    """Return the cells of a grid, band of rows after band of rows, each column by column, to and fro."""
    order = []
    for number, band in enumerate(np.array_split(grid, bands)):
        order.append((band if number % 2 == 0 else band[:, ::-1]).T.ravel())
    return np.concatenate(order)


def _from_the_root(topology: Topology) -> Integers:
    """Return the cells in the order in which a breadth-first search from the root meets them."""
    order, met, waiting = [], {ROOT}, deque([ROOT])
    while waiting:
        order.append(waiting.popleft())
        new = [each for each in dict.fromkeys(topology.neighbours(order[-1])) if each not in met]
        met.update(new)
        waiting.extend(new)
    return np.array(order, np.int64)
