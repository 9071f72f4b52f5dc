"""What the spy and the nodes tell anyone who listens: verified improvements, and counters."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from wire.plain import plain
from wire.strict import Rejected, count, fields, fitness, of, pack, table, unpack

_LATEST = 1e11  # Unix time, seconds

MOST_REPORTS_PER_SECOND = 256
"""Of counters, over a whole cluster: nodes tell no more often, and nobody needs to show them more often."""

_AT_ONCE = 1 << 12  # counters in one message

LEVELS = ("info", "warning", "error")
"""Of log records, the less important first."""


@dataclass(frozen=True)
class Improvement:
    """A champion that the spy has evaluated itself.

    Attributes:
        epoch: of the job, that it is an answer for.
        seconds: since that epoch began.
        generation: of its birth, in that epoch.
        cell: where it was born.
        fitness: lower is better.
        feasible: whether the planner's independent check accepts the solution.
        solution: decoded, plain JSON values; see the planner's page.
    """

    job: int
    epoch: int
    seconds: float
    generation: int
    cell: int
    fitness: float
    feasible: bool
    solution: dict[str, Any]

    def carried_to(self, epoch: int) -> "Improvement":
        """The same answer in a later epoch of the same problem: there it is known from the beginning."""
        return self if epoch == self.epoch else replace(self, epoch=epoch, seconds=0.0, generation=0)

    def encode(self) -> bytes:
        """As msgpack, the solution as JSON, which has null for numbers that are not finite."""
        solution = json.dumps(plain(self.solution))
        place = (self.job, self.epoch, self.seconds, self.generation, self.cell)
        return pack((*place, self.fitness, self.feasible, solution))

    @staticmethod
    def decode(payload: bytes) -> "Improvement":
        """The inverse of `encode`.

        Raises:
            Rejected: whatever is wrong with it.
        """
        job, epoch, seconds, generation, cell, its_fitness, feasible, solution = fields(unpack(payload), 8)
        return Improvement(
            count(job),
            count(epoch),
            fitness(seconds),
            count(generation),
            count(cell),
            fitness(its_fitness),
            of(bool, feasible),
            table(solution),
        )


class Counters(NamedTuple):
    """One node's counters for the job that it is at, and how its deme is.

    Attributes:
        best, median, worst: fitness of the individuals on it; infinite for those that are not feasible.
        champion: fitness of the best individual that it has seen or heard of,
        age: and generations since that was born.
        digest: of the best genome on it, so that alike ones can be told from others; 32 bits.
        exchange_seconds: from one message of its own to the next, on average since it last told: in lockstep that is
            the wait for the messages of all neighbours and the breeding, in async mode the breeding. At least that, if
            none has gone out since.
    """

    node: int
    cell: int
    job: int
    epoch: int
    generation: int
    evaluations: int
    sent: int
    received: int
    lost: int
    rejected: int
    best: float
    median: float
    worst: float
    champion: float
    age: int
    digest: int
    exchange_seconds: float

    def encode(self) -> bytes:
        """As msgpack."""
        return pack(self)

    @staticmethod
    def decode(payload: bytes) -> "Counters":
        """The inverse of `encode`.

        Raises:
            Rejected: whatever is wrong with it.
        """
        return Counters._of(unpack(payload))

    @staticmethod
    def encode_all(counters: "Iterable[Counters]") -> "Iterator[bytes]":
        """Those of many nodes, in as many messages as it takes."""
        those = list(counters)
        for first in range(0, len(those), _AT_ONCE):
            yield pack(those[first : first + _AT_ONCE])

    @staticmethod
    def decode_all(payload: bytes) -> "list[Counters]":
        """The inverse of one message of `encode_all`.

        Raises:
            Rejected: whatever is wrong with it.
        """
        return [Counters._of(each) for each in unpack(payload)]

    @staticmethod
    def _of(values: object) -> "Counters":
        given = fields(values, 17)
        of_deme = (fitness(each) for each in given[10:14])
        return Counters._make((*map(count, given[:10]), *of_deme, *map(count, given[14:16]), fitness(given[16])))


class Statistics(NamedTuple):
    """The counters of all nodes of a job, as the spy adds them up: sums over nodes, the root's generation.

    Attributes:
        epoch: of the job, that they are of.
        messages: that were sent,
        received: and that were received and used.
        best, worst: fitness of the best and of the worst individual of all.
        median: of the nodes' medians.
        age: generations since the birth of the root's champion.
        diversity: how many different genomes the nodes' best ones are, as a share of the nodes: 1 if no two are alike.
        exchange_seconds: the median of the nodes'; see `Counters`.
    """

    job: int
    epoch: int
    generation: int
    evaluations: int
    messages: int
    received: int
    lost: int
    rejected: int
    nodes_alive: int
    messages_per_second: float
    best: float
    median: float
    worst: float
    age: int
    diversity: float
    exchange_seconds: float

    def encode(self) -> bytes:
        """As msgpack."""
        return pack(self)

    @staticmethod
    def decode(payload: bytes) -> "Statistics":
        """The inverse of `encode`.

        Raises:
            Rejected: whatever is wrong with it.
        """
        given = fields(unpack(payload), 16)
        of_demes = (fitness(each) for each in given[9:13])
        return Statistics._make((*map(count, given[:9]), *of_demes, count(given[13]), *map(fitness, given[14:])))


class LogRecord(NamedTuple):
    """What a process wants people to know.

    Attributes:
        level: "info", "warning" or "error".
        process: such as "node 7", "spy" or "coordinator".
        at: Unix time, seconds.
        node, cell, job, generation: what it is about, as far as it is about one; the job by its number.
    """

    level: str
    process: str
    text: str
    at: float
    node: int | None = None
    cell: int | None = None
    job: int | None = None
    generation: int | None = None

    def encode(self) -> bytes:
        """As msgpack."""
        return pack(self)

    @staticmethod
    def decode(payload: bytes) -> "LogRecord":
        """The inverse of `encode`.

        Raises:
            Rejected: whatever is wrong with it.
        """
        level, process, text, at, *about = fields(unpack(payload), 8)
        if level not in LEVELS:
            raise Rejected("no such level")
        if not 0.0 <= fitness(at) < _LATEST:
            raise Rejected("no time of ours")
        places = (None if each is None else count(each) for each in about)
        return LogRecord(level, of(str, process), of(str, text), fitness(at), *places)


def period_of_reports(nodes: int) -> float:
    """Seconds between the counters that each of so many nodes tells."""
    return max(1.0, nodes / MOST_REPORTS_PER_SECOND)
