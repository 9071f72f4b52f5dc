"""Rows of cells from generation to generation: breeding, champions and the agreement to stop.

The simulator has a row for each cell of the torus, and advances all of them at once. A node has one row; it makes the
first deme here, and breeds by `node.engine.rule`, so each is a check of the other. Rows do not know how messages
arrive: they find the neighbours' messages in arrays.
"""

from dataclasses import dataclass, field
from zlib import crc32

import numpy as np

from genetics import Cells, Fitness, Genomes
from genetics.breeding import Evaluators, breed, evaluate_all
from genetics.coding import Immigrants
from node.engine.kernels import merge_champions, prepare_messages
from node.plan import Plan
from topologies import ROOT
from wire.exchange import NEVER, Messages
from wire.exchange_layout import BIRTHPLACE, BORN, STOP_AT
from wire.report import Birth, Proposal, Reason

MOST_TOLD = 4096
"""The most rows of which all improvements are kept. More cells are only simulated, and reports need the memory."""


@dataclass
class Rows:
    """The demes of ``cells``, shape (rows,), all in the same generation.

    `node.engine.rule` uses the arrays by their addresses, so after `begin` (or `make_room`) they change in place only.

    Attributes:
        plan: the plan of the epoch.
        cells: the cell of each row.
        messages: the rows' own messages, then rows for other messages if there is room. A row's own message is also
            what the row knows: the champion and the least stop.
        proposals: the stops that these rows proposed.
        births: the improvements noted, generation by generation; with more than `MOST_TOLD` rows only the best of each.
        clock: the generation of all rows, shape (1,), an array so that compiled code can advance it.
        limit: the generation after which all rows stop by themselves; `NEVER` if there is none.
        noted: for each row what `node.engine.kernels.is_noted` keeps, shape (rows, 2).
        problems: each row's own problem object if evaluating leaves a state in it, else the same one for all.
    """

    plan: Plan
    cells: Cells
    messages: Messages
    proposals: list[Proposal] = field(default_factory=list)
    births: list[Birth] = field(default_factory=list)

    clock: Cells = field(init=False)  # (1,)
    genomes: Genomes = field(init=False)  # (rows, deme, genome_bytes)
    fitness: Fitness = field(init=False)  # (rows, deme)
    stop_at: Cells = field(init=False)  # (rows,): the least stop that each row knows, a view of its message
    better_at: Cells = field(init=False)  # (rows,): the generation in which its champion last became fitter
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
        # Under the paper's spy messages carry no champion, so only the root can say that the target is reached.
        self.target_reporter = ROOT if plan.run.spy == "root" else -1
        self.stall = plan.stall if self.cells[0] == ROOT else None
        # Looked up once, since a node needs these in every generation.
        self._first_evaluations, self._each_evaluations = plan.run.deme, plan.evaluations_per_generation
        self._interval, self._emigrants, self._alone = plan.run.interval, plan.run.emigrants, plan.run.deme == 1
        self._coding, self._recipe = plan.coding, plan.recipe
        self.problems = [plan.problem.for_cell() for _ in range(rows)]
        self._evaluate = self._evaluators()

    @property
    def generation(self) -> int:
        """The generation that all rows are in."""
        return self.clock.item()

    @property
    def evaluations(self) -> int:
        """The number of fitness calls of one row so far."""
        return self._first_evaluations + self.generation * self._each_evaluations

    @property
    def exchanging(self) -> bool:
        """Whether messages are exchanged after this generation."""
        return self.generation % self._interval == 0

    def begin(self, demes: Genomes | None = None) -> None:
        """Make and evaluate the first demes: the given ones, shape (rows, deme, genome_bytes), or random ones.

        These are steps 1 and 2 of Ahuactzin et al. 1992, §6.
        """
        plan = self.plan
        self.genomes = plan.coding.random(plan.keys(self.cells, 0), plan.run.deme) if demes is None else demes.copy()
        self.fitness = evaluate_all(self.genomes, self._evaluate)
        self._update_messages()

    def make_room(self) -> None:
        """Make the arrays of the demes, for a state that is read into them (`node.engine.state`)."""
        rows, deme = len(self.cells), self.plan.run.deme
        self.genomes = np.zeros((rows, deme, self.plan.coding.genome_bytes), np.uint8)
        self.fitness = np.zeros((rows, deme))

    def is_sound(self) -> bool:
        """Return whether the demes can be the coding's, and have the fitness that the problem gives them."""
        coding, has_champion = self.plan.coding, self.messages.fitness[: len(self.cells), -1] < np.inf
        genomes = [
            *self.genomes.reshape(-1, coding.genome_bytes),
            *self.messages.genomes[: len(self.cells), -1][has_champion],
        ]
        if not all(coding.alphabet.admits(genome) for genome in genomes):
            return False
        return self._has_its_fitness()

    def _has_its_fitness(self) -> bool:
        """Return whether the problem gives the demes the fitness that they have.

        The last bit may depend on the batch. What counts as infeasible by now may have been evaluated before.
        """
        plan = self.plan
        counts = [
            plan.protection is None or not plan.protection.counts_as_infeasible(genome.tobytes())
            for genome in self.genomes.reshape(-1, plan.coding.genome_bytes)
        ]
        found, known = evaluate_all(self.genomes.copy(), self._evaluate).ravel()[counts], self.fitness.ravel()[counts]
        if plan.problem.is_batch_invariant:
            return np.array_equal(found, known)
        return np.allclose(found, known, rtol=1e-9, atol=0.0)

    def advance(self, received: Messages | None, source_row: Cells | None = None) -> None:
        """Breed the next generation, from the neighbours' messages after an exchange.

        Args:
            received: the messages; None in a generation without exchange. A single individual then breeds with its
                latest immigrants again.
            source_row: for each slot the row of its message, shape (rows, slots). A slot that names the row's own
                number stands for the cell itself.

        Raises:
            EvaluationFailed: if the problem's fitness fails; the generation counts as begun then.
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
        self._update_messages()

    def propose(self, row: int, reason: Reason) -> None:
        """Let one row propose that all cells stop, as soon as all of them can know of it; a later stop is ignored."""
        stop_at = self.generation + self.plan.stop_distance
        if stop_at < self.stop_at[row]:
            self.stop_at[row] = stop_at
            self.note_proposal(row, reason)

    def note_proposal(self, row: int, reason: Reason) -> None:
        """Record that the row's stop is its own proposal, made in this generation."""
        self.proposals.append(Proposal(int(self.stop_at[row]), reason, int(self.cells[row]), self.generation))

    def vitals(self) -> tuple[float, float, float, float, int, int]:
        """Return figures of the first row's deme for `wire.news.Counters`.

        The main thread may call this while the network thread breeds, so the figures may be of different generations.

        Returns:
            Best, median and worst fitness, the champion's fitness and age, and a checksum of the best genome.
        """
        fitness, champion = np.sort(self.fitness[0]), self.messages.champion(0)
        spread = (float(fitness[0]), float(fitness[len(fitness) // 2]), float(fitness[-1]))
        digest = crc32(self.genomes[0, self.fitness[0].argmin()])
        if champion is None:
            return *spread, np.inf, 0, digest
        return *spread, champion.fitness, max(0, self.generation - champion.generation), digest

    def _evaluators(self) -> Evaluators:
        """Return one evaluator for all rows if that gives the same bits as one for each row, else one for each."""
        if any(each is not self.plan.problem for each in self.problems):
            return [self.plan.guarded(each) for each in self.problems]
        if len(self.cells) > 1 and not self.plan.problem.is_batch_invariant:
            return [self.plan.evaluate] * len(self.cells)
        return self.plan.evaluate

    def _update_messages(self) -> None:
        """Put champions and emigrants into the rows' messages, note improvements, and propose stops."""
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
        """Keep the improvements of these rows; of very many rows only the best one."""
        if len(self.cells) > MOST_TOLD and len(rows) > 0:
            rows = rows[[self.messages.fitness[rows, -1].argmin()]]
        for row in rows.tolist():
            header, fitness = self.messages.header[row], self.messages.fitness.item(row, -1)
            self.births.append(Birth(header.item(BORN), header.item(BIRTHPLACE), fitness))

    def _propose(self, reached: int) -> None:
        """Propose stops: the first ``reached`` rows of `_reached` because of the target, the root after a stall."""
        for row in range(reached):
            self.propose(int(self._reached[row]), "target")
        if self.stall is not None and self.generation - self.better_at[0] >= self.stall:
            self.propose(0, "stall")
