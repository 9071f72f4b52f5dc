"""A node's turns on a core that many asynchronous nodes share: it breeds only while it has the core's token.

Of a turn only the last message is sent, when the node hands the token on. Most neighbours share the core, so they could
read nothing before; earlier messages would be superseded unread.
"""

import time
from collections.abc import Callable
from functools import partial

from node.assignment import Assignment
from node.cell import Cell
from node.core_token import CoreToken, CoreTokens
from node.cpu_affinity import LONG


class TurnTaking:
    """One node's turns. A node that hands no token on publishes every message at once.

    Only the main thread uses it.

    Args:
        core_tokens: the tokens of the host's cores, by core.

    Attributes:
        over_at: when the node's latest turn ends, seconds on the monotonic clock.
    """

    def __init__(self, core_tokens: CoreTokens) -> None:
        self._core_tokens = core_tokens
        self._core_token: CoreToken | None = None  # the token while this node has it
        self.over_at = 0.0
        self._unsent: Callable[[], None] | None = None  # publishes the latest message of a turn, at its end

    def take_over(self, assignment: Assignment) -> None:
        """Before a step wait for the token if the node needs one, and drop the unsent message that the step supersedes.

        With events, such as an order to halt, the step must not wait: it runs without the token.
        """
        if assignment.needs_token and self._core_token is None and not assignment.events:
            assert assignment.core is not None, "a node that hands the token on keeps to a core"
            core_token = self._core_tokens.get(assignment.core)
            if core_token is not None:
                core_token.take()
                self._core_token, self.over_at = core_token, time.monotonic() + LONG
        self._supersede(assignment.cell)

    def publish(self, assignment: Assignment, payload: bytes) -> None:
        """Publish a message now, or within a turn keep it until the turn ends.

        With an interval above 1 it is published now: `_supersede` would drop a kept message although the next
        generation may have none. The last message of a cell that has ended is published now too.
        """
        if self._core_token is None or assignment.cell.ended or assignment.cell.plan.run.interval > 1:
            assignment.links.publish(payload)
        else:
            self._unsent = partial(assignment.links.publish, payload)

    @property
    def has_turn(self) -> bool:
        """Return whether the node has the token and no message to send before it goes on breeding."""
        return self._core_token is not None and self._unsent is None

    def step_is_done(self, assignment: Assignment) -> None:
        """After a step: hand the token on if this turn is over."""
        if assignment.bred_at >= self.over_at or not assignment.needs_token:
            self.hand_on()

    def hand_on(self) -> None:
        """If this node has the token, publish its latest message and let another node breed."""
        if self._core_token is not None:
            self._send()
            core_token, self._core_token = self._core_token, None
            core_token.hand_on()

    def _supersede(self, cell: Cell) -> None:
        """Drop the unsent message: the next generation's will replace it, with the same number.

        If the next generation is the last one, it sends no message, so the unsent one is published instead.
        """
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
