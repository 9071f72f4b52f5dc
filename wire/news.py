"""What nodes and the spy publish for any subscriber: verified improvements, counters, statistics, and log records."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from wire.plain import plain
from wire.strict import Rejected, count, fields, fitness, of, pack, table, unpack

_LATEST = 1e11  # Unix time, seconds (the year 5138): a later time is an error, such as milliseconds

MOST_REPORTS_PER_SECOND = 256
"""The most counters that all nodes of a cluster together send in a second, so that large clusters do not flood the spy.

No display needs more.
"""

_AT_ONCE = 1 << 12  # nodes' counters in one message; keeps it below the limits of `wire.strict`

LEVELS = ("info", "warning", "error")
"""The levels of log records, in the order of importance."""


@dataclass(frozen=True)
class Improvement:
    """A champion that the spy has evaluated itself, and decoded.

    Attributes:
        job: the job's number.
        epoch: the epoch of the job whose problem it answers.
        seconds: the time since that epoch began.
        generation: the generation of birth, in that epoch.
        cell: the cell of birth.
        fitness: lower is better.
        feasible: whether the planner's independent check accepts the solution.
        solution: plain JSON values; the planner's page describes them.
    """

    job: int
    epoch: int
    seconds: float
    generation: int
    cell: int
    fitness: float
    feasible: bool
    solution: dict[str, Any]

    @property
    def order(self) -> tuple[int, float]:
        """The key by which a job's improvements grow: within an epoch each is fitter than those before."""
        return self.epoch, -self.fitness

    def carried_to(self, epoch: int) -> "Improvement":
        """Return the same answer for a later epoch of the same problem, in which it is known from the beginning."""
        return self if epoch == self.epoch else replace(self, epoch=epoch, seconds=0.0, generation=0)

    def encode(self) -> bytes:
        """Return the improvement as msgpack, with the solution as JSON text: null for numbers that are not finite."""
        solution = json.dumps(plain(self.solution))
        place = (self.job, self.epoch, self.seconds, self.generation, self.cell)
        return pack((*place, self.fitness, self.feasible, solution))

    @staticmethod
    def decode(payload: bytes) -> "Improvement":
        """Return the improvement in ``payload``, the inverse of `encode`.

        Raises:
            Rejected: if the payload is not a valid improvement.
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
    """One node's counters for its present job, and the state of its deme.

    Attributes:
        node: the node's number.
        cell: the cell that the node has in the job.
        job: the job's number.
        epoch: the job's epoch.
        generation: the generations bred in the job, those of earlier epochs included.
        evaluations: fitness calls in this epoch.
        sent: messages published in this epoch.
        received: messages received and used.
        lost: messages known not to have arrived; in lockstep those that only a neighbour's answer to a question has
            brought so far.
        rejected: messages refused as invalid.
        best, median, worst: fitness of the individuals of the deme; infinite for infeasible ones.
        champion: fitness of the best individual that the node knows of.
        age: generations since the champion's birth.
        digest: a 32-bit digest of the best genome of the deme, by which equal genomes are recognised.
        exchange_seconds: the average time from one message of the node to its next, since it last sent counters. In
            lockstep this is the wait for all neighbours' messages and the breeding, in async mode the breeding. If the
            node has sent no message since, it is the time since then, a lower bound.
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
        """Return the counters as msgpack."""
        return pack(self)

    @staticmethod
    def decode(payload: bytes) -> "Counters":
        """Return the counters in ``payload``, the inverse of `encode`.

        Raises:
            Rejected: if the payload is not valid counters.
        """
        return Counters._of(unpack(payload))

    @staticmethod
    def encode_all(counters: "Iterable[Counters]") -> "Iterator[bytes]":
        """Yield messages that together hold the counters of many nodes."""
        those = list(counters)
        for first in range(0, len(those), _AT_ONCE):
            yield pack(those[first : first + _AT_ONCE])

    @staticmethod
    def decode_all(payload: bytes) -> "list[Counters]":
        """Return the counters in one message of `encode_all`.

        Raises:
            Rejected: if the payload is not valid counters.
        """
        return [Counters._of(each) for each in unpack(payload)]

    @staticmethod
    def _of(values: object) -> "Counters":
        given = fields(values, 17)
        of_deme = (fitness(each) for each in given[10:14])
        return Counters._make((*map(count, given[:10]), *of_deme, *map(count, given[14:16]), fitness(given[16])))


class Statistics(NamedTuple):
    """The counters of all nodes of a job, put together by the spy: sums over nodes unless noted otherwise.

    Attributes:
        job: the job's number.
        epoch: the job's epoch.
        generation: the root's generation.
        messages: messages published.
        received: messages received and used.
        nodes_alive: the number of nodes that the spy sees alive.
        best, worst: fitness of the best and of the worst individual on any node.
        median: the median of the nodes' medians.
        age: generations since the birth of the root's champion.
        diversity: the number of different genomes among the nodes' best ones, as a share of the nodes.
        exchange_seconds: the median of the nodes' values; see `Counters`.
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
        """Return the statistics as msgpack."""
        return pack(self)

    @staticmethod
    def decode(payload: bytes) -> "Statistics":
        """Return the statistics in ``payload``, the inverse of `encode`.

        Raises:
            Rejected: if the payload is not valid statistics.
        """
        given = fields(unpack(payload), 16)
        of_demes = (fitness(each) for each in given[9:13])
        return Statistics._make((*map(count, given[:9]), *of_demes, count(given[13]), *map(fitness, given[14:])))


class LogRecord(NamedTuple):
    """A line of a process's log, for people.

    Attributes:
        level: one of `LEVELS`.
        process: such as "node 7", "spy" or "coordinator".
        text: the message.
        at: Unix time, seconds.
        node, cell, job, generation: what the message is about, each None if it is about no particular one; ``job`` is
            the job's number.
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
        """Return the record as msgpack."""
        return pack(self)

    @staticmethod
    def decode(payload: bytes) -> "LogRecord":
        """Return the record in ``payload``, the inverse of `encode`.

        Raises:
            Rejected: if the payload is not a valid record.
        """
        level, process, text, at, *about = fields(unpack(payload), 8)
        if level not in LEVELS:
            raise Rejected("no such level")
        if not 0.0 <= fitness(at) < _LATEST:
            raise Rejected("no such time")
        places = (None if each is None else count(each) for each in about)
        return LogRecord(level, of(str, process), of(str, text), fitness(at), *places)


def period_of_reports(nodes: int) -> float:
    """Return how many seconds each of ``nodes`` nodes waits between sending counters; at least 1."""
    return max(1.0, nodes / MOST_REPORTS_PER_SECOND)
