"""The life of some rows of cells from generation to generation: breeding, champions and the agreement to stop.

A node holds one row, the simulator one for each cell of the torus; the code is the same, and all of it is arrays and
arithmetic. It knows nothing of how messages come: what neighbours said lies in arrays, wherever they are from.
"""

from dataclasses import dataclass, field
from zlib import crc32

import numpy as np

from genetics import Cells, Fitness, Genomes
from genetics.breeding import Evaluators, breed, evaluate_all
from genetics.coding import Immigrants
from node.kernels import merge_champions, prepare_messages
from node.plan import Plan
from problems.guard import guarded
from topologies import ROOT
from wire.exchange import NEVER, Messages
from wire.exchange_kernels import BIRTHPLACE, BORN, STOP_AT
from wire.report import Birth, Proposal, Reason

MOST_TOLD = 4096
"""Rows, all of whose improvements are kept: more cells are no processes, and a million reports need the room."""


@dataclass
class Rows:
    """The demes of ``cells``, shape (rows,), all in the same generation.

    Attributes:
        problems: each row's own, if evaluating leaves a state; else all the same.
        clock: their generation, (1,), for compiled code.
        messages: the rows' own, and after them any others that there was room for. What a row knows is what it tells:
            its message holds the champion, and the least stop, that it knows.
        births: the improvements noted, generation by generation; of more than `MOST_TOLD` rows only the best of each.
        noted: of each row, see `node.kernels.is_noted`, shape (rows, 2).
    """

    plan: Plan
    cells: Cells
    messages: Messages
    proposals: list[Proposal] = field(default_factory=list)
    births: list[Birth] = field(default_factory=list)

    clock: Cells = field(init=False)  # (1,)
    genomes: Genomes = field(init=False)  # (rows, deme, genome_bytes)
    fitness: Fitness = field(init=False)  # (rows, deme)
    stop_at: Cells = field(init=False)  # (rows,): the least each row has heard of
    better_at: Cells = field(init=False)  # (rows,): when its champion last became better
    noted: Fitness = field(init=False)

    def __post_init__(self) -> None:
        rows, plan = len(self.cells), self.plan
        self.clock = np.zeros(1, np.int64)
        self.limit = NEVER if plan.last_generation is None else plan.last_generation
        self.messages.header[:rows, STOP_AT] = self.limit
        self.messages.header[:rows, BORN] = NEVER
        self.messages.header[:rows, BIRTHPLACE] = self.cells
        self.stop_at = self.messages.header[:rows, STOP_AT]
        self.better_at = np.zeros(rows, np.int64)
        self._immigrants: Immigrants | None = None
        self._reached = np.zeros(rows, np.int64)
        self.noted = np.zeros((rows, 2))
        self.noted[:, 0] = np.inf
        self._improved = np.zeros(rows + 1, np.int64)
        self.target = -np.inf if plan.target is None else plan.target
        # Under the paper's spy only what has come past the root is known, so there the root says it for all.
        self.target_reporter = ROOT if plan.run.spy == "root" else -1
        self.stall = plan.stall if self.cells[0] == ROOT else None
        # Looked up once: a node asks for these in every generation.
        self._first_evaluations, self._each_evaluations = plan.run.deme, plan.evaluations_per_generation
        self._interval, self._emigrants, self._alone = plan.run.interval, plan.run.emigrants, plan.run.deme == 1
        self._coding, self._recipe = plan.coding, plan.recipe
        self.problems = [plan.problem.for_cell() for _ in range(rows)]
        self._evaluate = self._evaluators()

    @property
    def generation(self) -> int:
        """That all rows are in."""
        return self.clock.item()

    @property
    def evaluations(self) -> int:
        """Fitness calls of one row so far."""
        return self._first_evaluations + self.generation * self._each_evaluations

    @property
    def exchanging(self) -> bool:
        """Whether emigrants leave in this generation."""
        return self.generation % self._interval == 0

    def begin(self, demes: Genomes | None = None) -> None:
        """Draw the first demes, unless they are given, (rows, deme, genome_bytes), and evaluate them (§6, 1 and 2)."""
        plan = self.plan
        self.genomes = plan.coding.random(plan.keys(self.cells, 0), plan.run.deme) if demes is None else demes.copy()
        self.fitness = evaluate_all(self.genomes, self._evaluate)
        self._tell()

    def advance(self, received: Messages | None, source_row: Cells | None = None) -> None:
        """Take what the neighbours said (None in a generation without exchange) and breed the next generation.

        ``source_row``, (rows, slots), says which message came to each slot; a slot that names the row's own number
        stands for the cell itself. Between exchanges an individual that lives alone breeds with the immigrants it had
        last.
        """
        self.clock += 1
        if received is not None:
            assert source_row is not None, "messages come from somewhere"
            merge_champions(*self.messages, self.better_at, self.generation, *received, source_row)
            self._immigrants = Immigrants(received.genomes, received.fitness, source_row, self._emigrants)
        breed(
            self.genomes,
            self.fitness,
            self._immigrants if self._alone or received is not None else None,
            self._coding,
            self._recipe,
            self._evaluate,
            self.plan.keys(self.cells, self.generation),
        )
        self._tell()

    def propose(self, row: int, reason: Reason) -> None:
        """Let one row propose that all cells stop, as soon as all can have heard of it."""
        stop_at = self.generation + self.plan.stop_distance
        if stop_at < self.stop_at[row]:
            self.stop_at[row] = stop_at
            self.note_proposal(row, reason)

    def note_proposal(self, row: int, reason: Reason) -> None:
        """Keep in mind that the row's stop is its own proposal of this generation."""
        self.proposals.append(Proposal(int(self.stop_at[row]), reason, int(self.cells[row]), self.generation))

    def vitals(self) -> tuple[float, float, float, float, int, int]:
        """How the first row's deme is, see `wire.news.Counters`; by a glance that breeding may go on beside."""
        fitness, champion = np.sort(self.fitness[0]), self.messages.champion(0)
        spread = (float(fitness[0]), float(fitness[len(fitness) // 2]), float(fitness[-1]))
        digest = crc32(self.genomes[0, self.fitness[0].argmin()])
        if champion is None:
            return *spread, np.inf, 0, digest
        return *spread, champion.fitness, max(0, self.generation - champion.generation), digest

    def _evaluators(self) -> Evaluators:
        """One for all rows, unless that would not be the same as one for each."""
        if any(each is not self.plan.problem for each in self.problems):
            return [guarded(each) for each in self.problems]
        if len(self.cells) > 1 and not self.plan.problem.batches_alike:
            return [self.plan.evaluate] * len(self.cells)
        return self.plan.evaluate

    def _tell(self) -> None:
        """Champions, emigrants and proposals."""
        reached = prepare_messages(
            self.genomes,
            self.fitness,
            self.cells,
            self.generation,
            self.evaluations,
            *self.messages,
            self.better_at,
            self.target,
            self.target_reporter,
            self._reached,
            self.noted,
            self._improved,
        )
        self._note(self._improved[1 : 1 + self._improved.item(0)])
        self._propose(reached)

    def _note(self, rows: Cells) -> None:
        """Keep the improvements of these rows."""
        if len(self.cells) > MOST_TOLD and len(rows) > 0:
            rows = rows[[self.messages.fitness[rows, -1].argmin()]]
        for row in rows.tolist():
            header, fitness = self.messages.header[row], self.messages.fitness.item(row, -1)
            self.births.append(Birth(header.item(BORN), header.item(BIRTHPLACE), fitness))

    def _propose(self, reached: int) -> None:
        """What cells propose by themselves: that the target is ``reached``, and the root a stall."""
        for row in range(reached):
            self.propose(int(self._reached[row]), "target")
        if self.stall is not None and self.generation - self.better_at[0] >= self.stall:
            self.propose(0, "stall")
