"""What the spy and the nodes tell anyone who listens: verified improvements, and counters."""

import json
from dataclasses import dataclass
from typing import Any, NamedTuple

from wire.plain import plain
from wire.strict import Rejected, count, fields, fitness, of, pack, unpack


@dataclass(frozen=True)
class Improvement:
    """A champion that the spy has evaluated itself.

    Attributes:
        world: of the job, that it is an answer for.
        seconds: since that world began.
        generation: of its birth, in that world.
        cell: where it was born.
        fitness: lower is better.
        feasible: whether the planner's independent check accepts the solution.
        solution: decoded, plain JSON values; see the planner's page.
    """

    job: int
    world: int
    seconds: float
    generation: int
    cell: int
    fitness: float
    feasible: bool
    solution: dict[str, Any]

    def encode(self) -> bytes:
        """As msgpack, the solution as JSON, which has null for numbers that are not finite."""
        solution = json.dumps(plain(self.solution))
        place = (self.job, self.world, self.seconds, self.generation, self.cell)
        return pack((*place, self.fitness, self.feasible, solution))

    @staticmethod
    def decode(payload: bytes) -> "Improvement":
        """The inverse of `encode`.

        Raises:
            Rejected: whatever is wrong with it.
        """
        job, world, seconds, generation, cell, its_fitness, feasible, solution = fields(unpack(payload), 8)
        return Improvement(
            count(job),
            count(world),
            fitness(seconds),
            count(generation),
            count(cell),
            fitness(its_fitness),
            of(bool, feasible),
            _table(solution),
        )


class Counters(NamedTuple):
    """One node's counters for the job that it is at."""

    node: int
    cell: int
    job: int
    world: int
    generation: int
    evaluations: int
    sent: int
    received: int
    lost: int
    rejected: int

    def encode(self) -> bytes:
        """As msgpack."""
        return pack(self)

    @staticmethod
    def decode(payload: bytes) -> "Counters":
        """The inverse of `encode`.

        Raises:
            Rejected: whatever is wrong with it.
        """
        return Counters(*(count(each) for each in fields(unpack(payload), 10)))


class Statistics(NamedTuple):
    """The whole cluster's counters, as the spy adds them up: sums over nodes, the root's generation."""

    job: int
    generation: int
    evaluations: int
    messages: int
    lost: int
    rejected: int
    nodes_alive: int
    messages_per_second: float

    def encode(self) -> bytes:
        """As msgpack."""
        return pack(self)

    @staticmethod
    def decode(payload: bytes) -> "Statistics":
        """The inverse of `encode`.

        Raises:
            Rejected: whatever is wrong with it.
        """
        *counts, rate = fields(unpack(payload), 8)
        return Statistics._make([*(count(each) for each in counts), fitness(rate)])


class LogRecord(NamedTuple):
    """What a process wants people to know."""

    level: str
    node: int
    text: str

    def encode(self) -> bytes:
        """As msgpack."""
        return pack(self)

    @staticmethod
    def decode(payload: bytes) -> "LogRecord":
        """The inverse of `encode`.

        Raises:
            Rejected: whatever is wrong with it.
        """
        level, node, text = fields(unpack(payload), 3)
        return LogRecord(of(str, level), count(node), of(str, text))


def _table(value: object) -> dict[str, Any]:
    """The JSON object in ``value``."""
    try:
        table = json.loads(of(str, value), parse_constant=_no_json)
    except Rejected:
        raise
    except (ValueError, RecursionError) as error:
        raise Rejected("not JSON") from error
    return of(dict, table)


def _no_json(word: str) -> None:
    raise ValueError(f"JSON has no {word}")
