"""What a node tells of its turns: of each the last, with no gap in its numbers."""

from types import SimpleNamespace

import msgpack

from node.assignment import Assignment
from node.cell import Cell
from node.core_token import CoreToken
from node.events import Halt, Publish, Start
from node.plan import Plan
from node.turn_taking import TurnTaking
from problems import Run
from problems.function import Function
from wire.control import Wiring

CORE = 3
PATIENCE = 0.05  # seconds; who waits for it in vain makes another
FUNCTION = Function(kind="function", name="onemax", dimension=64)


class Node:
    """The cell 9 of an asynchronous torus after its start, with a order of turns of its own."""

    def __init__(self, generations=100, interval=1):
        self.published = []
        self.core_token = CoreToken(PATIENCE)
        self.turn_taking = TurnTaking({CORE: self.core_token})
        run = Run(topology="torus 4x4", mode="async", generations=generations, interval=interval)
        links = SimpleNamespace(cell=9, wiring=Wiring(0, tuple(range(16))), publish=self.publish)
        self.assignment = Assignment(Cell(Plan(FUNCTION, run), 9, job=1), links)
        self.assignment.core, self.assignment.needs_token = CORE, True
        self.assignment.cell.step(events=[Start()])  # publishes generation 0 and, waiting for nobody, the first

    def publish(self, payload):
        """Note the generation and the number of the message."""
        fields = msgpack.unpackb(payload)
        self.published.append((fields[3], fields[7][0]))

    def breeds(self):
        """One generation, as `node.driver` does."""
        self.turn_taking.take_over(self.assignment)
        for action in self.assignment.cell.step():
            if type(action) is Publish:
                self.turn_taking.publish(self.assignment, action)


def test_without_a_token_every_message_is_published_at_once():
    node = Node()
    node.assignment.needs_token = False
    for _ in range(3):
        node.breeds()
    assert node.published == [(2, 3), (3, 4), (4, 5)]


def test_of_a_turn_the_last_message_is_published_when_the_token_is_handed_on():
    node = Node()
    for _ in range(3):
        node.breeds()
    assert node.published == []
    node.turn_taking.hand_on()
    assert node.published == [(4, 3)]
    node.breeds()
    node.turn_taking.hand_on()
    assert node.published == [(4, 3), (5, 4)]


def test_handing_on_gives_the_token_back():
    node = Node()
    node.breeds()
    node.turn_taking.hand_on()
    assert node.core_token.take()


def test_a_turn_is_over_when_its_time_is():
    node = Node()
    node.breeds()
    node.assignment.bred_at = 0.0  # long before the turn's end
    node.turn_taking.step_is_done(node.assignment)
    assert node.published == []
    node.assignment.bred_at = float("inf")
    node.turn_taking.step_is_done(node.assignment)
    assert node.published == [(2, 3)]


def test_a_turn_is_over_when_the_node_leaves_the_relay():
    node = Node()
    node.breeds()
    node.assignment.bred_at, node.assignment.needs_token = 0.0, False
    node.turn_taking.step_is_done(node.assignment)
    assert node.published == [(2, 3)]


def test_the_last_message_before_the_limit_is_published_although_a_generation_follows():
    node = Node(generations=3)
    node.breeds()
    assert node.published == []
    node.breeds()
    assert node.assignment.cell.ended
    assert node.published == [(2, 3)]


def test_where_some_generations_tell_nothing_no_message_is_kept_back():
    node = Node(interval=2)
    for _ in range(4):
        node.breeds()
    assert node.published == [(2, 2), (4, 3)]


def test_with_events_a_node_waits_for_no_token():
    node = Node()
    assert node.core_token.take()  # somebody else has it
    node.assignment.events.append(Halt())
    node.breeds()
    assert node.published == [(2, 3)]
    assert not node.core_token.take()  # nobody has handed it on


def test_on_a_core_without_a_token_nobody_waits():
    node = Node()
    node.assignment.core = CORE + 1
    node.breeds()
    assert node.published == [(2, 3)]
