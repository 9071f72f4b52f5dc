"""The messages in neighbours' answers, until their exchanges come.

A neighbour that is asked for a message answers with that and all later ones. A process that takes over from a dead one
needs them exchange by exchange, as they once came.
"""

from collections import deque
from collections.abc import Sequence


class Backlog:
    """For each neighbour the messages that have been got by asking and are not used yet; false if there is none."""

    def __init__(self) -> None:
        self._messages: dict[int, deque[tuple[int, bytes]]] = {}  # with the exchange of each, the earliest first

    def __bool__(self) -> bool:
        return bool(self._messages)

    def put(self, sender: int, first: int, messages: Sequence[bytes]) -> None:
        """Keep a neighbour's messages, one of each exchange from ``first`` on, in place of those kept before."""
        self._messages[sender] = deque(enumerate(messages, first))

    def last(self, sender: int, before: int) -> int:
        """Return the exchange up to which there are a neighbour's messages, given that those up to ``before`` came."""
        messages = self._messages.get(sender)
        return max(before, messages[-1][0]) if messages and messages[0][0] <= before + 1 else before

    def take(self, exchange: int) -> list[tuple[int, bytes]]:
        """Take the messages of an exchange out, each with its sender; forget those of earlier ones."""
        taken = []
        for sender, messages in list(self._messages.items()):
            while messages and messages[0][0] <= exchange:
                its, message = messages.popleft()
                if its == exchange:
                    taken.append((sender, message))
            if not messages:
                del self._messages[sender]
        return taken
