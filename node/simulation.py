"""The simulator: runs an epoch of a job within this process, without nodes.

In lockstep all cells are rows of the same kernels that nodes use, and breed together; the result is bit-identical to a
run of processes. In async mode the cells' state machines exchange messages over an in-process bus with seeded delays;
that models a run of processes, but does not repeat one.
"""

import heapq
import time
from collections.abc import Callable, Iterator

import numpy as np

from genetics import Cells, Fitness, Genomes
from node.cell import Cell
from node.engine.history import History
from node.engine.kernels import delay
from node.engine.rows import Rows
from node.events import Action, Event, Message, Propose, Publish, Start
from node.plan import Plan
from problems.guard import reported
from topologies import ROOT
from wire.champion import Champion
from wire.exchange import Messages
from wire.exchange_layout import BIRTHPLACE, BORN
from wire.exchange_reader import hear_emigrants_only
from wire.report import Birth, Proposal, Reason, Report, Staleness

Watch = Callable[[int, Champion], None]
"""Called with the root's generation and champion whenever the root learns of a better one."""
Snapshot = Callable[[int, Genomes, Fitness], None]
"""Called in each generation, after `Watch`, with generation, genomes (cells, deme, genome_bytes) and fitness (cells,
deme). These are the simulator's own arrays: copy what is to be kept. In lockstep only."""

Outside = Callable[[], Reason | None]
"""Called in each generation; returns the reason if a deadline, a user or a program wants the run to stop, else None."""

MEAN_LATENCY = 0.1  # of a message, in units of the mean duration of a generation


def ignore(*_: object) -> None:
    """Do nothing: the default `Watch` and `Snapshot`."""


def never() -> Reason | None:
    """Return None, so that nothing outside stops the run: the default `Outside`."""
    return None


class StopRequest:
    """A request to stop a run from outside: after a deadline of so many ``seconds``, or once it is cancelled.

    Attributes:
        began: when the deadline's time began, seconds on the monotonic clock.
        cancelled: set this to stop the run.
    """

    def __init__(self, seconds: float | None) -> None:
        self.began = time.monotonic()
        self.cancelled = False
        self._seconds = seconds

    def reason(self) -> Reason | None:
        """Return why to stop now; None to go on. An `Outside`."""
        if self.cancelled:
            return "cancel"
        if self._seconds is not None and time.monotonic() - self.began >= self._seconds:
            return "deadline"
        return None


def simulate(
    plan: Plan,
    watch: Watch = ignore,
    snapshot: Snapshot = ignore,
    outside: Outside = never,
    demes: Genomes | None = None,
) -> list[Report]:
    """Run one epoch of a job to its end and return the reports of all cells, in the order of the cells.

    Args:
        plan: the plan of the epoch.
        watch: called when the root learns of a better champion.
        snapshot: called in each generation; in lockstep only.
        outside: asked in each generation whether to stop.
        demes: the first demes, (cells, deme, genome_bytes), such as the last ones of another epoch, evaluated anew;
            None for random ones.

    Raises:
        EvaluationFailed: if the problem's code fails.
    """
    if plan.run.mode == "async":
        return _Delays(plan, watch, outside, demes).run()
    return _lockstep(plan, watch, snapshot, outside, demes)


def _lockstep(plan: Plan, watch: Watch, snapshot: Snapshot, outside: Outside, demes: Genomes | None) -> list[Report]:
    cells = np.arange(plan.topology.cells)
    neighbours = plan.topology.table()
    rows = Rows(plan, cells, Messages.room(len(cells), plan.coding.genome_bytes, plan.run.emigrants))
    heard = rows.messages.copy()  # what neighbours receive; row c is the message of the cell c
    history = History(len(cells), plan.run.deme, plan.coding.genome_bytes)
    published = 0  # messages of each cell, if these were processes: reports are the same as theirs
    rows.begin(demes)
    while True:
        history.note(rows.generation, rows.genomes, rows.fitness)
        champion = rows.messages.champion(ROOT)
        if champion is not None and rows.better_at[ROOT] == rows.generation:
            watch(rows.generation, champion)
        snapshot(rows.generation, rows.genomes, rows.fitness)
        if rows.generation >= rows.stop_at[ROOT]:  # in lockstep all cells stop after the same generation
            break
        if (reason := outside()) is not None:
            rows.propose(ROOT, reason)
        if rows.exchanging:
            published += 1
            _hear(rows, heard)
            rows.advance(heard, neighbours)
        else:
            rows.advance(None)
    del heard  # makes room in memory for the reports of a million cells
    return _reports(rows, history.digests(), published)


def _hear(rows: Rows, heard: Messages) -> None:
    """Copy every row's message into ``heard``.

    A copy is needed because rows change their own messages while they merge others'.
    """
    heard.header[:] = rows.messages.header
    heard.genomes[:] = rows.messages.genomes
    heard.fitness[:] = rows.messages.fitness
    if rows.plan.run.spy == "root":
        hear_emigrants_only(*heard, rows.cells)


def _reports(rows: Rows, digests: list[bytes], published: int) -> list[Report]:
    """Return the reports of all cells. Equal parts are made once and shared, to save memory with a million cells."""
    proposals: dict[int, list[Proposal]] = {}
    for each in rows.proposals:
        proposals.setdefault(each.cell, []).append(each)
    births: dict[int, list[Birth]] = {}
    for birth in rows.births:  # under the paper's spy the root alone reports them, wherever the individuals were born
        teller = ROOT if rows.plan.run.spy == "root" else birth.cell
        births.setdefault(teller, []).append(birth)
    staleness, generation, evaluations = Staleness(0, 0, 0, 0), rows.generation, rows.evaluations
    received = (published * _others(rows.plan.topology.table())).tolist()
    return [
        Report(
            cell=cell,
            generation=generation,
            digest=digest,
            evaluations=evaluations,
            sent=published,
            received=received[cell],
            lost=0,
            rejected=0,
            staleness=staleness,
            champion=champion,
            proposals=tuple(proposals.get(cell, ())),
            births=tuple(births.get(cell, ())),
            deme=deme,
            state=reported(problem),
            error=None,
            infeasible=rows.plan.infeasible if cell == ROOT else (),  # all have the same
        )
        for cell, digest, champion, deme, problem in zip(
            rows.cells.tolist(), digests, _champions(rows.messages), _bytes_of(rows.genomes), rows.problems, strict=True
        )
    ]


def _others(neighbours: Cells) -> Cells:
    """Return how many distinct cells each cell has as neighbours, without itself, shape (cells,)."""
    named = np.sort(neighbours, axis=1)
    is_new = np.diff(named, axis=1, prepend=-1) != 0
    count: Cells = np.count_nonzero(is_new & (named != np.arange(len(named))[:, None]), axis=1)
    return count


def _champions(messages: Messages) -> Iterator[Champion | None]:
    """Yield the champion of each row; rows with the same champion share one object, as most do in the end."""
    header, known = messages.header, dict[tuple[int, int], Champion | None]()
    columns = (messages.fitness[:, -1], header[:, BORN], header[:, BIRTHPLACE])
    genomes = _bytes_of(messages.genomes[:, -1])
    for fitness, born, cell, genome in zip(*(column.tolist() for column in columns), genomes, strict=True):
        if (born, cell) not in known:
            known[born, cell] = None if fitness == np.inf else Champion(fitness, born, cell, genome)
        yield known[born, cell]


def _bytes_of(genomes: Genomes) -> list[bytes]:
    """Return each row as bytes, by one conversion of the whole array."""
    flat = np.ascontiguousarray(genomes).reshape(len(genomes), -1)
    whole: list[bytes] = flat.view(np.dtype((np.void, flat.shape[1])))[:, 0].tolist()
    return whole


class _Delays:
    """A discrete-event simulation of async mode.

    Each generation takes an exponentially distributed time of mean 1, each message one of mean `MEAN_LATENCY`. The
    delays are drawn from the seed, so a simulation is repeatable.
    """

    def __init__(self, plan: Plan, watch: Watch, outside: Outside, demes: Genomes | None) -> None:
        self.watch = watch
        self.outside = outside
        self.cells = [Cell(plan, number, job=1) for number in range(plan.topology.cells)]
        self.events: list[list[Event]] = [[Start(None if demes is None else demes[cell.number])] for cell in self.cells]
        self.news: list[list[Message]] = [[] for _ in self.cells]
        self.reports: dict[int, Report] = {}
        self.best: Champion | None = None
        self._seed = plan.seed
        # A heap of (time, order, cell, message); without a message the cell takes a step. The order makes entries of
        # the same time unique, so that messages are never compared.
        self._agenda: list[tuple[float, int, int, Message | None]] = []
        self._order = 0

    def run(self) -> list[Report]:
        """Run until no cell has anything left to do; return the reports in the order of the cells."""
        for cell in self.cells:
            self._later(0.0, cell.number, None)
        while self._agenda:
            now, _, number, message = heapq.heappop(self._agenda)
            if message is None:
                self._turn(now, self.cells[number])
            else:
                self.news[number].append(message)
        return [self.reports[number] for number in range(len(self.cells))]

    def _turn(self, now: float, cell: Cell) -> None:
        news, self.news[cell.number] = self.news[cell.number], []
        events, self.events[cell.number] = self.events[cell.number], []
        for action in cell.step(news, events):
            self._carry_out(now, cell, action)
        if cell.number == ROOT:
            self._look(cell)
        if not cell.ended:
            self._later(now + self._delay(cell.number, 0), cell.number, None)

    def _carry_out(self, now: float, cell: Cell, action: Action) -> None:
        if isinstance(action, Publish):
            for index, other in enumerate(cell.neighbours):
                arrival = now + MEAN_LATENCY * self._delay(cell.number, 1 + index)
                self._later(arrival, other, (cell.number, action))
        elif isinstance(action, Report):
            self.reports[cell.number] = action

    def _look(self, root: Cell) -> None:
        if (reason := self.outside()) is not None:
            self.events[ROOT].append(Propose(reason))
        champion = root.champion
        if champion is not None and (self.best is None or champion < self.best):
            self.best = champion
            self.watch(root.rows.generation, champion)

    def _later(self, time: float, cell: int, message: Message | None) -> None:
        self._order += 1
        heapq.heappush(self._agenda, (time, self._order, cell, message))

    def _delay(self, cell: int, index: int) -> float:
        """Draw a time of mean 1: index 0 for a generation of the cell, 1 + n for its message to the neighbour n."""
        return float(delay(self._seed, cell, self.cells[cell].rows.generation, index))
