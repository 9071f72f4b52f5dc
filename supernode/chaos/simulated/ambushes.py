"""Faults that wait for something to happen in a simulated cluster, and strike soon after it."""

from collections.abc import Callable
from functools import partial

from supernode.chaos.simulated.cluster import Cluster
from supernode.chaos.simulated.plans import Fault
from supernode.chaos.simulated.world import World


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
        self._questions = 0
        self._proposed: set[tuple[int, int, int]] = set()

    def asked(self) -> None:
        """Note that a coordinator has asked a question."""
        self._questions += 1
        self._happened("question", self._questions)

    def look(self, every: float) -> None:
        """Look for cells that have proposed to stop, now and then again and again. On the hub."""
        for process in list(self._cluster.nodes.values()):
            assignment = process.driver.assignment
            if assignment is not None and assignment.cell.rows.proposals:
                cell = assignment.job, assignment.epoch, assignment.cell.number
                if cell not in self._proposed:
                    self._proposed.add(cell)
                    self._happened("proposal", len(self._proposed))
        if any(fault.upon == "proposal" for fault in self._waiting):
            self._world.at(self._world.now + every, lambda: self.look(every))

    def _happened(self, what: str, count: int) -> None:
        due = [fault for fault in self._waiting if (fault.upon, fault.count) == (what, count)]
        for fault in due:
            self._waiting.remove(fault)
            at = self._world.now + fault.at
            self._strikes(at + fault.seconds)
            self._world.at(at, partial(self._cluster.suffer, fault))
