"""Faults that wait for something to happen in a simulated cluster, and strike soon after it."""

import contextlib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

from node.assignment import Assignment
from supernode.chaos.simulated.cluster import Cluster
from supernode.chaos.simulated.plans import NEIGHBOUR, PROPOSER, Fault
from supernode.chaos.simulated.world import World
from wire import control
from wire.seal import HEAD_BYTES
from wire.strict import Rejected


class Ambushes:
    """Counts events, and carries out the faults that wait for them.

    Args:
        world: the world.
        cluster: what suffers the faults.
        faults: those of the plan; the ones without ``upon`` are left to others.
        strikes: called with the time when such a fault will be over, as soon as that is known.
    """

    def __init__(
        self, world: World, cluster: Cluster, faults: tuple[Fault, ...], strikes: Callable[[float], None]
    ) -> None:
        self._world = world
        self._cluster = cluster
        self._waiting = [fault for fault in faults if fault.upon]
        self._strikes = strikes
        self._asked: Counter[str] = Counter()
        self._proposed: set[tuple[int, int, int]] = set()

    def asked(self, sealed: bytes) -> None:
        """Note that a coordinator has asked a question, of which this is the sealed command."""
        if not self._waiting:
            return
        self._count("question")
        with contextlib.suppress(Rejected):  # a question to a host is no command
            self._count(control.decode(sealed[HEAD_BYTES:]).name)

    def _count(self, what: str) -> None:
        self._asked[what] += 1
        self._happened(what, self._asked[what])

    def look(self, every: float) -> None:
        """Look for cells that have proposed to stop, now and then again and again. On the hub."""
        for node, process in list(self._cluster.nodes.items()):
            assignment = process.driver.assignment
            if assignment is not None and assignment.cell.rows.proposals:
                cell = assignment.job, assignment.epoch, assignment.cell.number
                if cell not in self._proposed:
                    self._proposed.add(cell)
                    self._happened("proposal", len(self._proposed), _those_there(node, assignment))
        if any(fault.upon == "proposal" for fault in self._waiting):
            self._world.at(self._world.now + every, lambda: self.look(every))

    def _happened(self, what: str, count: int, there: Mapping[str, str] | None = None) -> None:
        due = [fault for fault in self._waiting if (fault.upon, fault.count) == (what, count)]
        for waiting in due:
            self._waiting.remove(waiting)
            fault = replace(waiting, whom=(there or {}).get(waiting.whom, waiting.whom))
            at = self._world.now + fault.at
            self._strikes(at + fault.seconds)
            self._world.at(at, partial(self._cluster.suffer, fault))


def _those_there(node: int, assignment: Assignment) -> dict[str, str]:
    """Return the names of the process whose cell has proposed to stop, and of a neighbour's."""
    neighbours = assignment.cell.plan.topology.neighbours(assignment.cell.number)
    beside = assignment.links.wiring.nodes[neighbours[0]]
    return {PROPOSER: f"node {node}", NEIGHBOUR: f"node {beside}"}
