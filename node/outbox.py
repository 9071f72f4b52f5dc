"""The last two messages of a cell, for neighbours that miss one: in lockstep nobody is further behind."""

from collections.abc import Callable

import numpy as np

from genetics import Genomes


class Outbox:
    """Room for two messages; each is in the place that its number is even or odd for.

    Attributes:
        room: shape (2, bytes).
        said: of which generation each message is, and how many bytes it has, shape (2, 2).
    """

    def __init__(self, most_bytes: int) -> None:
        self.room = np.empty((2, most_bytes), np.uint8)
        self.said = np.zeros((2, 2), np.int64)
        self._room = tuple(each.data for each in self.room)  # of an array each slice costs as much as a message

    def write(self, number: int, generation: int, encode: Callable[[Genomes], bytes]) -> bytes:
        """Put a message there: ``encode`` writes it into the room that it is given."""
        place = number % 2
        payload = encode(self.room[place])
        self.said[place] = generation, len(payload)
        return payload

    def message(self, number: int) -> bytes:
        """One of the last two, by its number."""
        place = number % 2
        return self._room[place][: self.said.item(place, 1)].tobytes()

    def of(self, generation: int) -> bytes | None:
        """The message of a generation, if it is one of the last two."""
        places = [place for place, (its, size) in enumerate(self.said.tolist()) if its == generation and size > 0]
        return self.message(places[0]) if places else None
