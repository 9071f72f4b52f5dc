"""The life of some rows of cells from generation to generation: breeding, champions and the agreement to stop.

A node holds one row, the simulator one for each cell of the torus; the code is the same, and all of it is arrays and
arithmetic. It knows nothing of how messages come: what neighbours said lies in arrays, wherever they are from.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from genetics import Cells, Fitness, Genomes
from genetics.breeding import breed
from genetics.coding import Immigrants
from node.kernels import believe, live_on, tell
from node.plan import Plan
from topologies import ROOT
from wire.exchange import NEVER, Messages
from wire.exchange_kernels import BIRTHPLACE, BORN, STOP_AT
from wire.report import Proposal, Reason


@dataclass
class Rows:
    """The demes of ``cells``, shape (rows,), all in the same generation.

    Attributes:
        messages: the rows' own, and after them any others that there was room for. What a row knows is what it tells:
            its message holds the champion, and the least stop, that it knows.
    """

    plan: Plan
    cells: Cells
    messages: Messages
    generation: int = 0
    proposals: list[Proposal] = field(default_factory=list)

    genomes: Genomes = field(init=False)  # (rows, deme, genome_bytes)
    fitness: Fitness = field(init=False)  # (rows, deme)
    stop_at: Cells = field(init=False)  # (rows,): the least each row has heard of
    better_at: Cells = field(init=False)  # (rows,): when its champion last became better

    def __post_init__(self) -> None:
        rows, plan = len(self.cells), self.plan
        self.limit = NEVER if plan.last_generation is None else plan.last_generation
        self.messages.header[:rows, STOP_AT] = self.limit
        self.messages.header[:rows, BORN] = NEVER
        self.messages.header[:rows, BIRTHPLACE] = self.cells
        self.stop_at = self.messages.header[:rows, STOP_AT]
        self.better_at = np.zeros(rows, np.int64)
        self._immigrants: Immigrants | None = None
        self._reached = np.zeros(rows, np.int64)
        self._target = -np.inf if plan.target is None else plan.target
        # Under the paper's spy only what has come past the root is known, so there the root says it for all.
        self._witness = ROOT if plan.run.spy == "root" else -1
        self._stall = plan.run.stall_limit() if self.cells[0] == ROOT else None
        # Looked up once: a node asks for these in every generation.
        self._first_evaluations, self._each_evaluations = plan.run.deme, plan.evaluations_per_generation
        self._interval, self._emigrants, self._alone = plan.run.interval, plan.run.emigrants, plan.run.deme == 1
        self._coding, self._recipe = plan.coding, plan.recipe
        together = rows == 1 or plan.problem.batches_alike
        self._in_one_call: Callable[[bool, Cells], int] | None = None
        self._evaluate = plan.evaluate if together else self._evaluate_apart

    @property
    def evaluations(self) -> int:
        """Fitness calls of one row so far."""
        return self._first_evaluations + self.generation * self._each_evaluations

    @property
    def exchanging(self) -> bool:
        """Whether emigrants leave in this generation."""
        return self.generation % self._interval == 0

    def begin(self) -> None:
        """Draw and evaluate the first demes (§6, steps 1 and 2)."""
        plan = self.plan
        self.genomes = plan.coding.random(plan.keys(self.cells, 0), plan.run.deme)
        flat = self.genomes.reshape(-1, plan.coding.genome_bytes)
        self.fitness = self._evaluate(flat).reshape(len(self.cells), plan.run.deme)
        self._tell()
        self._in_one_call = self._compiled()

    def advance(self, received: Messages | None, whence: Cells) -> None:
        """Take what the neighbours said (None in a generation without exchange) and breed the next generation.

        ``whence``, (rows, slots), says which message came to each slot; a slot that names the row's own number stands
        for the cell itself. Between exchanges an individual that lives alone breeds with the immigrants it had last.
        """
        self.generation += 1
        if self._in_one_call is not None:
            self._propose(self._in_one_call(received is not None, whence))
            return
        if received is not None:
            believe(*self.messages, self.better_at, self.generation, *received, whence)
            self._immigrants = Immigrants(received.genomes, received.fitness, whence, self._emigrants)
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
            self.proposals.append(Proposal(stop_at, reason, int(self.cells[row]), self.generation))

    def _compiled(self) -> Callable[[bool, Cells], int] | None:
        """A generation as one compiled call, for a single individual whose problem's fitness is compiled."""
        plan, judging = self.plan, self.plan.problem.judging
        if not self._alone or len(self.cells) > 1 or judging is None:
            return None
        mating = self._coding.mating(self._recipe)
        count = 2 * plan.slots * self._emigrants
        offspring = np.zeros((count, plan.coding.genome_bytes), np.uint8)
        operators = (mating.address, mating.table, judging.address, judging.table)
        before = (*operators, self.genomes, self.fitness, offspring, np.zeros(count))
        choices = (self._emigrants, self._recipe.replacement == "elitist", plan.keys(self.cells, 0).seed)
        cell = int(self.cells[0])

        def live(hears: bool, whence: Cells) -> int:
            reached = live_on(
                *before,
                whence,
                hears,
                *choices,
                cell,
                self.generation,
                self.evaluations,
                *self.messages,
                self.better_at,
                self._target,
                self._witness,
            )
            if reached < 0:
                plan.evaluate(offspring[-1 - reached][None])  # says what is wrong with it
            return reached

        self._kept = (mating, judging)  # compiled code holds addresses of their arrays
        return live

    def _evaluate_apart(self, genomes: Genomes) -> Fitness:
        """Row by row, as nodes do: other batches could change a bit."""
        return np.concatenate([self.plan.evaluate(part) for part in np.split(genomes, len(self.cells))])

    def _tell(self) -> None:
        """Champions, emigrants and proposals."""
        reached = tell(
            self.genomes,
            self.fitness,
            self.cells,
            self.generation,
            self.evaluations,
            *self.messages,
            self.better_at,
            self._target,
            self._witness,
            self._reached,
        )
        self._propose(reached)

    def _propose(self, reached: int) -> None:
        """What cells propose by themselves: that the target is ``reached``, and the root a stall."""
        for row in range(reached):
            self.propose(int(self._reached[row]), "target")
        if self._stall is not None and self.generation - self.better_at[0] >= self._stall:
            self.propose(0, "stall")
