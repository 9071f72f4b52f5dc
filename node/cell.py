"""One cell as a state machine without input or output: events in, actions out.

Whatever drives it (the Zenoh bus of a node's process, or the in-process bus of the simulator) feeds it events and
carries out its actions. It holds no socket, clock or thread, so a test can play it any story. Neighbours' messages are
not events: there are thousands of them a second, and they are taken in all at once.

States:
    prepared: knows its plan, and may already hear neighbours that started before it.
    running: breeds a generation in each step that it `awaits` no message for: in lockstep once it has those of all its
        neighbours, in async mode always.
    stopped: it has reported and does nothing more, but for answering neighbours that missed a message.
    failed: the problem broke; it has reported that.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from genetics import Genomes
from lowlevel import capabilities
from node.flags import REACHED, REFUSED, STALLED, STOPS, UNSOUND
from node.history import History
from node.inbox import Inbox
from node.kernels import OWN, TOLD
from node.outbox import Outbox
from node.plan import Plan
from node.rows import Rows
from problems import EvaluationFailed
from problems.guard import reported
from topologies import ROOT
from wire.exchange import Champion
from wire.exchange_kernels import EPOCH, JOB, NEVER, SENT
from wire.report import Birth, Reason, Report, Staleness

if TYPE_CHECKING:
    from node.generation import Generations

State = Literal["prepared", "running", "stopped", "failed"]


# Events ---------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Start:
    """Every cell is prepared: begin, with a deme that lived before, (deme, genome_bytes), if one is given."""

    deme: Genomes | None = None


@dataclass(frozen=True)
class Halt:
    """Stop at once, wherever the others are."""


class Answered(NamedTuple):
    """A neighbour has answered a question with its message: that was lost, or is late."""

    sender: int
    payload: bytes


@dataclass(frozen=True)
class Propose:
    """Somebody outside wants all cells to stop."""

    reason: Reason


@dataclass(frozen=True)
class Waited:
    """For a while nothing has come."""


@dataclass(frozen=True)
class Asked:
    """A neighbour has missed this cell's message of a generation; ``question`` is whatever the bus answers by."""

    generation: int
    question: object


Event = Start | Halt | Answered | Propose | Waited | Asked


# Actions --------------------------------------------------------------------------------------------------------------
Publish = bytes
"""A message for all neighbours, as it travels; nothing around it, since there is one in each generation."""


@dataclass(frozen=True)
class Ask:
    """Ask a neighbour for its message of a generation."""

    neighbour: int
    generation: int


@dataclass(frozen=True)
class Answer:
    """Give the message that was asked for."""

    question: object
    payload: bytes


@dataclass(frozen=True)
class Complain:
    """Say that a neighbour's messages are bad; it is said once for each neighbour and reason."""

    sender: int
    reason: str


Message = tuple[int, bytes]
"""A neighbour's message, as it travelled, with the number of its cell."""

Action = Publish | Ask | Answer | Complain | Report


class Cell:
    """The state machine of the cell number ``cell`` in one epoch of job number ``job``.

    Attributes:
        generations: from the start on, if they are bred in one compiled call, beside which others may run Python.
    """

    def __init__(self, plan: Plan, cell: int, job: int) -> None:
        self.plan = plan
        self.cell = cell
        self.job = job
        self.state: State = "prepared"
        self.inbox = Inbox(plan, cell, job)
        self.neighbours = self.inbox.neighbours
        self.rows = Rows(plan, np.array([cell]), self.inbox.messages)
        self.rows.messages.header[0, JOB], self.rows.messages.header[0, EPOCH] = job, plan.epoch
        self._is_async = plan.run.mode == "async"
        self._tells_champion = plan.run.spy == "champion" or cell == ROOT
        self._outbox = Outbox(plan.limits.most_bytes)
        self._complaints: set[tuple[int, str]] = set()
        self._answered = 0  # messages that had not come when they were asked for
        self._answers_of_no_use = 0
        self._history = History(1, plan.run.deme, plan.coding.genome_bytes)
        self.generations: Generations | None = None

    @property
    def ended(self) -> bool:
        """Whether this cell has reported."""
        return self.state in ("stopped", "failed")

    @property
    def awaits(self) -> int:
        """How many messages must come, at least, before `step` breeds a generation without any further event.

        `NEVER` before the start and after the end.
        """
        return self._lacking() if self.state == "running" else NEVER

    def step(self, news: Sequence[Message] = (), events: Sequence[Event] = (), most: int = 1) -> list[Action]:
        """Take ``news`` and ``events``, breed if ready, and say what is to be done.

        Messages are taken first; to keep them changes nothing for the events. Up to ``most`` generations are bred if
        nothing is to be said between them.
        """
        actions: list[Action] = []
        try:
            if news and (events or self.generations is None):
                actions += self.hear(news)
                news = ()
            if events:
                self._take(events, actions)
            if self.state == "running":
                if self.generations is None:
                    self._advance(actions)
                else:
                    self.generations(news, min(most, self.room))
                    self._went_on(self.generations, news, actions)
        except EvaluationFailed as error:
            self._end("failed", str(error), actions)
        return actions

    @property
    def room(self) -> int:
        """How many generations there is room for before the history is digested."""
        return self._history.most - self._history.noted

    def went_on(self) -> list[Action]:
        """What is to be done after other compiled code has let the `generations` go on, with no news left."""
        actions: list[Action] = []
        assert self.generations is not None, "else nothing else could"
        try:
            self._went_on(self.generations, (), actions)
        except EvaluationFailed as error:
            self._end("failed", str(error), actions)
        return actions

    def hear(self, news: Sequence[Message]) -> list[Action]:
        """Take ``news`` and nothing else."""
        actions: list[Action] = []
        if not self.ended and (refusals := self.inbox.hear(news)):
            self._complain(refusals, actions)
        return actions

    @property
    def sent(self) -> int:
        """How many messages this cell has published."""
        return self.rows.messages.header.item(0, SENT)

    def take_back(self) -> None:
        """In async mode: nobody was sent the latest message, so the next one takes its number."""
        self.rows.messages.header[OWN, SENT] -= 1

    @property
    def lost(self) -> int:
        """How many messages did not come: none in lockstep, unless links fail. What only came late was not lost."""
        came_late = self.inbox.of_no_use - self._answers_of_no_use
        return max(0, self._answered - came_late) + self.inbox.lost

    @property
    def champion(self) -> Champion | None:
        """The best that this cell has seen or heard of, if anything feasible."""
        return self.rows.messages.champion(0)

    @property
    def births(self) -> tuple[Birth, ...]:
        """The improvements that this cell has noted."""
        since = () if self.generations is None else self.generations.births()
        return (*self.rows.births, *since)

    def _take(self, events: Sequence[Event], actions: list[Action]) -> None:
        for event in events:
            if isinstance(event, Answered):
                kept, of_no_use = self.inbox.kept, self.inbox.of_no_use
                actions += self.hear([(event.sender, event.payload)])
                self._answered += self.inbox.kept - kept
                self._answers_of_no_use += self.inbox.of_no_use - of_no_use
            elif isinstance(event, Asked):
                sent = self._outbox.of(event.generation)
                if sent is not None:
                    actions.append(Answer(event.question, sent))
            elif isinstance(event, Start):
                self._begin(event.deme, actions)
            elif isinstance(event, Halt):
                if self.state == "running":
                    self._end("stopped", None, actions)
            elif isinstance(event, Propose):
                if not self.ended:
                    self.rows.propose(0, event.reason)
            else:
                actions += self._questions()

    def _begin(self, deme: Genomes | None, actions: list[Action]) -> None:
        if self.state == "prepared":
            self.state = "running"
            rows, plan = self.rows, self.plan
            rows.begin(None if deme is None else deme[None])
            if rows.problems[0].fitness_kernel is not None and capabilities().numba_calls:
                from node.generation import Generations

                self.generations = Generations(
                    plan, rows, self.inbox, self._history, self._tells_champion, self._outbox
                )
            self._generation_done(actions)

    def _complain(self, refusals: set[tuple[int, str]], actions: list[Action]) -> None:
        new = refusals - self._complaints
        self._complaints |= new
        actions += [Complain(sender, reason) for sender, reason in sorted(new)]

    def _questions(self) -> list[Action]:
        """In lockstep nothing waits for ever: ask the neighbours whose message of this generation has not come."""
        if self.state != "running" or self._lacking() == 0:
            return []
        generation = self.rows.generation
        return [Ask(other, generation) for other in sorted(self.inbox.missing())]

    def _lacking(self) -> int:
        """How many messages the next generation needs that have not come."""
        return 0 if self._is_async or not self.rows.exchanging else self.inbox.lacking()

    def _advance(self, actions: list[Action]) -> None:
        """Breed one generation, if nothing is lacking."""
        rows = self.rows
        if self._lacking() == 0:
            if rows.exchanging:
                rows.advance(rows.messages, self.inbox.take(rows.generation))
            else:
                rows.advance(None)
            self._generation_done(actions)

    def _went_on(self, generations: "Generations", news: Sequence[Message], actions: list[Action]) -> None:
        """The same was done as by `hear` and `_advance`, compiled, and more than once if there was nothing to say."""
        _, flags, size, wrong = generations.done()
        self._history.went_on()
        if flags:
            self._raise_flags(flags, generations.offspring[wrong : wrong + 1], news, actions)
        if size:
            actions.append(self._outbox.message(self.sent))
        if flags & STOPS:
            self._end("stopped", None, actions)

    def _raise_flags(self, flags: int, wrong: Genomes, news: Sequence[Message], actions: list[Action]) -> None:
        """What hardly ever is to be said beside a message."""
        if flags & REFUSED:
            self._complain(self.inbox.complaints(news), actions)
        if flags & UNSOUND:
            self.rows.clock += 1
            self.plan.evaluate(wrong)  # says what is wrong with it
            raise EvaluationFailed("the compiled fitness of an individual is none, though `evaluate` finds one")
        if flags & (REACHED | STALLED):
            self.rows.note_proposal(0, "target" if flags & REACHED else "stall")

    def _generation_done(self, actions: list[Action]) -> None:
        rows = self.rows
        self._history.note(rows.generation, rows.genomes, rows.fitness)
        # Without lockstep there is no common generation to stop after: who hears of a stop passes it on and stops.
        drains = self._is_async and rows.stop_at.item(0) != rows.limit
        stops = drains or rows.generation >= rows.stop_at.item(0)
        if drains or (rows.exchanging and not stops):
            rows.messages.header[OWN, SENT] += 1
            for array in rows.messages:
                array[TOLD] = array[OWN]
            encode = partial(rows.messages.encode, 0, self._tells_champion)
            actions.append(self._outbox.write(self.sent, rows.generation, encode))
        if stops:
            self._end("stopped", None, actions)

    def _end(self, state: Literal["stopped", "failed"], error: str | None, actions: list[Action]) -> None:
        self.state = state
        sound = error is None
        actions.append(
            Report(
                cell=self.cell,
                generation=self.rows.generation,
                digest=self._history.digests()[0],
                evaluations=self.rows.evaluations if sound else 0,
                sent=self.sent,
                received=self.inbox.kept,
                lost=self.lost,
                rejected=self.inbox.refused,
                staleness=Staleness(*self.inbox.staleness.tolist()),
                champion=self.champion,
                proposals=tuple(self.rows.proposals),
                births=self.births,
                deme=self.rows.genomes.tobytes() if sound else b"",
                state=reported(self.rows.problems[0]) if sound else b"",
                error=error,
            )
        )
