"""A job as every cell must understand it in the same way."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

import topologies
from genetics.arrays import Cells, Evaluate, Genomes
from genetics.coding import Coding, Keys
from genetics.recipe import Recipe, evaluations_per_generation
from problems import Problem, ProblemFile, Run
from problems.guard import guarded, solved_at
from topologies import Topology
from wire.exchange import Limits

_GOLDEN = 0x9E3779B97F4A7C15  # 2^64 divided by the golden ratio: multiples of it are spread evenly


@dataclass(frozen=True)
class Plan:
    """What is to be solved, how it is bred, who neighbours whom and when it ends.

    Attributes:
        world: its number in the row of worlds that a job lives in.
        since: generations that the job had lived through when this world began.

    Raises:
        BadInput: from `of`, if the problem file is wrong.
    """

    problem: Problem
    run: Run
    world: int = 0
    since: int = 0

    @staticmethod
    def of(file: ProblemFile, world: int = 0, since: int = 0, *, checked: bool = False) -> "Plan":
        """The plan of a problem file, which another process has ``checked`` or not; this imports a user's module."""
        plan = Plan(file.problem(checked=checked), file.run, world, since)
        _ = plan.target  # asks a user's problem, so that a wrong answer is found now
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
        """Of this world: generations count from 0 in each, and are to draw other numbers in another."""
        return np.uint64((self.run.seed + self.world * _GOLDEN) % (1 << 64))

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

    @cached_property
    def last_generation(self) -> int | None:
        """Where every cell stops by itself, if anywhere; counted from this world's beginning."""
        last = self.run.last_generation(self.recipe)
        return None if last is None else max(0, last - self.since)

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
