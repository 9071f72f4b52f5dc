"""Decide which job runs next, and on which nodes: a queue and the free nodes. No input or output; the clock is given.

A job starts when it is at the head of the queue and enough nodes are free. A job that does not fit yet holds back those
behind it: otherwise small jobs could overtake a large one for ever. Clients take turns (`client_queues`); one whose
next job would have more nodes than it may have is passed over. A client with many jobs, which lets others go first,
leaves them also the nodes of those who are about to come back (`returning_clients`).

Free nodes that are wired for the same topology already are preferred, since they need no new links; otherwise those
whose wiring has been out of use the longest. Nodes on several hosts are chosen on few of them, and each host gets a
block of the topology.

Not thread-safe: the dispatcher calls it while it holds its lock.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import topologies
from coordinator.jobs.blocks import fewest_hosts, host_of_cells
from coordinator.jobs.client_limits import NO_LIMITS, ClientLimits
from coordinator.jobs.client_queues import ClientQueues, Waiting
from coordinator.jobs.returning_clients import ReturningClients
from problems.errors import BadInput
from topologies.topology import Topology


class QueueFull(RuntimeError):  # noqa: N818
    """The queue is full; the message says how many jobs wait."""


class TooLarge(BadInput):
    """The job asks for more cells than the cluster has nodes, or one client may have; the message has both figures."""


class Placed(NamedTuple):
    """A job that may start now; ``nodes`` are for its cells, in the order of these."""

    number: int
    nodes: tuple[int, ...]


class _Wiring(NamedTuple):
    """Nodes linked as a topology, in the order of its cells; a later wiring has a higher ``age``."""

    age: int
    topology: str
    nodes: tuple[int, ...]


_UNWIRED = _Wiring(-1, "", ())


class Scheduler:
    """The queue and the nodes of one cluster.

    Args:
        nodes: the number of nodes, numbered from 0; or, if they are still to `join`, the least number expected.
        limits: what each client may take.
        clock: returns the time in seconds, which never goes back.
        joining: whether the nodes are still to join.
        place_of: where a node's host is, such as ``block/rack/host``; see `coordinator.jobs.blocks`.
    """

    def __init__(
        self,
        nodes: int,
        limits: ClientLimits = NO_LIMITS,
        *,
        clock: Callable[[], float],
        joining: bool = False,
        place_of: Callable[[int], str] = lambda _: "",
    ) -> None:
        self._place_of = place_of
        self._expected = nodes
        self._here = set() if joining else set(range(nodes))
        self._limits = limits
        self._clock = clock
        self._queues = ClientQueues()
        self._returning = ReturningClients()
        self._busy: dict[int, tuple[int, ...]] = {}  # job to nodes, also to nodes that have left
        self._clients: dict[int, str] = {}  # job that has nodes to its client
        self._began: dict[int, float] = {}  # job that has nodes to the time when it got them
        self._free = set(self._here)  # the nodes that are here and busy with no job
        self._leaving: set[int] = set()  # nodes that no further job gets, and whose cells move away
        self._away: set[int] = set()  # nodes out of reach, which no further job gets either
        self._wired: dict[int, _Wiring] = {}  # node to its latest wiring
        self._ages = itertools.count()

    @property
    def nodes(self) -> int:
        """The number of nodes that there are, or that are expected."""
        return max(self._expected, len(self._here))

    @property
    def queued(self) -> tuple[int, ...]:
        """The jobs that wait, in the order of the clients' turns."""
        return self._queues.numbers

    @property
    def free_nodes(self) -> int:
        """The number of nodes that no job has."""
        return len(self._free)

    @property
    def here(self) -> tuple[int, ...]:
        """The nodes that are present, busy or free, sorted."""
        return tuple(sorted(self._here))

    def nodes_of(self, number: int) -> tuple[int, ...] | None:
        """Return the nodes of a job; None if it has none."""
        return self._busy.get(number)

    def add(
        self,
        number: int,
        cells: int,
        topology_spec: str,
        priority: int = 0,
        client: str = "",
        *,
        accepted_before: bool = False,
    ) -> None:
        """Put a job into its client's queue, ordered by priority, then by number.

        A job that starts over has its old number, and so gets its old place.

        Args:
            number: the job's number; later jobs have higher numbers.
            cells: the number of nodes that it needs.
            topology_spec: how these are linked.
            priority: of the client's jobs, those of a higher priority start earlier.
            client: the name of the client.
            accepted_before: whether the job was accepted by the previous coordinator; then the limits do not count.

        Raises:
            TooLarge: if the job could never start.
            QueueFull: if it would have to wait and too many of the client's jobs wait already.
        """
        assert number not in (*self._busy, *self.queued), f"job {number} is here already"
        if cells > self.nodes:
            raise TooLarge(f"the job asks for {cells} cells ({topology_spec}), the cluster has {self.nodes} nodes")
        if self._limits.nodes is not None and cells > self._limits.nodes and not accepted_before:
            most = f"one client may have {self._limits.nodes} nodes; expected a smaller --topology"
            raise TooLarge(f"the job asks for {cells} cells ({topology_spec}), {most}")
        waiting = Waiting(-priority, number, cells, topology_spec)
        others = self._queues.waiting(client)
        full = self._limits.waiting is not None and others >= self._limits.waiting
        self._queues.add(client, waiting, self._clock())
        starts_at_once = self._next() == (client, waiting) and cells <= self._free_for(client, cells)
        if full and not starts_at_once and not accepted_before:
            self.remove(number)
            raise QueueFull(f"the queue is full: {others} jobs wait, at most {self._limits.waiting} may")
        self._returning.came(client, self._clock())

    def remove(self, number: int) -> bool:
        """Take a job out of the queue; return whether it was in it."""
        return self._queues.remove(number)

    def _next(self) -> tuple[str, Waiting] | None:
        """Return the job that starts next, with its client; None if none waits whose client may have its nodes."""
        return self._queues.next(self._room, self._clock())

    def _free_for(self, client: str, cells: int) -> int:
        """Return how many of the free nodes the next job of a client may have, which has so many cells."""
        now = self._clock()
        return len(self._free) - (self._returning.kept(cells, now) if self._queues.yields(client, now) else 0)

    def _room(self, client: str) -> int:
        """Return how many further nodes a client's jobs may have, whether there are so many or not.

        A client without any may have all: a larger job than others was accepted when the limit was another one.
        """
        has = sum(len(self._busy[job]) for job, its in self._clients.items() if its == client)
        return self.nodes if self._limits.nodes is None or has == 0 else self._limits.nodes - has

    def start(self) -> list[Placed]:
        """Give nodes to the jobs that may start now, in the order of the queue, and return them."""
        placed = []
        while (found := self._next()) is not None and found[1].cells <= self._free_for(found[0], found[1].cells):
            client, waiting = found
            self._queues.take(client, self._clock())
            nodes = self._choose(waiting.cells, waiting.topology)
            self._take(waiting.number, nodes, waiting.topology, client)
            placed.append(Placed(waiting.number, nodes))
        return placed

    @property
    def look_again_at(self) -> float | None:
        """When `start` may find a job though nothing happens before; None if that cannot be."""
        found, now = self._next(), self._clock()
        if found is None:
            return None
        client, waiting = found
        kept = self._returning.kept_until(waiting.cells, now) if self._queues.yields(client, now) else None
        turn = self._queues.yields_until(now, client)  # if the next job lacks nodes, a smaller one may come to its turn
        return min((at for at in (kept, turn) if at is not None), default=None)

    def free(self, number: int) -> None:
        """Free the nodes of a job that has ended; they stay wired as they are. Harmless if the job has none."""
        if number not in self._busy:
            return
        nodes, client, now = self._busy.pop(number), self._clients.pop(number), self._clock()
        self._free.update(self._here.intersection(nodes) - self._leaving - self._away)
        seconds = now - self._began.pop(number)
        if not self._queues.waiting(client):
            self._returning.ended(client, len(nodes), seconds, now)

    def join(self, nodes: Iterable[int]) -> None:
        """Add nodes, new ones or some that had left; they have no links. Harmless for nodes that are here."""
        new = set(nodes) - self._here
        self._here |= new
        # A node may come back before the job has ended that it had: then `free` makes it free.
        self._free |= new - self._leaving - self._away - {node for busy in self._busy.values() for node in busy}

    def leave(self, nodes: Iterable[int]) -> set[int]:
        """Remove nodes that are gone; return the jobs that have one of them, which must end."""
        gone = set(nodes)
        self._here -= gone
        self._free -= gone
        self._leaving -= gone
        self._away -= gone
        for node in gone:
            self._wired.pop(node, None)
        return {number for number, nodes in self._busy.items() if gone.intersection(nodes)}

    def rest(self, nodes: Iterable[int]) -> None:
        """Give no further job to these nodes, which are out of reach, until `stay`; their cells keep them."""
        self._away.update(nodes)
        self._free -= self._away

    def stay(self, nodes: Iterable[int]) -> None:
        """Give jobs to these nodes again: their host was about to end, or out of reach, and has come back."""
        back = (self._leaving | self._away).intersection(nodes)
        self._leaving -= back
        self._away -= back
        self._free |= self._here.intersection(back) - {node for busy in self._busy.values() for node in busy}

    def drain(self, nodes: Iterable[int]) -> dict[int, dict[int, int]]:
        """Give no further job to these nodes, and give their cells to free nodes where there are enough for a job.

        Returns:
            for each job whose cells move, the new node of each old one. A job that is not among them keeps its nodes;
            a later call may find free ones.
        """
        self._leaving.update(nodes)  # also those that are not here yet: their host may be told to end as it starts
        self._free -= self._leaving
        moved = {}
        for number, own in self._busy.items():
            old = [node for node in own if node in self._leaving]
            if not old or len(old) > len(self._free):
                continue
            moved[number] = dict(zip(old, self._nearest(own, len(old)), strict=True))
            self._free.difference_update(moved[number].values())
            for node in moved[number].values():  # its links are those of another job
                self._wired.pop(node, None)
            self._busy[number] = tuple(moved[number].get(node, node) for node in own)
        return moved

    def extend(self, number: int) -> tuple[int, ...] | None:
        """Give a running job free nodes for as many further rows of its torus as possible; return all its nodes.

        Returns:
            None if it gets none: jobs that wait come first.
        """
        own = self._busy.get(number, ())
        wiring = self._wired.get(own[0]) if own else None
        topology = None if wiring is None else topologies.parse(wiring.topology)
        if self._next() is not None or not isinstance(topology, topologies.Torus):
            return None
        most = min(len(self._free) - self._returning.kept(0, self._clock()), self._room(self._clients[number]))
        if most < topology.columns:
            return None
        new = self._nearest(own, most // topology.columns * topology.columns)
        self._free.difference_update(new)
        self._busy[number] = own + tuple(new)
        return self._busy[number]

    def _nearest(self, nodes: tuple[int, ...], count: int) -> list[int]:
        """Return free nodes, those first whose hosts have nodes of a job already."""
        places = {self._place_of(node) for node in nodes if node not in self._leaving}
        return sorted(self._free, key=lambda node: (self._place_of(node) not in places, self._place_of(node), node))[
            :count
        ]

    def occupy(self, number: int, nodes: Iterable[int], topology_spec: str | None = None, client: str = "") -> None:
        """Note a job that was found running on these nodes.

        Args:
            number: the job's number.
            nodes: its nodes, in the order of its cells.
            topology_spec: how they are linked; None if that is not known.
            client: the name of its client.

        Raises:
            ValueError: if a node does not exist, or another job has it.
        """
        nodes = tuple(nodes)
        if not self._free.issuperset(nodes) or len(set(nodes)) < len(nodes):
            raise ValueError(f"job {number} cannot have the nodes {nodes}: they are not all free")
        self._take(number, nodes, topology_spec, client)

    def wired(self, nodes: Iterable[int], topology_spec: str) -> None:
        """Note that these nodes, free or busy, are linked in this order as a topology."""
        self._wire(tuple(nodes), topology_spec)

    def rewired(self, number: int, topology_spec: str) -> None:
        """Note that a running job's nodes are now linked, in their order, as another topology.

        The job may have been given further nodes that it has not taken yet: these are not linked.
        """
        self._wire(self._busy[number][: topologies.parse(topology_spec).cells], topology_spec)

    def replaced(self, node: int) -> None:
        """Note that a node has a new process, which has no links yet."""
        self._wired.pop(node, None)

    def _take(self, number: int, nodes: tuple[int, ...], topology: str | None, client: str) -> None:
        self._free.difference_update(nodes)
        self._busy[number], self._clients[number], self._began[number] = nodes, client, self._clock()
        self._wire(nodes, topology)

    def _wire(self, nodes: tuple[int, ...], topology: str | None) -> None:
        for node in nodes:
            self._wired.pop(node, None)
        if topology is not None:
            wiring = _Wiring(next(self._ages), topology, nodes)
            self._wired |= dict.fromkeys(nodes, wiring)

    def _choose(self, cells: int, topology: str) -> tuple[int, ...]:
        """Return free nodes for a job: those wired for its topology last, else those of the oldest wirings."""
        intact = self._intact(topology)
        oldest = sorted(self._free, key=lambda node: (self._wired.get(node, _UNWIRED).age, node))
        by_host: dict[str, list[int]] = {}
        for node in oldest:
            by_host.setdefault(self._place_of(node), []).append(node)
        if len(by_host) == 1:
            return intact or tuple(sorted(oldest[:cells]))
        chosen = _in_blocks(by_host, cells, topologies.parse(topology))
        return intact if intact and self._hosts_of(intact) <= self._hosts_of(chosen) else chosen

    def _intact(self, topology: str) -> tuple[int, ...]:
        """Return free nodes that are wired for a topology; () if there are none."""
        wired = {wiring for node, wiring in self._wired.items() if wiring.topology == topology and node in self._free}
        for wiring in sorted(wired, reverse=True):
            # A wiring is intact only if it is still the latest of each of its nodes.
            if all(node in self._free and self._wired.get(node) is wiring for node in wiring.nodes):
                return wiring.nodes
        return ()

    def _hosts_of(self, nodes: tuple[int, ...]) -> int:
        """Return on how many hosts nodes are."""
        return len({self._place_of(node) for node in nodes})


def _in_blocks(by_host: Mapping[str, list[int]], cells: int, topology: Topology) -> tuple[int, ...]:
    """Return nodes in the order of the cells, so that each host has a block of cells; see `coordinator.jobs.blocks`."""
    places = sorted(by_host)
    shares = fewest_hosts([len(by_host[place]) for place in places], cells)
    nodes = [iter(sorted(by_host[place][:share])) for place, share in zip(places, shares, strict=True)]
    return tuple(next(nodes[host]) for host in host_of_cells(topology, shares, places).tolist())
