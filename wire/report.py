"""What a cell says when it has stopped."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

from wire.exchange import Champion
from wire.strict import Rejected, count, fields, fitness, of, pack, unpack

Reason = Literal["target", "stall", "deadline", "cancel", "update", "infeasible"]


class Proposal(NamedTuple):
    """That a cell proposed that all stop after generation ``stop_at``."""

    stop_at: int
    reason: Reason
    cell: int
    generation: int


MOST_BIRTHS = 1024
"""In the report of one cell."""


class Birth(NamedTuple):
    """The birth of an individual that was better than all that its cell had seen or heard of.

    Under the paper's spy, which looks at the root alone, the root tells of those that it learned of, wherever born.

    Attributes:
        generation: of it, in this epoch.
        cell: of it.
    """

    generation: int
    cell: int
    fitness: float


class Staleness(NamedTuple):
    """How old the news was that an asynchronous cell bred with.

    Attributes:
        immigrants: how many it bred with, slot by slot.
        behind: the sum of the generations that they were behind the cell's own.
        furthest: the most that one was behind.
        again: how many came with a message that had been used before.
    """

    immigrants: int
    behind: int
    furthest: int
    again: int


@dataclass(frozen=True)
class Report:
    """What a cell has to say of its life when it stops.

    Attributes:
        generation: after which it stopped.
        digest: SHA-256 over (generation, deme) of each of its generations.
        staleness: zeros in lockstep.
        champion: the best that it has seen or heard of.
        proposals: the stops that it proposed.
        births: the improvements that it noted, in the order of its generations, each fitter than the one before; at
            most `MOST_BIRTHS`.
        deme: its last individuals, each of them whole, one after the other.
        state: what its problem has to say of the state that evaluating left, see `problems.problem.Problem.report`.
        error: why it failed, or None.
    """

    cell: int
    generation: int
    digest: bytes
    evaluations: int
    sent: int
    received: int
    lost: int
    rejected: int
    staleness: Staleness
    champion: Champion | None
    proposals: tuple[Proposal, ...]
    births: tuple[Birth, ...]
    deme: bytes
    state: bytes
    error: str | None

    def encode(self) -> bytes:
        """As msgpack."""
        return pack(tuple(getattr(self, field.name) for field in dataclasses.fields(self)))

    @staticmethod
    def decode(payload: bytes) -> "Report":
        """The inverse of `encode`.

        Raises:
            Rejected: whatever is wrong with it.
        """
        cell, generation, digest, *counters, staleness, champion, proposals, births, deme, state, error = fields(
            unpack(payload), 15
        )
        evaluations, sent, received, lost, rejected = (count(each) for each in counters)
        return Report(
            count(cell),
            count(generation),
            of(bytes, digest),
            evaluations,
            sent,
            received,
            lost,
            rejected,
            Staleness(*(count(each) for each in fields(staleness, len(Staleness._fields)))),
            None if champion is None else Champion.of(champion),
            tuple(_proposal(each) for each in of(list, proposals)),
            _births(births),
            of(bytes, deme),
            of(bytes, state),
            None if error is None else of(str, error),
        )


def _proposal(value: object) -> Proposal:
    stop_at, reason, cell, generation = fields(value, 4)
    return Proposal(count(stop_at), reason_of(reason), count(cell), count(generation))


def _births(value: object) -> tuple[Birth, ...]:
    births = tuple(_birth(each) for each in of(list, value))
    if len(births) > MOST_BIRTHS:
        raise Rejected("out of bounds")
    return births


def _birth(value: object) -> Birth:
    generation, cell, its_fitness = fields(value, 3)
    if fitness(its_fitness) == math.inf:
        raise Rejected("not finite")
    return Birth(count(generation), count(cell), its_fitness)


def reason_of(value: object) -> Reason:
    """``value`` if it is one of the reasons to stop."""
    for reason in get_args(Reason):
        if value == reason:
            known: Reason = reason
            return known
    raise Rejected("no such reason")
