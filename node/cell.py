"""One cell as a state machine without input or output: events in, actions out.

Its driver feeds it events and carries out its actions: `node.driver` in a node, `node.simulation` for async runs within
one process. A cell holds no socket, clock or thread, so a test can give it any sequence of events. Neighbours' messages
are not events: there are thousands of them a second, and a step takes all of them at once. The cell is not thread-safe.

States:
    prepared: it knows its plan, and may already receive messages from neighbours that started before it.
    running: it breeds a generation in each step for which no message is missing (`missing_count`): in lockstep once the
        messages of all its neighbours have come, in async mode always.
    stopped: it has reported, and only answers neighbours that missed a message.
    failed: the problem's code failed, and the cell has reported that.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from lowlevel import capabilities
from node.engine.backlog import Backlog
from node.engine.flags import REACHED, REFUSED, STALLED, STOPS, UNSOUND
from node.engine.generation import Generations
from node.engine.history import History
from node.engine.inbox import Inbox
from node.engine.kernels import OWN
from node.engine.outbox import Outbox
from node.engine.rows import Rows
from node.events import (
    Action,
    Answer,
    Answered,
    AnswerStates,
    Ask,
    Asked,
    AskedForStates,
    Complain,
    Event,
    Halt,
    Message,
    Propose,
    Start,
)
from node.plan import Plan
from node.stimuli import Stimuli
from problems import EvaluationFailed
from problems.guard import reported
from topologies import ROOT
from wire.champion import Champion
from wire.exchange_layout import EPOCH, JOB, NEVER, SENT
from wire.report import Birth, Reason, Report, Staleness
from wire.takeover import KeptStates

GENERATIONS_AT_ONCE = 64
"""The most generations between two looks at the clock, and at what else there is to do."""

State = Literal["prepared", "running", "stopped", "failed"]


class Cell:
    """The state machine of one cell in one epoch of a job.

    Attributes:
        plan: the plan of the epoch.
        number: the number of the cell.
        job: the number of the job.
        state: see the module.
        inbox: the messages of the neighbours.
        neighbours: the distinct cells that the cell's slots name, without the cell itself.
        rows: the cell's only row: its deme, and its own messages.
        generations: breeds generations, in one compiled call if the problem's fitness is compiled; None before the
            start. During that call other threads may run Python.
    """

    def __init__(self, plan: Plan, number: int, job: int) -> None:
        self.plan = plan
        self.number = number
        self.job = job
        self.state: State = "prepared"
        self.inbox = Inbox(plan, number, job)
        self.neighbours = self.inbox.neighbours
        self.rows = Rows(plan, np.array([number]), self.inbox.messages)
        # Every message of this cell carries these two, so they are set once.
        self.rows.messages.header[0, JOB], self.rows.messages.header[0, EPOCH] = job, plan.epoch
        self._is_async = plan.run.mode == "async"
        # With the paper's spy the root alone sends its champion, for the spy; neighbours ignore it.
        self._tells_champion = plan.run.spy == "champion" or number == ROOT
        self._outbox = Outbox(plan.limits.most_bytes_without_state, plan.limits.most_bytes)
        self._backlog = Backlog()
        self._took_over = False  # from a process that has died
        self._reached = 0  # the generation that process may have got to
        self._put_off: list[Reason] = []  # stops to propose, once this cell has got there too
        self._stimuli = Stimuli()
        self._complaints: set[tuple[int, str]] = set()  # made already
        self._answered = 0  # messages that were kept from an answer, so had not come by themselves before
        self._answers_of_no_use = 0  # answers whose message had come by itself meanwhile
        self._history = History(1, plan.run.deme, plan.coding.genome_bytes)
        self.generations: Generations | None = None

    @property
    def ended(self) -> bool:
        """Whether this cell has reported."""
        return self.state in ("stopped", "failed")

    @property
    def missing_count(self) -> int:
        """How many messages must come, at least, before `step` breeds a generation without any further event.

        `NEVER` before the start and after the end.
        """
        if self.state != "running":
            return NEVER
        return 0 if self._is_async or not self.rows.exchanging else self.inbox.missing_count()

    def step(self, news: Sequence[Message] = (), events: Sequence[Event] = (), most: int = 1) -> list[Action]:
        """Take ``news`` and ``events``, breed if ready, and return the actions to carry out.

        Messages are taken first; events do not depend on which messages have come. Up to ``most`` generations are bred
        in one call if there is nothing to send or report between them. If the problem's code fails, the cell fails.
        """
        actions: list[Action] = []
        self._stimuli.note(self.rows.clock.item(), len(news), events)
        try:
            # Otherwise the call below takes the news: if it is compiled, without a step into Python in between.
            if news and (events or self.state != "running"):
                actions += self.hear(news)
                news = ()
            if events:
                self._take(events, actions)
            if self.state == "running":
                self._propose()
                assert self.generations is not None, "a running cell has begun"
                self.generations(news, min(most, GENERATIONS_AT_ONCE))
                self._append_actions(self.generations, news, actions)
                if self._backlog:
                    self._catch_up(self.generations, actions)
        except EvaluationFailed as error:
            self._end(actions, str(error))
        except Exception as error:  # a mistake in this program, which ends the process
            error.add_note(self.told())
            raise
        return actions

    def actions_after_breeding(self) -> list[Action]:
        """Return the actions to carry out after the fast path has called `breed_on` itself and read all news."""
        actions: list[Action] = []
        assert self.generations is not None, "else nothing else could"
        try:
            self._append_actions(self.generations, (), actions)
        except EvaluationFailed as error:
            self._end(actions, str(error))
        return actions

    def hear(self, news: Sequence[Message]) -> list[Action]:
        """Take ``news`` without breeding; after the end they are dropped."""
        actions: list[Action] = []
        if not self.ended and (refusals := self.inbox.hear(news)):
            self._complain(refusals, actions)
        return actions

    @property
    def sent(self) -> int:
        """How many messages this cell has published."""
        return self.rows.messages.header.item(0, SENT)

    def take_back(self) -> None:
        """In async mode give the number of the latest message, which was sent to nobody, to the next one."""
        self.rows.messages.header[OWN, SENT] -= 1

    @property
    def lost(self) -> int:
        """How many messages did not come: none in lockstep, unless links fail. A late message is not lost.

        In lockstep a message that was got by asking counts as lost until it comes by itself, and is then of no use.
        """
        came_late = self.inbox.of_no_use - self._answers_of_no_use
        return max(0, self._answered - came_late) + self.inbox.lost

    @property
    def champion(self) -> Champion | None:
        """The best individual that this cell knows of; None if it knows of no feasible one."""
        return self.rows.messages.champion(0)

    @property
    def births(self) -> tuple[Birth, ...]:
        """The improvements that this cell has noted."""
        return tuple(self.rows.births if self.generations is None else self.generations.births())

    def told(self) -> str:
        """Return what the cell was given lately, for an error."""
        now = f"cell {self.number}, {self.state}, in generation {self.rows.generation}"
        return f"{now}; lately it was given:\n{self._stimuli}"

    def _take(self, events: Sequence[Event], actions: list[Action]) -> None:
        """Take events in their order, and append what follows to ``actions``."""
        for event in events:
            if isinstance(event, Answered):
                self._backlog.put(event.sender, event.generation // self.plan.run.interval, event.payloads)
                # The neighbour may die before this cell has caught up: keep its state and note its stop now.
                if self._took_over or len(event.payloads) > 1:
                    self._hear_answers([(event.sender, event.payloads[-1])], actions)
                self._hear_answers(self._backlog.take(self.inbox.exchange), actions)
            elif isinstance(event, Asked):
                if messages := self._outbox.since(event.generation):
                    assert self.generations is not None, "a cell that has sent messages has begun"
                    # The neighbour may be a new process, which keeps no state of this cell yet.
                    if self.state == "running" and (size := self.generations.add_state_to_latest()):
                        messages[-1] = self._outbox.with_state[:size].tobytes()
                    self.generations.send_state()
                    actions.append(Answer(event.question, messages))
            elif isinstance(event, AskedForStates):
                actions.append(AnswerStates(event.question, self._kept_states(event.once)))
            elif isinstance(event, Start):
                self._begin(event, actions)
            elif isinstance(event, Halt):
                if self.state == "running":
                    self._end(actions, halted=True)
            elif isinstance(event, Propose):
                self._put_off.append(event.reason)
            else:
                actions += self._questions()

    def _propose(self) -> None:
        """Propose the stops that are wanted, once no other cell can be so far that it would stop too late."""
        if self._put_off and self.rows.generation >= self._reached:
            for reason in self._put_off:
                self.rows.propose(0, reason)
            self._put_off.clear()

    def _begin(self, start: Start, actions: list[Action]) -> None:
        if self.state != "prepared":
            return
        self.state = "running"
        rows, plan = self.rows, self.plan
        state = b"" if start.takeover is None else start.takeover.state
        if state:
            rows.make_room()
        else:
            rows.begin(None if start.deme is None else start.deme[None])
        # Not before: the arrays that generations share are made by now.
        kind = _kind_of_generations(rows)
        self.generations = kind(plan, rows, self.inbox, self._history, self._tells_champion, self._outbox)
        if state:
            self.generations.go_on_from(state)
            self.inbox.go_on_from(rows.generation, plan.run.interval)
        else:
            self.generations.publish_first()
        if start.takeover is not None:
            self._took_over, self._reached = True, start.takeover.reached
            self.generations.tell_stop(start.takeover.stop_at)
        self._append_actions(self.generations, (), actions)
        actions += self._questions() if self._took_over else []

    def pace_states(self, seconds: float) -> None:
        """Choose how many messages carry the cell's state, given the seconds from one message to the next."""
        if self.generations is not None:
            self.generations.keep_states_every(self._outbox.messages_between_states(seconds))

    def _kept_states(self, once: bool) -> KeptStates:
        now, oldest = self.rows.generation, self._outbox.oldest
        states = self.inbox.states_told_once() if once else self.inbox.states
        oldest = now if oldest is None else oldest
        stop_at = known_stop(self.rows, self.inbox)
        return KeptStates(self.number, now, oldest, states, self._heard(), stop_at)

    def _heard(self) -> tuple[tuple[int, int], ...]:
        """Return, for each neighbour, the generation up to which all its messages have come; nothing in async mode."""
        if self.plan.run.mode != "lockstep":
            return ()
        interval, heard = self.plan.run.interval, self.inbox.heard()
        return tuple((other, self._backlog.last(other, its) * interval) for other, its in heard.items())

    def _catch_up(self, generations: Generations, actions: list[Action]) -> None:
        """Breed for as long as the neighbours' answers have the messages that are missing; then ask for the next ones.

        These may have come by themselves while they were of no use yet.
        """
        while self._backlog and self.state == "running":
            if self.rows.exchanging:
                self._hear_answers(self._backlog.take(self.inbox.exchange), actions)
            if self.missing_count:
                break
            generations((), GENERATIONS_AT_ONCE)
            self._append_actions(generations, (), actions)
        if self._took_over and not self._backlog:
            actions += self._questions()

    def _hear_answers(self, messages: Sequence[Message], actions: list[Action]) -> None:
        """Hear messages that have come by asking."""
        kept, of_no_use = self.inbox.kept, self.inbox.of_no_use
        actions += self.hear(messages)
        if not self._took_over:
            self._answered += self.inbox.kept - kept
            self._answers_of_no_use += self.inbox.of_no_use - of_no_use

    def _complain(self, refusals: set[tuple[int, str]], actions: list[Action]) -> None:
        new = refusals - self._complaints
        self._complaints |= new
        actions += [Complain(sender, reason) for sender, reason in sorted(new)]

    def _questions(self) -> list[Action]:
        """Ask the neighbours whose messages of this generation have not come; in async mode none is missing."""
        if self.state != "running" or self.missing_count == 0:
            return []
        generation = self.rows.generation
        return [Ask(other, generation) for other in sorted(self.inbox.missing_senders())]

    def _append_actions(self, generations: Generations, news: Sequence[Message], actions: list[Action]) -> None:
        """Append the actions that follow from generations that have been bred, and from ``news`` read meanwhile."""
        _, flags, size, has_state, _ = generations.done()
        if flags:
            self._handle_flags(flags, generations, news, actions)
        if size:
            actions.append(self._outbox.with_state[:size].tobytes() if has_state else self._outbox.latest())
        if flags & STOPS:
            self._end(actions)

    def _handle_flags(
        self, flags: int, generations: Generations, news: Sequence[Message], actions: list[Action]
    ) -> None:
        """Deal with what generations rarely report beside a message.

        Raises:
            EvaluationFailed: if an offspring could not be evaluated, or its fitness is unsound.
        """
        if flags & REFUSED:
            self._complain(self.inbox.complaints(news), actions)
        if flags & UNSOUND:
            self.rows.clock += 1  # the report names the generation that could not be bred
            raise generations.failure()
        if flags & (REACHED | STALLED):
            self.rows.note_proposal(0, "target" if flags & REACHED else "stall")

    def _end(self, actions: list[Action], error: str | None = None, *, halted: bool = False) -> None:
        """Stop or fail, and report; a cell that failed may have no deme, so its report holds none."""
        sound = error is None
        self.state = "stopped" if sound else "failed"
        actions.append(
            Report(
                cell=self.number,
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
                infeasible=self.plan.infeasible,
                halted=halted,
            )
        )


def known_stop(rows: Rows, inbox: Inbox) -> int | None:
    """Return the earliest stop that a cell knows, perhaps from a message that it has not bred with; None if none."""
    stop_at = min(rows.stop_at.item(0), inbox.least_stop)
    return None if stop_at >= rows.limit else stop_at


def _kind_of_generations(rows: Rows) -> type[Generations]:
    if rows.problems[0].fitness_kernel is None or not capabilities().numba_calls:
        return Generations
    from node.engine.compiled_generation import CompiledGenerations

    return CompiledGenerations
