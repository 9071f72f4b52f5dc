"""Messages by which another process takes a dead one's place, bit for bit."""

from dataclasses import dataclass
from typing import NamedTuple

from wire.strict import count, fields, of


class Takeover(NamedTuple):
    """The state from which a process goes on in a dead one's place.

    Attributes:
        reached: a generation that the dead process has not gone beyond.
        state: the state to go on from (`node.engine.state`); empty to begin the epoch once more.
        others_wait: whether other cells are in the epoch already, and wait for this one.
        stop_at: the generation after which others will stop, if they know one: perhaps the dead ones alone had told it.
    """

    reached: int
    state: bytes
    others_wait: bool = True
    stop_at: int | None = None

    @staticmethod
    def of(value: object) -> "Takeover | None":
        """Return the takeover in an unpacked command; None if there is none.

        Raises:
            Rejected: if ``value`` is not a valid one.
        """
        if value is None:
            return None
        reached, state, others_wait, stop_at = fields(value, 4)
        return Takeover(count(reached), of(bytes, state), of(bool, others_wait), _count_or_none(stop_at))


@dataclass(frozen=True)
class KeptStates:
    """A cell's answer to `wire.control.TellStates`.

    Attributes:
        cell: the cell.
        generation: the generation that it is in.
        oldest: the generation of the oldest message that it can send again.
        states: for each state its cell, its generation, and the state as bytes.
        heard: in lockstep, for each neighbour its cell and the generation up to which all its messages have come.
        stop_at: the generation after which it will stop, if it knows one or has been told of one.
    """

    cell: int
    generation: int
    oldest: int
    states: tuple[tuple[int, int, bytes], ...]
    heard: tuple[tuple[int, int], ...]
    stop_at: int | None

    @staticmethod
    def of(values: object) -> "KeptStates":
        """Return the answer with these fields, unpacked.

        Raises:
            Rejected: if they are no valid answer.
        """
        cell, generation, oldest, states, heard, stop_at = fields(values, 6)
        found = [fields(each, 3) for each in of(list, states)]
        kept = tuple((count(whose), count(its), of(bytes, state)) for whose, its, state in found)
        pairs = [fields(each, 2) for each in of(list, heard)]
        come = tuple((count(whose), count(its)) for whose, its in pairs)
        place = count(cell), count(generation), count(oldest)
        return KeptStates(*place, kept, come, _count_or_none(stop_at))


def _count_or_none(value: object) -> int | None:
    return None if value is None else count(value)
