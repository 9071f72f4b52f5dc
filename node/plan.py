"""The plan of an epoch: everything about a job that all its cells must understand in the same way."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

import topologies
from genetics.arrays import Cells, Evaluate, Genomes
from genetics.coding import Coding, Keys
from genetics.recipe import Recipe, evaluations_per_generation
from node.engine.state_size import most_state_bytes, state_bytes
from problems import Problem, ProblemFile, Run
from problems.guard import guarded, next_attempt, solved_at, solved_when
from problems.run import DEFAULT_RESTARTS, DEFAULT_STALL
from topologies import Topology
from wire.limits import Limits

_GOLDEN = 0x9E3779B97F4A7C15  # 2^64 divided by the golden ratio: multiples of it are spread evenly


class Guard(Protocol):
    """Calls a problem's `evaluate` so that no individual can do harm."""

    @property
    def infeasible(self) -> tuple[tuple[str, bytes], ...]:
        """The job's genomes that count as infeasible without being evaluated, each with the digest of its problem."""

    def counts_as_infeasible(self, genome: bytes) -> bool:
        """Return whether a genome does so in the plan's problem."""

    def guard(self, problem: Problem) -> Evaluate:
        """Return the problem's fitness function, which raises `EvaluationFailed` for any wrong result."""


@dataclass(frozen=True)
class Plan:
    """The plan of an epoch of a job: the problem, how it is bred, which cells are neighbours, and when it ends.

    Attributes:
        problem: the problem to solve.
        run: the settings of the run.
        epoch: the epoch's number in the job, from 0.
        since: generations of the job before this epoch.
        attempt: how often the job had been restarted by then, since the problem was last changed.
        protection: protects this process from individuals that would kill it; None for none.
    """

    problem: Problem
    run: Run
    epoch: int = 0
    since: int = 0
    attempt: int = 0
    protection: Guard | None = None

    @staticmethod
    def of(
        file: ProblemFile,
        epoch: int = 0,
        since: int = 0,
        *,
        checked: bool = False,
        protection: Guard | None = None,
    ) -> "Plan":
        """Return the plan of a problem file; if the problem is a user's own, this imports its module.

        If another process has ``checked`` the file, checks that take long are skipped.

        Raises:
            BadInput: if the problem file is wrong.
        """
        plan = Plan(file.problem(checked=checked), file.run, epoch, since, file.attempt, protection)
        _ = plan.target, plan.next_attempt  # calls a user's own code, so that its errors are reported now
        return plan

    @cached_property
    def topology(self) -> Topology:
        """The neighbours of each cell."""
        return topologies.parse(self.run.topology)

    @cached_property
    def slots(self) -> int:
        """The number of slots of each cell; a neighbour may fill several."""
        return len(self.topology.neighbours(0))

    @cached_property
    def coding(self) -> Coding:
        """The coding of individuals as genomes."""
        return self.problem.coding

    @cached_property
    def recipe(self) -> Recipe:
        """How individuals breed.

        Raises:
            ValueError: if the recipe does not suit the problem's coding.
        """
        recipe = self.run.breeding(self.problem)
        self.coding.check(recipe)
        return recipe

    def keys(self, cells: Cells, generation: int) -> Keys:
        """Return the keys of the random draws of some cells in a generation."""
        return Keys(cells, self.seed, generation)

    @cached_property
    def seed(self) -> np.uint64:
        """The seed of this epoch. Each epoch counts generations from 0, and must not repeat another one's draws."""
        return seed_of(self.run, self.epoch)

    def deme_of(self, genomes: bytes) -> Genomes:
        """Return the individuals whose genomes follow one another in ``genomes``, shape (deme, genome_bytes)."""
        return np.frombuffer(genomes, np.uint8).reshape(self.run.deme, self.coding.genome_bytes)

    @cached_property
    def evaluate(self) -> Evaluate:
        """The problem's fitness function, which raises `EvaluationFailed` for any wrong result."""
        return self.guarded(self.problem)

    def guarded(self, problem: Problem) -> Evaluate:
        """Return the fitness function of the problem, or of its copy for one cell, as this process should call it."""
        return guarded(problem) if self.protection is None else self.protection.guard(problem)

    @property
    def infeasible(self) -> tuple[tuple[str, bytes], ...]:
        """See `Guard.infeasible`."""
        return () if self.protection is None else self.protection.infeasible

    @cached_property
    def target(self) -> float | None:
        """The fitness that ends the run once it is reached; None if there is none."""
        return solved_at(self.problem) if self.run.target is None else self.run.target

    @property
    def solved_when(self) -> str | None:
        """The meaning of the target in words, or why there is none."""
        return solved_when(self.problem) if self.run.target is None else "as asked for"

    @cached_property
    def last_generation(self) -> int | None:
        """The generation after which every cell stops by itself, counted from this epoch's beginning; None if none."""
        last = self.run.last_generation(self.recipe, self.epoch + 1)
        return None if last is None else max(0, last - self.since)

    @cached_property
    def next_attempt(self) -> dict[str, Any] | None:
        """The fields to change for another attempt if this one stalls without an answer; None if it is the last one.

        A job that is kept alive is restarted without limit. Otherwise the setting ``restarts`` decides. Without that, a
        run with a target is restarted as often as the problem proposes, at most `DEFAULT_RESTARTS` times unless another
        limit ends the run.
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
        """Generations without a better champion after which the root proposes a stop; None if a stall ends nothing.

        In a run with another limit the default stall ends an attempt, but never the last one.
        """
        given = self.run.stall_limit()
        seeks = self.target is not None or bool(self.run.restarts)
        return DEFAULT_STALL if given is None and seeks and self.next_attempt is not None else given

    def leaves_room(self, lived: int) -> bool:
        """Return whether the limits leave a generation to another epoch, after ``lived`` generations of the job."""
        last = self.run.last_generation(self.recipe, self.epoch + 2)
        return last is None or last > lived

    @cached_property
    def stop_distance(self) -> int:
        """Generations between the proposal of a stop and the stop: by then every cell knows of it.

        A proposal leaves with the next exchange, at most one interval away, and crosses a link at each exchange.
        """
        return (self.topology.diameter + 1) * self.run.interval

    @cached_property
    def limits(self) -> Limits:
        """What a message of this job may contain."""
        coding = self.coding
        most = most_state_bytes(self.state_bytes)
        return Limits(coding.genome_bytes, self.run.emigrants, self.topology.cells, coding.alphabet, most)

    @cached_property
    def state_bytes(self) -> int:
        """The bytes of a cell's state without improvements, see `node.engine.state`; 0 if states are not kept."""
        return state_bytes(self.run.deme, self.coding.genome_bytes, self.run.emigrants)

    @cached_property
    def evaluations_per_generation(self) -> int:
        """Fitness calls of one cell in one generation."""
        return evaluations_per_generation(self.run.deme, self.slots, self.recipe)


def seed_of(run: Run, epoch: int) -> np.uint64:
    """Return the seed of an epoch; a separate run with that seed draws the same numbers in its first epoch."""
    return np.uint64((run.seed + epoch * _GOLDEN) % (1 << 64))


def retry(file: ProblemFile, epoch: int, fields: dict[str, Any]) -> dict[str, Any]:
    """Return the directive of a restart: the attempt of ``file`` in that epoch, for which ``fields`` were changed.

    A separate run with the directive's seed and fields breeds the same individuals.
    """
    return {"do": "retry", "attempt": file.attempt, "seed": int(seed_of(file.run, epoch)), "fields": fields}
