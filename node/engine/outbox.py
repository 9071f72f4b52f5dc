"""The outbox of a cell: its latest messages, for neighbours that miss some.

In lockstep a neighbour that runs can miss none but the last two. A process that takes the place of a dead one goes on
from an older state, and needs all messages since (`node.engine.state`).
"""

import numpy as np

from node.engine.ring import Ring, arrays
from node.engine.state_size import LEAST_DISTANCE

_BYTES = 8 << 10
"""Room for messages, unless fewer than `_AT_LEAST` of the longest ones fit in."""

_AT_LEAST = 16  # then four messages may lie between two states
_MOST_MESSAGES = 100
_SPARE = 2  # messages beyond those back to the third last state: a neighbour may be ahead
_STATE_SECONDS = 0.25  # from one state to the next, or sooner if the outbox is small


class Outbox(Ring):
    """The latest messages, each with the number of the generation; compiled code (`node.engine.rule`) writes them.

    Args:
        most_bytes: the most bytes of a message.
        most_bytes_with_state: the most bytes of a message that carries the cell's state, which few do.

    Attributes:
        with_state: the latest message that carries the state, which is not kept further.
    """

    def __init__(self, most_bytes: int, most_bytes_with_state: int) -> None:
        self._most_bytes = most_bytes
        super().__init__(*(each[0] for each in arrays(1, max(_BYTES, _AT_LEAST * most_bytes), _MOST_MESSAGES)))
        self.with_state = np.empty(most_bytes_with_state, np.uint8)

    def since(self, generation: int) -> list[bytes]:
        """Return the messages of a generation and of all after it; an empty list if the first of these is not kept."""
        kept = dict(self)  # a message that was published again counts once
        return [message for its, message in kept.items() if its >= generation] if generation in kept else []

    def messages_between_states(self, seconds: float) -> int:
        """Return after how many messages the next one should carry the cell's state; a power of two.

        It is a power of two so that cells agree on generations, although each chooses for itself. The outbox must reach
        back to the third last state, which is the oldest one that neighbours keep.

        Args:
            seconds: the time from one message to the next.
        """
        wanted = min((self.most_messages - _SPARE) // 3, int(_STATE_SECONDS / max(seconds, 1e-6)))
        return max(LEAST_DISTANCE, 1 << (max(1, wanted).bit_length() - 1))

    @property
    def most_messages(self) -> int:
        """How many messages it keeps at least if they are as long as the latest one.

        Room for the longest one is made before each is written, and as much may be left over at the end of the room.
        """
        return min(len(self.entries), (len(self.room) - 2 * self._most_bytes) // max(1, self.latest_size))

    @property
    def oldest(self) -> int | None:
        """The generation of the oldest message that is kept; None if there is none."""
        return next((generation for generation, _ in self), None)
