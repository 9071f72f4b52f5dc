"""One cell as a state machine without input or output: events in, actions out.

Whatever drives it (the Zenoh bus of a node's process, or the in-process bus of the simulator) feeds it events and
carries out its actions. It holds no socket, clock or thread, so a test can play it any story.

States:
    prepared: knows its plan, and may already hear neighbours that started before it.
    running: breeds a generation in each step, if it is `ready` to: in lockstep once it has the individuals of all its
        neighbours, in async mode always.
    stopped: it has reported and does nothing more, but for answering neighbours that missed a message.
    failed: the problem broke; it has reported that.
"""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from node.plan import Plan
from node.rows import NEVER, Packets, Rows
from problems import EvaluationFailed
from topologies import ROOT
from wire.exchange import Champion, Emigrant, Exchange
from wire.report import Reason, Report

State = Literal["prepared", "running", "stopped", "failed"]


# Events ---------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Start:
    """Every cell is prepared: begin."""


@dataclass(frozen=True)
class Heard:
    """A neighbour's message has come."""

    sender: int
    message: Exchange


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


Event = Start | Heard | Propose | Waited | Asked


# Actions --------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Publish:
    """Send a message to all neighbours."""

    message: Exchange


@dataclass(frozen=True)
class Ask:
    """Ask a neighbour for its message of a generation."""

    neighbour: int
    generation: int


@dataclass(frozen=True)
class Answer:
    """Give the message that was asked for."""

    question: object
    message: Exchange


Action = Publish | Ask | Answer | Report


class Cell:
    """The state machine of the cell number ``cell`` in job number ``job``."""

    def __init__(self, plan: Plan, cell: int, job: int) -> None:
        self.plan = plan
        self.cell = cell
        self.job = job
        self.state: State = "prepared"
        self.rows = Rows(plan, np.array([cell]))
        self.slots = plan.topology.neighbours(cell)
        self.neighbours = tuple(dict.fromkeys(other for other in self.slots if other != cell))
        self.sent = self.received = self.lost = 0
        # Lockstep: the messages not bred with yet, by neighbour and generation; a neighbour is at most one ahead.
        self._inbox: dict[int, dict[int, Exchange]] = {other: {} for other in self.neighbours}
        self._latest: dict[int, Exchange] = {}  # async: the latest from each neighbour
        self._outbox: dict[int, Exchange] = {}  # the last two, by generation, for neighbours that miss one
        self._asked: set[tuple[int, int]] = set()  # (neighbour, generation) of each question
        self._digest = hashlib.sha256()

    @property
    def ended(self) -> bool:
        """Whether this cell has reported."""
        return self.state in ("stopped", "failed")

    @property
    def ready(self) -> bool:
        """True iff `step` would breed a generation without any further event."""
        if self.state != "running":
            return False
        return self._is_async or not self.rows.exchanging or not self._missing()

    def step(self, events: Iterable[Event] = ()) -> list[Action]:
        """Take ``events`` in order, breed a generation if ready, and say what is to be done."""
        actions: list[Action] = []
        try:
            for event in events:
                self._take(event, actions)
            if self.ready:
                self._advance(actions)
        except EvaluationFailed as error:
            self._end("failed", str(error), actions)
        return actions

    @property
    def champion(self) -> Champion | None:
        """The best that this cell has seen or heard of, if anything feasible."""
        return champion_of(self.rows, 0)

    @property
    def _is_async(self) -> bool:
        return self.plan.run.mode == "async"

    def _missing(self) -> list[int]:
        generation = self.rows.generation
        return [other for other, inbox in self._inbox.items() if generation not in inbox]

    def _take(self, event: Event, actions: list[Action]) -> None:
        match event:
            case Asked(generation, question):
                if generation in self._outbox:
                    actions.append(Answer(question, self._outbox[generation]))
            case _ if self.ended:
                pass
            case Start():
                self.state = "running"
                self.rows.begin()
                self._generation_done(actions)
            case Heard(sender, message):
                self._hear(sender, message)
            case Propose(reason):
                self.rows.propose(0, reason)
            case Waited():
                actions += self._questions()

    def _hear(self, sender: int, message: Exchange) -> None:
        if message.job != self.job or sender not in self._inbox:
            return
        if self._is_async:
            latest = self._latest.get(sender)
            self.lost += max(0, message.sent - 1 - (latest.sent if latest else 0))
            self._latest[sender] = message
        else:
            inbox, now = self._inbox[sender], self.rows.generation
            if message.generation in inbox or not now <= message.generation <= now + self.plan.run.interval:
                return  # a late answer to a question, or nonsense
            inbox[message.generation] = message
            self.lost += (sender, message.generation) in self._asked
        self.received += 1

    def _questions(self) -> list[Action]:
        """In lockstep nothing waits for ever: ask the neighbours whose message of this generation has not come."""
        if self.state != "running" or self.ready:
            return []
        generation = self.rows.generation
        missing = self._missing()
        self._asked.update((other, generation) for other in missing)
        return [Ask(other, generation) for other in missing]

    def _advance(self, actions: list[Action]) -> None:
        self.rows.advance(self._received() if self.rows.exchanging else None)
        self._generation_done(actions)

    def _received(self) -> Packets:
        """What stands in each slot, shape (1, slots, ...); a slot that names the cell itself holds its own."""
        if self._is_async:
            heard = self._latest
        else:
            heard = {other: inbox.pop(self.rows.generation) for other, inbox in self._inbox.items()}
        own = self._outbox[self.rows.generation]
        messages = [heard.get(other, own) for other in self.slots]
        senders = [other if other in heard else self.cell for other in self.slots]
        return _packets(messages, senders, champions=self.plan.run.spy == "champion")

    def _generation_done(self, actions: list[Action]) -> None:
        rows = self.rows
        self._digest.update(rows.generation.to_bytes(8, "little"))
        self._digest.update(rows.genomes.data)
        self._digest.update(rows.fitness.data)
        # Without lockstep there is no common generation to stop after: who hears of a stop passes it on and stops.
        drains = self._is_async and rows.stop_at[0] != rows.limit
        stops = drains or rows.generation >= rows.stop_at[0]
        if drains or (rows.exchanging and not stops):
            self._publish(actions)
        if stops:
            self._end("stopped", None, actions)

    def _publish(self, actions: list[Action]) -> None:
        self.sent += 1
        message = self._message()
        generation = message.generation
        previous = generation - self.plan.run.interval
        self._outbox = {kept: self._outbox[kept] for kept in self._outbox.keys() & {previous}}
        self._outbox[generation] = message
        actions.append(Publish(message))

    def _message(self) -> Exchange:
        rows, packets = self.rows, self.rows.packets()
        return Exchange(
            self.job,
            0,
            rows.generation,
            None if rows.stop_at[0] == NEVER else int(rows.stop_at[0]),
            tuple(
                Emigrant(genome.tobytes(), float(fitness))
                for genome, fitness in zip(packets.emigrants[0], packets.emigrant_fitness[0], strict=True)
            ),
            self.champion if self.plan.run.spy == "champion" or self.cell == ROOT else None,
            self.sent,
            rows.evaluations,
        )

    def _end(self, state: Literal["stopped", "failed"], error: str | None, actions: list[Action]) -> None:
        self.state = state
        sound = error is None
        actions.append(
            Report(
                cell=self.cell,
                generation=self.rows.generation,
                digest=self._digest.digest(),
                evaluations=self.rows.evaluations if sound else 0,
                sent=self.sent,
                received=self.received,
                lost=self.lost,
                rejected=0,  # the bus knows
                champion=self.champion,
                proposals=tuple(self.rows.proposals),
                deme=self.rows.genomes.tobytes() if sound else b"",
                error=error,
            )
        )


def champion_of(rows: Rows, row: int) -> Champion | None:
    """The champion that a row knows, as it travels."""
    if rows.champion_fitness[row] == np.inf:
        return None
    return Champion(
        float(rows.champion_fitness[row]),
        int(rows.champion_generation[row]),
        int(rows.champion_cell[row]),
        rows.champion[row].tobytes(),
    )


def _packets(messages: list[Exchange], senders: list[int], champions: bool) -> Packets:
    """The arrays of some messages, shape (1, slots, ...).

    Without ``champions``, under the paper's spy, a sender's best emigrant is all that is heard of it (only the spy may
    look at the root's champion).
    """
    best = [
        (message.champion if champions else None)
        or Champion(message.emigrants[0].fitness, message.generation, sender, message.emigrants[0].genome)
        for message, sender in zip(messages, senders, strict=True)
    ]
    genomes = b"".join(emigrant.genome for message in messages for emigrant in message.emigrants)
    slots, emigrants = len(messages), len(messages[0].emigrants)
    return Packets(
        np.frombuffer(bytearray(genomes), np.uint8).reshape(1, slots, emigrants, -1),
        np.array([[[emigrant.fitness for emigrant in message.emigrants] for message in messages]]),
        np.frombuffer(bytearray(b"".join(each.genome for each in best)), np.uint8).reshape(1, slots, -1),
        np.array([[each.fitness for each in best]]),
        np.array([[each.generation for each in best]]),
        np.array([[each.cell for each in best]]),
        np.array([[NEVER if message.stop_at is None else message.stop_at for message in messages]]),
    )
