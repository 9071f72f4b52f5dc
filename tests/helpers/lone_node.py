"""A node's data path without a network: tests hand it messages, and see what it publishes."""

import math
from types import SimpleNamespace

from node.assignment import Assignment
from node.cell import Cell
from node.driver import Driver, make_fast_path
from node.events import Start
from node.telemetry import Telemetry
from node.turn_taking import TurnTaking
from wire.control import Wiring


class Counted(Assignment):
    """It counts its steps."""

    steps = 0

    def step(self):
        self.steps += 1
        return super().step()


class LoneNode:
    """A cell after its start, whose neighbours are played by the test.

    Attributes:
        published: payloads.
        done: what the main thread was asked to carry out.
    """

    def __init__(self, plan, cell, kind=Counted, inline=True, core_tokens=()):
        self.published, self.done = [], []
        self.fast_path, self.turn_taking = make_fast_path(), TurnTaking(dict(core_tokens))
        telemetry = Telemetry(cell, self.published.append, self.published.append)
        telemetry.due = math.inf  # never
        self.driver = Driver(self.carry_out, telemetry, self.turn_taking, self.fast_path, lambda *_: None)
        wiring = Wiring(0, tuple(range(plan.topology.cells)))
        links = SimpleNamespace(cell=cell, wiring=wiring, publish=self.published.append)
        self.driver.enter(kind(Cell(plan, cell, job=1), links))
        self.assignment.events.append(Start())
        self.published += self.assignment.step()
        self.assignment.inline, self.assignment.steps = inline, 0
        self.handlers = {other: self.driver.make_handler(other) for other in self.assignment.cell.neighbours}

    @property
    def assignment(self):
        return self.driver.assignment

    @property
    def generation(self):
        return self.assignment.cell.rows.generation

    def hears(self, sender, payload):
        """By the ordinary way."""
        self.driver.hear(sender, SimpleNamespace(payload=SimpleNamespace(to_bytes=lambda: payload)))

    def gets(self, sender, payload):
        """As from Zenoh."""
        self.handlers[sender](SimpleNamespace(payload=Payload(payload)))

    def carries_on(self):
        """As the main thread does."""
        self.driver.carry_on(self.assignment)

    def run_queued(self):
        """As the main thread does."""
        while not self.driver.queue.empty():
            self.driver.queue.get_nowait()()

    def carry_out(self, assignment, action):
        self.done.append(action)


class Payload:
    """As of a Zenoh sample."""

    def __init__(self, payload):
        self.payload = payload

    def __bytes__(self):
        return self.payload

    def to_bytes(self):
        return self.payload
