"""A node's part in the relay on a core that many share: it breeds while it has the baton, and tells the last of that.

Until its turn is over most of its neighbours cannot read anything, so all that it would tell them before is superseded.
"""

import time
from collections.abc import Callable
from functools import partial

from node.assignment import Assignment
from node.baton import Baton, Batons
from node.cell import Cell
from node.turns import LONG


class Relay:
    """One node's part. Of nodes that hand no baton on it only publishes what they tell.

    Args:
        batons: those of the host's cores.

    Attributes:
        over_at: until when the node has the baton, on the monotonic clock.
    """

    def __init__(self, batons: Batons) -> None:
        self._batons = batons
        self._baton: Baton | None = None  # the one that this node has,
        self.over_at = 0.0
        self._unsent: Callable[[], None] | None = None  # publishes its latest message

    def take_over(self, assignment: Assignment) -> None:
        """Before a step: have the baton, if one is handed on there; but with events, such as to halt, wait for none."""
        if assignment.hands_on and self._baton is None and not assignment.events:
            assert assignment.core is not None, "who hands a baton on keeps to a core"
            baton = self._batons.get(assignment.core)
            if baton is not None:
                baton.take()
                self._baton, self.over_at = baton, time.monotonic() + LONG
        self._supersede(assignment.cell)

    def publish(self, assignment: Assignment, payload: bytes) -> None:
        """A message, at once or, in a turn, at its end.

        Where some generations tell nothing, what is kept back might never be superseded.
        """
        if self._baton is None or assignment.cell.ended or assignment.cell.plan.run.interval > 1:
            assignment.links.publish(payload)
        else:
            self._unsent = partial(assignment.links.publish, payload)

    @property
    def has_turn(self) -> bool:
        """Whether the node has the baton, and nothing that it has to send before it breeds on."""
        return self._baton is not None and self._unsent is None

    def step_is_done(self, assignment: Assignment) -> None:
        """After a step: hand the baton on if this turn is over."""
        if assignment.bred_at >= self.over_at or not assignment.hands_on:
            self.hand_on()

    def hand_on(self) -> None:
        """Let others breed, if this node has the baton, and tell the last individual."""
        if self._baton is not None:
            self._send()
            baton, self._baton = self._baton, None
            baton.hand_on()

    def _supersede(self, cell: Cell) -> None:
        """What was not sent yet will not be: the next generation has news, but for the last one, which tells none."""
        if self._unsent is None:
            return
        if cell.rows.generation + 1 < cell.rows.limit:
            self._unsent = None
            cell.take_back()
        else:
            self._send()

    def _send(self) -> None:
        if self._unsent is not None:
            publish, self._unsent = self._unsent, None
            publish()
