"""The life of some rows of cells from generation to generation: breeding, champions and the agreement to stop.

A node holds one row, the simulator one for each cell of the torus; the code is the same, and all of it is arrays and
arithmetic. It knows nothing of messages: what neighbours said comes in as `Packets`, gathered by whoever drives it.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from genetics import Cells, Fitness, Genomes, Keys
from genetics.breeding import breed
from genetics.selection import best
from node.kernels import believe, greet
from node.plan import Plan
from topologies import ROOT
from wire.report import Proposal, Reason

NEVER = 1 << 62
"""The generation of a stop that nobody has proposed."""


class Packets(NamedTuple):
    """What cells tell their neighbours in an exchange.

    The leading shape is (rows,) for senders, (rows, slots) for what the rows have received from their neighbours.
    """

    emigrants: Genomes  # (..., emigrants, genome_bytes), best first
    emigrant_fitness: Fitness  # (..., emigrants)
    champion: Genomes  # (..., genome_bytes)
    champion_fitness: Fitness  # (...), totally ordered by (fitness, generation, cell)
    champion_generation: Cells  # (...)
    champion_cell: Cells  # (...)
    stop_at: Cells  # (...), NEVER if nobody proposed

    def gather(self, senders: Cells) -> "Packets":
        """The packets of ``senders``, shape (rows, slots)."""
        return Packets._make(array[senders] for array in self)


@dataclass
class Rows:
    """The demes of ``cells``, shape (rows,), all in the same generation."""

    plan: Plan
    cells: Cells
    generation: int = 0
    proposals: list[Proposal] = field(default_factory=list)

    genomes: Genomes = field(init=False)  # (rows, deme, genome_bytes)
    fitness: Fitness = field(init=False)  # (rows, deme)
    champion: Genomes = field(init=False)  # (rows, genome_bytes): the best each row has seen or heard of,
    champion_fitness: Fitness = field(init=False)  # (rows,) its fitness,
    champion_generation: Cells = field(init=False)  # (rows,) when it was born,
    champion_cell: Cells = field(init=False)  # (rows,) and where
    stop_at: Cells = field(init=False)  # (rows,): the least each row has heard of
    better_at: Cells = field(init=False)  # (rows,): when its champion last became better

    def __post_init__(self) -> None:
        rows, plan = len(self.cells), self.plan
        self.limit = NEVER if plan.last_generation is None else plan.last_generation
        self.stop_at = np.full(rows, self.limit)
        self.better_at = np.zeros(rows, np.int64)
        self.champion = np.zeros((rows, plan.coding.genome_bytes), np.uint8)
        self.champion_fitness = np.full(rows, np.inf)
        self.champion_generation = np.full(rows, NEVER)
        self.champion_cell = self.cells.copy()
        self._immigrants: tuple[Genomes, Fitness] | None = None
        self._homing = self._find_homing()

    @property
    def evaluations(self) -> int:
        """Fitness calls of one row so far."""
        return self.plan.run.deme + self.generation * self.plan.evaluations_per_generation

    @property
    def exchanging(self) -> bool:
        """Whether emigrants leave in this generation."""
        return self.generation % self.plan.run.interval == 0

    def begin(self) -> None:
        """Draw and evaluate the first demes (§6, steps 1 and 2)."""
        plan = self.plan
        keys = Keys(self.cells, plan.run.seed, 0)
        self.genomes = plan.coding.random(keys, plan.run.deme)
        flat = self.genomes.reshape(-1, plan.coding.genome_bytes)
        self.fitness = self._evaluate(flat).reshape(len(self.cells), plan.run.deme)
        self._note_births()
        self._propose()

    def packets(self) -> Packets:
        """What each row tells its neighbours now; shapes (rows, ...).

        Under the paper's spy champions do not travel, only emigrants: what a neighbour sends is all that one hears of.
        """
        chosen = best(self.fitness, self.plan.run.emigrants)
        rows = np.arange(len(self.cells))[:, None]
        emigrants, fitness = self.genomes[rows, chosen], self.fitness[rows, chosen]
        if self.plan.run.spy == "root":
            born = np.full(len(self.cells), self.generation)
            champion = (emigrants[:, 0], fitness[:, 0], born, self.cells)
        else:
            champion = (self.champion, self.champion_fitness, self.champion_generation, self.champion_cell)
        return Packets(emigrants, fitness, *champion, self.stop_at)

    def advance(self, received: Packets | None) -> None:
        """Take what the neighbours said (None in a generation without exchange) and breed the next generation.

        Between exchanges an individual that lives alone breeds with the immigrants that it had last.
        """
        plan = self.plan
        if received is not None:
            self._hear(received)
        self.generation += 1
        alone = plan.run.deme == 1
        breed(
            self.genomes,
            self.fitness,
            self._immigrants if alone or received is not None else None,
            plan.coding,
            plan.recipe,
            self._evaluate,
            Keys(self.cells, plan.run.seed, self.generation),
        )
        self._note_births()
        self._propose()

    def propose(self, row: int, reason: Reason) -> None:
        """Let one row propose that all cells stop, as soon as all can have heard of it."""
        stop_at = self.generation + self.plan.stop_distance
        if stop_at < self.stop_at[row]:
            self.stop_at[row] = stop_at
            self.proposals.append(Proposal(stop_at, reason, int(self.cells[row]), self.generation))

    def _evaluate(self, genomes: Genomes) -> Fitness:
        """All rows at once only where that cannot change a bit: a row alone is what a node evaluates."""
        rows = len(self.cells)
        if rows == 1 or self.plan.problem.batches_alike:
            return self.plan.evaluate(genomes)
        return np.concatenate([self.plan.evaluate(part) for part in np.split(genomes, rows)])

    def _find_homing(self) -> NDArray[np.bool_] | None:
        """Which slots, (rows, slots, 1), name the cell itself: an island must not be flooded with its own best.

        An individual alone does breed with itself there; it has nobody else.
        """
        if self.plan.run.deme == 1:
            return None
        slots = np.array([self.plan.topology.neighbours(int(cell)) for cell in self.cells])
        homing = slots == self.cells[:, None]
        return homing[:, :, None] if homing.any() else None

    def _hear(self, received: Packets) -> None:
        rows, slots, emigrants = received.emigrant_fitness.shape
        fitness = received.emigrant_fitness
        if self._homing is not None:
            fitness = np.where(self._homing, np.inf, fitness)
        self._immigrants = (
            received.emigrants.reshape(rows, slots * emigrants, -1),
            fitness.reshape(rows, slots * emigrants),
        )
        believe(
            self.champion,
            self.champion_fitness,
            self.champion_generation,
            self.champion_cell,
            self.stop_at,
            self.better_at,
            self.generation + 1,
            *received[2:],
        )

    def _note_births(self) -> None:
        greet(
            self.genomes,
            self.fitness,
            self.cells,
            self.generation,
            self.champion,
            self.champion_fitness,
            self.champion_generation,
            self.champion_cell,
            self.better_at,
        )

    def _propose(self) -> None:
        """The proposals that cells make by themselves.

        For the target it is the cell that bred the individual, for stall the root. The paper's spy (``spy = "root"``)
        knows only what has come past the root, so there the root proposes for the target too.
        """
        run, target = self.plan.run, self.plan.target
        if target is not None:
            reached = self.champion_fitness <= target
            if run.spy == "root":
                reached &= self.cells == ROOT
            else:
                reached &= (self.champion_generation == self.generation) & (self.champion_cell == self.cells)
            for row in np.flatnonzero(reached):
                self.propose(int(row), "target")
        stall = run.stall_limit()
        if stall is not None and self.cells[0] == ROOT and self.generation - self.better_at[0] >= stall:
            self.propose(0, "stall")
