"""The outbox of a cell: its last two messages, for neighbours that miss one; in lockstep none can miss an older one."""

import numpy as np


class Outbox:
    """Room for two messages: the one with an even number in place 0, the one with an odd number in place 1.

    Compiled code (`node.engine.rule`) writes the messages into these arrays, so they are never replaced.

    Attributes:
        room: the encoded messages, shape (2, bytes).
        said: the generation and the size in bytes of each message, shape (2, 2).
    """

    def __init__(self, most_bytes: int) -> None:
        self.room = np.empty((2, most_bytes), np.uint8)
        self.said = np.zeros((2, 2), np.int64)
        self._room = tuple(each.data for each in self.room)  # memoryviews: slicing an array costs as much as a message

    def message(self, number: int) -> bytes:
        """Return one of the last two messages, by its number."""
        place = number % 2
        return self._room[place][: self.said.item(place, 1)].tobytes()

    def of(self, generation: int) -> bytes | None:
        """Return the message of a generation; None if it is not one of the last two."""
        places = [place for place, (its, size) in enumerate(self.said.tolist()) if its == generation and size > 0]
        return self.message(places[0]) if places else None
