"""A job as every cell must understand it in the same way."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import topologies
from genetics.arrays import Cells, Evaluate, Genomes
from genetics.coding import Coding, Keys
from genetics.recipe import Recipe, evaluations_per_generation
from problems import Problem, ProblemFile, Run
from problems.guard import guarded, next_attempt, solved_at, solved_when
from problems.run import DEFAULT_RESTARTS, DEFAULT_STALL
from topologies import Topology
from wire.exchange import Limits

_GOLDEN = 0x9E3779B97F4A7C15  # 2^64 divided by the golden ratio: multiples of it are spread evenly


@dataclass(frozen=True)
class Plan:
    """What is to be solved, how it is bred, who neighbours whom and when it ends.

    Attributes:
        epoch: its number in the row of epochs that a job lives in.
        since: generations that the job had lived through when this epoch began.
        attempt: how often it had begun anew by then, since the problem was last changed.

    Raises:
        BadInput: from `of`, if the problem file is wrong.
    """

    problem: Problem
    run: Run
    epoch: int = 0
    since: int = 0
    attempt: int = 0

    @staticmethod
    def of(file: ProblemFile, epoch: int = 0, since: int = 0, *, checked: bool = False) -> "Plan":
        """The plan of a problem file, which another process has ``checked`` or not; this imports a user's module."""
        plan = Plan(file.problem(checked=checked), file.run, epoch, since, file.attempt)
        _ = plan.target, plan.next_attempt  # asks a user's problem, so that a wrong answer is found now
        return plan

    @cached_property
    def topology(self) -> Topology:
        """Who neighbours whom."""
        return topologies.parse(self.run.topology)

    @cached_property
    def slots(self) -> int:
        """The number of neighbours of each cell, repeats counted."""
        return len(self.topology.neighbours(0))

    @cached_property
    def coding(self) -> Coding:
        """How individuals are coded."""
        return self.problem.coding

    @cached_property
    def recipe(self) -> Recipe:
        """How they breed."""
        recipe = self.run.breeding(self.problem)
        self.coding.check(recipe)
        return recipe

    def keys(self, cells: Cells, generation: int) -> Keys:
        """What the random draws of some cells in a generation are keyed by."""
        return Keys(cells, self.seed, generation)

    @cached_property
    def seed(self) -> np.uint64:
        """Of this epoch: generations count from 0 in each, and are to draw other numbers in another."""
        return seed_of(self.run, self.epoch)

    def deme_of(self, genomes: bytes) -> Genomes:
        """The individuals that lie one after another in ``genomes``, shape (deme, genome_bytes)."""
        return np.frombuffer(genomes, np.uint8).reshape(self.run.deme, self.coding.genome_bytes)

    @cached_property
    def evaluate(self) -> Evaluate:
        """The problem's fitness, guarded."""
        return guarded(self.problem)

    @cached_property
    def target(self) -> float | None:
        """A fitness that ends the run."""
        return solved_at(self.problem) if self.run.target is None else self.run.target

    @property
    def solved_when(self) -> str | None:
        """What the target means, in words, or why there is none."""
        return solved_when(self.problem) if self.run.target is None else "as asked for"

    @cached_property
    def last_generation(self) -> int | None:
        """Where every cell stops by itself, if anywhere; counted from this epoch's beginning."""
        last = self.run.last_generation(self.recipe, self.epoch + 1)
        return None if last is None else max(0, last - self.since)

    @cached_property
    def next_attempt(self) -> dict[str, Any] | None:
        """The fields to change for another attempt, if this one stalls without an answer; None if there will be none.

        A job that is kept alive is tried for as long as it takes.
        """
        run, number = self.run, self.attempt + 1
        if run.keep_alive:
            return next_attempt(self.problem, number) or {}
        if run.restarts is not None:
            return (next_attempt(self.problem, number) or {}) if number <= run.restarts else None
        if self.target is None or (number > DEFAULT_RESTARTS and not run.is_limited):
            return None
        return next_attempt(self.problem, number)

    @cached_property
    def stall(self) -> int | None:
        """Generations without a better champion after which the root proposes to stop, if that is to happen.

        Where something else limits the run, a stall ends an attempt, but never the last one.
        """
        given = self.run.stall_limit()
        seeks = self.target is not None or bool(self.run.restarts)
        return DEFAULT_STALL if given is None and seeks and self.next_attempt is not None else given

    def leaves_room(self, lived: int) -> bool:
        """Whether the limits leave another epoch a generation, when the job has ``lived`` through so many."""
        last = self.run.last_generation(self.recipe, self.epoch + 2)
        return last is None or last > lived

    @cached_property
    def stop_distance(self) -> int:
        """Generations between the proposal of a stop and the stop: by then every cell has heard of it.

        A proposal leaves with the next exchange, at most one interval away, and crosses a link at each exchange.
        """
        return (self.topology.diameter + 1) * self.run.interval

    @cached_property
    def limits(self) -> Limits:
        """What a message of this job may hold."""
        coding = self.coding
        return Limits(coding.genome_bytes, self.run.emigrants, self.topology.cells, coding.alphabet)

    @cached_property
    def evaluations_per_generation(self) -> int:
        """By one cell."""
        return evaluations_per_generation(self.run.deme, self.slots, self.recipe)


def seed_of(run: Run, epoch: int) -> np.uint64:
    """The seed of an epoch: a run of its own with that seed draws the same numbers in its first one."""
    return np.uint64((run.seed + epoch * _GOLDEN) % (1 << 64))


def retry(file: ProblemFile, epoch: int, fields: dict[str, Any]) -> dict[str, Any]:
    """The directive of the attempt at ``file`` in the epoch of that number, which has changed ``fields``.

    A run of its own that has the seed it says, and those fields, is the same.
    """
    return {"do": "retry", "attempt": file.attempt, "seed": int(seed_of(file.run, epoch)), "fields": fields}
