"""The report that a cell sends when it has stopped, and its parts."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

from wire.champion import Champion
from wire.strict import Rejected, count, fields, fitness, of, pack, unpack

Reason = Literal["target", "stall", "deadline", "cancel", "update", "infeasible"]


class Proposal(NamedTuple):
    """A cell's proposal that all cells stop after generation ``stop_at``.

    Attributes:
        reason: why.
        cell: the cell that proposed it.
        generation: the cell's generation when it did.
    """

    stop_at: int
    reason: Reason
    cell: int
    generation: int


MOST_BIRTHS = 1024
"""The most births in the report of one cell; `node.engine.kernels.is_noted` lets no cell note more."""


class Birth(NamedTuple):
    """The birth of an individual that was better than every one that its cell knew of.

    With ``--spy root`` (the paper's spy, which sees the root alone) only the root reports births: those of all
    individuals that it learned of, including individuals of other cells.

    Attributes:
        generation: the generation of birth, in this epoch.
        cell: the cell of birth.
        fitness: the individual's fitness, finite.
    """

    generation: int
    cell: int
    fitness: float


class Staleness(NamedTuple):
    """How old the messages were that an asynchronous cell bred with. All counts are zero in lockstep.

    Attributes:
        immigrants: how many messages the cell bred with, counted once for each slot and generation.
        behind: the sum, over these, of the generations that the message was behind the cell's own generation.
        furthest: the greatest of these differences.
        again: how many of the messages the cell had bred with before.
    """

    immigrants: int
    behind: int
    furthest: int
    again: int


@dataclass(frozen=True)
class Report:
    """A cell's account of one epoch, sent when the cell stops.

    Attributes:
        cell: the cell's number.
        generation: the generation after which the cell stopped.
        digest: SHA-256 over (generation, deme) of all the cell's generations; equal for equal lockstep runs.
        evaluations: the number of fitness calls.
        sent: the number of messages published.
        received: the number of messages received and used.
        lost: in async mode, the number of messages known not to have arrived.
        rejected: the number of messages that were refused as invalid.
        staleness: zeros in lockstep.
        champion: the best individual that the cell knows of, or None.
        proposals: the stops that this cell proposed.
        births: the improvements that the cell noted, in the order of its generations, each fitter than the one before;
            at most `MOST_BIRTHS`.
        deme: the cell's last individuals, at full length (with zeros at the end), one after the other.
        state: what the problem reports about the state that evaluating left, see `problems.problem.Problem.report`.
        error: why the cell failed, or None.
        infeasible: genomes that count as infeasible, since they have killed processes (`node.suspects`), each with the
            digest of its problem.
        halted: whether it was told to halt where it was, so that another epoch can begin (see `wire.control.Halt`).
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
    infeasible: tuple[tuple[str, bytes], ...] = ()
    halted: bool = False

    def encode(self) -> bytes:
        """Return the report as msgpack: an array of the fields in the order of their definition."""
        return pack(tuple(getattr(self, field.name) for field in dataclasses.fields(self)))

    @staticmethod
    def decode(payload: bytes) -> "Report":
        """Return the report in ``payload``, the inverse of `encode`.

        Raises:
            Rejected: if the payload is not a valid report.
        """
        values = fields(unpack(payload), 17)
        cell, generation, digest, *counters = values[:8]
        staleness, champion, proposals, births, deme, state, error, deadly, halted = values[8:]
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
            tuple(
                (of(str, problem), of(bytes, genome))
                for problem, genome in (fields(each, 2) for each in of(list, deadly))
            ),
            of(bool, halted),
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
    """Return ``value`` if it is one of the reasons to stop.

    Raises:
        Rejected: if it is not.
    """
    for reason in get_args(Reason):
        if value == reason:
            known: Reason = reason
            return known
    raise Rejected("no such reason")
