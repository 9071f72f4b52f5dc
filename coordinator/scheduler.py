"""Who runs next, and on which nodes: a queue and the free nodes, without any input, output or clock.

A job starts when it is at the head of the queue and enough nodes are free; one that does not fit yet holds back those
behind it, so that a large job is not overtaken for ever. Among the free nodes those are taken that were wired for the
same topology before, since nothing must be rewired then; else those whose wiring has been out of use the longest.
"""

import bisect
import itertools
from collections.abc import Iterable
from typing import NamedTuple

from problems.errors import BadInput


class QueueFull(RuntimeError):  # noqa: N818
    """No more jobs may wait; the message says how many do."""


class TooLarge(BadInput):
    """A job that asks for more cells than there are nodes; the message names both figures."""


class Placed(NamedTuple):
    """A job may start now: its cells, in their order, are to live on ``nodes``."""

    number: int
    nodes: tuple[int, ...]


class _Waiting(NamedTuple):
    """A job in the queue, ordered as the queue is."""

    behind: int  # minus the priority
    number: int
    cells: int
    topology: str


class _Wiring(NamedTuple):
    """Nodes that were linked as the cells, in their order, of a topology; the higher ``age``, the later."""

    age: int
    topology: str
    nodes: tuple[int, ...]


_UNWIRED = _Wiring(-1, "", ())


class Scheduler:
    """The queue and the nodes of one cluster.

    Args:
        nodes: how many there are, numbered from 0; or, if they are still to `join`, how many are expected at least.
        max_queue: how many jobs may wait for nodes, or None for any number.
        joining: whether there are none yet.
    """

    def __init__(self, nodes: int, max_queue: int | None = None, *, joining: bool = False) -> None:
        self._expected = nodes
        self._here = set() if joining else set(range(nodes))
        self.max_queue = max_queue
        self._queue: list[_Waiting] = []
        self._busy: dict[int, tuple[int, ...]] = {}  # job to nodes
        self._free = set(self._here)
        self._wired: dict[int, _Wiring] = {}  # node to its latest wiring
        self._ages = itertools.count()

    @property
    def nodes(self) -> int:
        """How many there are, or will be."""
        return max(self._expected, len(self._here))

    @property
    def queued(self) -> tuple[int, ...]:
        """The jobs that wait, the next one first."""
        return tuple(waiting.number for waiting in self._queue)

    @property
    def free_nodes(self) -> int:
        """How many nodes no job has."""
        return len(self._free)

    @property
    def here(self) -> tuple[int, ...]:
        """The nodes that there are."""
        return tuple(sorted(self._here))

    def nodes_of(self, number: int) -> tuple[int, ...] | None:
        """The nodes of a job that has some."""
        return self._busy.get(number)

    def add(
        self, number: int, cells: int, topology_spec: str, priority: int = 0, *, accepted_before: bool = False
    ) -> None:
        """Put a job into the queue: behind those of its priority and a lower number, before those of lower priority.

        Args:
            number: of the job; later ones have higher numbers.
            cells: the number of nodes that it needs.
            topology_spec: how they are linked.
            priority: higher is earlier.
            accepted_before: a job of the last coordinator's, or one that starts over, is never too many.

        Raises:
            TooLarge: if it could never start.
            QueueFull: if it would have to wait and too many do already.
        """
        assert number not in self._busy, f"job {number} has nodes already"
        assert number not in self.queued, f"job {number} is queued already"
        if cells > self.nodes:
            raise TooLarge(f"the job asks for {cells} cells ({topology_spec}), the cluster has {self.nodes} nodes")
        waiting = _Waiting(-priority, number, cells, topology_spec)
        place = bisect.bisect(self._queue, waiting)
        full = self.max_queue is not None and len(self._queue) >= self.max_queue
        starts_at_once = place == 0 and cells <= len(self._free)
        if full and not starts_at_once and not accepted_before:
            raise QueueFull(f"the queue is full: {len(self._queue)} jobs wait, at most {self.max_queue} may")
        self._queue.insert(place, waiting)

    def remove(self, number: int) -> bool:
        """Take a job out of the queue; whether it was in it."""
        before = len(self._queue)
        self._queue = [waiting for waiting in self._queue if waiting.number != number]
        return len(self._queue) < before

    def start(self) -> list[Placed]:
        """Give nodes to those jobs that may start now, in the order of the queue."""
        placed = []
        while self._queue and self._queue[0].cells <= len(self._free):
            waiting = self._queue.pop(0)
            nodes = self._choose(waiting.cells, waiting.topology)
            self._take(waiting.number, nodes, waiting.topology)
            placed.append(Placed(waiting.number, nodes))
        return placed

    def free(self, number: int) -> None:
        """A job has ended: its nodes are free again, wired as they are. Harmless if it has none."""
        self._free.update(self._here.intersection(self._busy.pop(number, ())))

    def join(self, nodes: Iterable[int]) -> None:
        """There are more nodes, or some are there again; they are linked to nobody. Harmless if they are there."""
        new = set(nodes) - self._here
        self._here |= new
        self._free |= new - {node for busy in self._busy.values() for node in busy}

    def leave(self, nodes: Iterable[int]) -> set[int]:
        """These nodes are gone. The jobs that have one of them, which have to end."""
        gone = set(nodes)
        self._here -= gone
        self._free -= gone
        for node in gone:
            self._wired.pop(node, None)
        return {number for number, nodes in self._busy.items() if gone.intersection(nodes)}

    def occupy(self, number: int, nodes: Iterable[int], topology_spec: str | None = None) -> None:
        """A job was found running on these nodes, linked in this order as that topology if it is known.

        Raises:
            ValueError: if there is no such node, or another job has it.
        """
        nodes = tuple(nodes)
        if not self._free.issuperset(nodes) or len(set(nodes)) < len(nodes):
            raise ValueError(f"job {number} cannot have the nodes {nodes}: they are not all free")
        self._take(number, nodes, topology_spec)

    def wired(self, nodes: Iterable[int], topology_spec: str) -> None:
        """These nodes, free or not, are linked in this order as that topology."""
        self._wire(tuple(nodes), topology_spec)

    def rewired(self, number: int, topology_spec: str) -> None:
        """A running job's nodes are now linked, in their order, as another topology."""
        self._wire(self._busy[number], topology_spec)

    def replaced(self, node: int) -> None:
        """A node was born anew and is linked to nobody yet."""
        self._wired.pop(node, None)

    def _take(self, number: int, nodes: tuple[int, ...], topology: str | None) -> None:
        self._free.difference_update(nodes)
        self._busy[number] = nodes
        self._wire(nodes, topology)

    def _wire(self, nodes: tuple[int, ...], topology: str | None) -> None:
        for node in nodes:
            self._wired.pop(node, None)
        if topology is not None:
            wiring = _Wiring(next(self._ages), topology, nodes)
            self._wired |= dict.fromkeys(nodes, wiring)

    def _choose(self, cells: int, topology: str) -> tuple[int, ...]:
        """Nodes wired as they should be, the latest such; else free ones whose wiring is the oldest, in their order."""
        wired = {wiring for node, wiring in self._wired.items() if wiring.topology == topology and node in self._free}
        for wiring in sorted(wired, reverse=True):
            if all(node in self._free and self._wired.get(node) is wiring for node in wiring.nodes):
                return wiring.nodes
        oldest = sorted(self._free, key=lambda node: (self._wired.get(node, _UNWIRED).age, node))
        return tuple(sorted(oldest[:cells]))
