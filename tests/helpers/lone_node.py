"""A node's process without a network: tests hand it messages, and see what it publishes."""

import math
import queue
from types import SimpleNamespace

from node import Cell
from node.assignment import Assignment
from node.cell import Start
from node.process import NodeProcess, fast_path
from node.turn_taking import TurnTaking
from wire.control import Wiring


class Counted(Assignment):
    """It counts its steps."""

    steps = 0

    def step(self):
        self.steps += 1
        return super().step()


class LoneNode(NodeProcess):
    """A cell after its start, whose neighbours are played by the test.

    Attributes:
        published: payloads.
        done: what the main thread was asked to carry out.
    """

    def __init__(self, plan, cell, kind=Counted, inline=True):
        self.published, self.done = [], []
        links = SimpleNamespace(
            cell=cell, wiring=Wiring(0, tuple(range(plan.topology.cells))), publish=self.published.append
        )
        self.coming, self.queue, self._turn_taking, self._fast_path = (
            None,
            queue.SimpleQueue(),
            TurnTaking({}),
            fast_path(),
        )
        self._core, self._turns, self._stats_due = None, 0.0, math.inf
        self.assignment = kind(Cell(plan, cell, job=1), links)
        self.assignment.events.append(Start())
        self.published += self.assignment.step()
        self.assignment.inline, self.assignment.steps = inline, 0
        self.handlers = {other: self.make_handler(other) for other in self.assignment.cell.neighbours}

    @property
    def generation(self):
        return self.assignment.cell.rows.generation

    def hears(self, sender, payload):
        """By the ordinary way."""
        self._hear(sender, SimpleNamespace(payload=SimpleNamespace(to_bytes=lambda: payload)))

    def gets(self, sender, payload):
        """As from Zenoh."""
        self.handlers[sender](SimpleNamespace(payload=Payload(payload)))

    def run_queued(self):
        """As the main thread does."""
        while not self.queue.empty():
            self.queue.get_nowait()()

    def _carry_out(self, assignment, action):
        self.done.append(action)

    def _keep_to(self, assignment):
        """These threads are the test's."""


class Payload:
    """As of a Zenoh sample."""

    def __init__(self, payload):
        self.payload = payload

    def __bytes__(self):
        return self.payload

    def to_bytes(self):
        return self.payload
