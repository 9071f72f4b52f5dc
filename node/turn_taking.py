"""How a node takes turns on a core that many share: it breeds while it has the token, and tells the last of that.

Until its turn is over most of its neighbours cannot read anything, so all that it would tell them before is superseded.
"""

import time
from collections.abc import Callable
from functools import partial

from node.assignment import Assignment
from node.cell import Cell
from node.core_token import CoreToken, CoreTokens
from node.cpu_affinity import LONG


class TurnTaking:
    """One node's part. Of nodes that hand no token on it only publishes what they tell.

    Args:
        core_tokens: those of the host's cores.

    Attributes:
        over_at: until when the node has the token, on the monotonic clock.
    """

    def __init__(self, core_tokens: CoreTokens) -> None:
        self._core_tokens = core_tokens
        self._core_token: CoreToken | None = None  # the one that this node has,
        self.over_at = 0.0
        self._unsent: Callable[[], None] | None = None  # publishes its latest message

    def take_over(self, assignment: Assignment) -> None:
        """Before a step: have the token, if one is handed on there; but with events, such as to halt, wait for none."""
        if assignment.hands_on and self._core_token is None and not assignment.events:
            assert assignment.core is not None, "a node that hands the token on keeps to a core"
            core_token = self._core_tokens.get(assignment.core)
            if core_token is not None:
                core_token.take()
                self._core_token, self.over_at = core_token, time.monotonic() + LONG
        self._supersede(assignment.cell)

    def publish(self, assignment: Assignment, payload: bytes) -> None:
        """A message, at once or, in a turn, at its end.

        Where some generations tell nothing, what is kept back might never be superseded.
        """
        if self._core_token is None or assignment.cell.ended or assignment.cell.plan.run.interval > 1:
            assignment.links.publish(payload)
        else:
            self._unsent = partial(assignment.links.publish, payload)

    @property
    def has_turn(self) -> bool:
        """Whether the node has the token, and nothing that it has to send before it breeds on."""
        return self._core_token is not None and self._unsent is None

    def step_is_done(self, assignment: Assignment) -> None:
        """After a step: hand the token on if this turn is over."""
        if assignment.bred_at >= self.over_at or not assignment.hands_on:
            self.hand_on()

    def hand_on(self) -> None:
        """Let others breed, if this node has the token, and tell the last individual."""
        if self._core_token is not None:
            self._send()
            core_token, self._core_token = self._core_token, None
            core_token.hand_on()

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
