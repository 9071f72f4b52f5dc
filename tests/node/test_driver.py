"""What a node's network thread does with each message, without a network."""

from types import SimpleNamespace

import pytest
from lone_node import LoneNode

from node.assignment import MANY_UNREAD, Assignment
from node.cell import Cell
from node.driver import MOST_UNREAD
from node.events import Answered, Ask, Publish, Start, Waited
from node.plan import Plan
from problems import Run
from problems.function import Function
from wire.control import Wiring

NEIGHBOURS = (5, 8, 10, 13)  # of the cell 9
PLAN = Plan(Function(kind="function", name="onemax", dimension=8), Run(topology="torus 4x4", generations=100))
IN_ASYNC = Plan(PLAN.problem, Run(topology="torus 4x4", mode="async", generations=100))


def told(plan, generations):
    """What each cell publishes: by generation and cell."""
    cells = [Cell(plan, number, job=1) for number in range(plan.topology.cells)]
    said = [[cell.step(events=[Start()])[0] for cell in cells]]
    for _ in range(generations - 1):
        news = [[(other, said[-1][other]) for other in cell.neighbours] for cell in cells]
        said.append([cell.step(each)[0] for cell, each in zip(cells, news, strict=True)])
    return said


SAID = told(PLAN, 5)


class Node(LoneNode):
    """The cell 9 after its start."""

    def __init__(self, plan=PLAN, **settings):
        super().__init__(plan, 9, **settings)
        self.published.clear()

    def hears_of(self, generation, *senders):
        for sender in senders:
            self.hears(sender, SAID[generation][sender])


@pytest.fixture(autouse=True)
def cores(monkeypatch):
    monkeypatch.setattr("node.cpu_affinity.CORES", list(range(16)))  # so many that nobody keeps to one


def test_it_steps_once_for_all_neighbours():
    node = Node()
    node.hears_of(0, *NEIGHBOURS[:3])
    assert (node.assignment.steps, node.generation) == (0, 0)
    node.hears_of(0, NEIGHBOURS[3])
    assert (node.assignment.steps, node.generation) == (1, 1)
    assert node.published == [SAID[1][9]]
    assert isinstance(node.published[0], Publish)


def test_what_is_a_generation_ahead_takes_nobodys_place():
    node = Node()
    node.hears_of(0, *NEIGHBOURS[:3])
    node.hears_of(1, *NEIGHBOURS[:3])
    assert node.assignment.steps == 0
    node.hears_of(0, NEIGHBOURS[3])
    assert (node.assignment.steps, node.generation) == (1, 1)
    assert node.assignment.missing_senders == {NEIGHBOURS[3]}
    node.hears_of(1, NEIGHBOURS[3])
    assert (node.assignment.steps, node.generation) == (2, 2)


@pytest.mark.parametrize("useless", [SAID[0][5], b"", b"\xc1", SAID[4][5]], ids=["again", "empty", "bad", "too early"])
def test_a_message_of_no_use_costs_a_step_and_no_more(useless):
    node = Node()
    node.hears_of(0, *NEIGHBOURS)
    node.hears(5, useless)
    node.hears_of(1, *NEIGHBOURS[1:])
    assert (node.generation, node.assignment.missing_senders) == (1, {5})
    node.hears_of(1, 5)
    assert (node.generation, node.assignment.steps) == (2, 3)


def test_a_message_that_was_lost_comes_as_an_answer():
    node = Node()
    node.hears_of(0, *NEIGHBOURS[1:])
    node.hears_of(1, *NEIGHBOURS)  # also of whom the one before was lost
    assert (node.generation, node.assignment.missing_senders) == (0, {5})
    node.assignment.events.append(Waited())
    assert node.assignment.step() == [Ask(5, 0)]
    node.assignment.events.append(Answered(5, 0, [SAID[0][5]]))
    node.assignment.step()
    while node.assignment.busy:
        node.assignment.step()
    assert (node.generation, node.assignment.missing_senders) == (2, set(NEIGHBOURS))


def test_many_messages_are_read_whoever_has_sent_nothing():
    node = Node()
    for _ in range(MOST_UNREAD):
        node.hears(5, b"bad")
    assert node.assignment.steps == 0
    node.hears(5, b"bad")
    assert (node.assignment.steps, node.assignment.news) == (1, [])
    assert node.assignment.cell.inbox.refused == MOST_UNREAD + 1


def test_in_async_mode_many_messages_are_read_before_the_cell_breeds_again():
    node = Node(plan=IN_ASYNC)
    before = node.generation
    for _ in range(MANY_UNREAD - 1):
        node.hears(5, b"bad")
    assert node.assignment.cell.inbox.refused == 0
    node.hears_of(0, 8)
    assert (node.generation, node.assignment.steps, node.assignment.news) == (before, 0, [])
    assert (node.assignment.cell.inbox.refused, node.assignment.cell.inbox.kept) == (MANY_UNREAD - 1, 1)
    (complaint,) = Cell(IN_ASYNC, 9, job=1).hear([(5, b"bad")])
    assert node.driver.queue.get_nowait().args == (node.assignment, complaint)
    assert node.driver.queue.empty()
    assert not node.assignment.lock.locked()


def test_in_async_mode_many_messages_wait_for_a_thread_that_is_at_it():
    node = Node(plan=IN_ASYNC)
    with node.assignment.lock:
        for _ in range(2 * MANY_UNREAD):
            node.hears(5, b"bad")
        assert len(node.assignment.news) == 2 * MANY_UNREAD
    node.hears_of(0, 5)
    assert node.assignment.news == []
    assert (node.assignment.cell.inbox.refused, node.assignment.cell.inbox.kept) == (2 * MANY_UNREAD, 1)


def test_what_goes_wrong_in_reading_ends_the_process(monkeypatch):
    node = Node(plan=IN_ASYNC)

    def breaks(news):
        raise ZeroDivisionError

    monkeypatch.setattr(node.assignment.cell.inbox, "hear", breaks)
    for _ in range(MANY_UNREAD):
        node.hears_of(0, 5)
    with pytest.raises(ZeroDivisionError):
        node.driver.queue.get_nowait()()
    assert not node.assignment.lock.locked()


def test_what_comes_while_another_thread_is_at_it_is_not_forgotten():
    node = Node()
    with node.assignment.lock:
        node.hears_of(0, *NEIGHBOURS)
    assert (node.assignment.steps, node.assignment.busy) == (0, True)
    node.assignment.step()
    assert node.generation == 1


def test_the_main_thread_is_woken_for_generations_that_take_long():
    node = Node(inline=False)
    node.hears_of(0, *NEIGHBOURS[:3])
    assert node.driver.queue.empty()
    node.hears_of(0, NEIGHBOURS[3])
    assert (node.driver.queue.qsize(), node.assignment.steps, node.assignment.busy) == (1, 0, True)


class Steps(list):
    """News, just before or just after the next of which the main thread steps."""

    assignment, before = None, False

    def append(self, message):
        assignment, self.assignment = self.assignment, None
        if assignment is not None and self.before:
            assignment.step()
        super().append(message)
        if assignment is not None and not self.before:
            assignment.step()


@pytest.mark.parametrize("before", [True, False])
def test_a_step_of_the_main_thread_while_a_message_comes(before):
    node = Node()
    news = node.assignment.news = Steps()
    node.hears_of(0, *NEIGHBOURS[:2])
    news.assignment, news.before = node.assignment, before
    node.hears_of(0, *NEIGHBOURS[2:])
    assert node.generation == 1
    node.hears_of(1, *NEIGHBOURS)
    assert node.generation == 2


class Leaves(list):
    """News; the main thread leaves the assignment just after the next of them has come."""

    node = None

    def append(self, message):
        super().append(message)
        if self.node is not None:
            self.node.driver.leave(self.node.assignment)


def test_a_cell_that_the_main_thread_has_left_steps_no_more():
    node = Node()
    assignment, news = node.assignment, Leaves()
    assignment.news = news
    node.hears_of(0, *NEIGHBOURS[:3])
    news.node = node
    node.hears_of(0, NEIGHBOURS[3])
    assert (node.assignment, assignment.steps, node.published) == (None, 0, [])
    assert not assignment.lock.locked()
    assert node.driver.queue.empty()


class ComesMeanwhile(Cell):
    """A message of the cell 5 comes while it steps."""

    news = ()

    def step(self, *arguments):
        actions = super().step(*arguments)
        self.heard.extend(self.news)
        self.news = ()
        return actions


def test_who_sends_during_a_step_is_not_awaited_after_it():
    node = Node()
    assignment = node.assignment
    cell = assignment.cell = ComesMeanwhile(PLAN, 9, job=1)
    cell.heard, cell.news = assignment.news, [(5, SAID[0][5])]
    assignment.events.append(Start())
    assignment.step()
    assert assignment.missing_senders == {8, 10, 13}
    node.hears_of(0, 8, 10, 13)
    assert node.generation == 1


@pytest.mark.parametrize(
    ("shape", "first"), [("torus 4x4", {1, 3, 4, 12}), ("torus 2x2", {1, 2}), ("torus 1x2", {1}), ("torus 1x1", set())]
)
@pytest.mark.parametrize("interval", [1, 3])
def test_whom_a_cell_waits_for_from_the_start_on(shape, first, interval):
    plan = Plan(PLAN.problem, Run(topology=shape, interval=interval, generations=100))
    cells = plan.topology.cells
    assignment = Assignment(Cell(plan, 0, job=1), SimpleNamespace(cell=0, wiring=Wiring(0, tuple(range(cells)))))
    assert assignment.missing_senders == first
    assignment.events.append(Start())
    assignment.step()
    assert (assignment.missing_senders, assignment.busy) == (first, not first)
    assignment.news += [(other, told(plan, 1)[0][other]) for other in first]
    assignment.step()
    assert assignment.missing_senders == first
    assert assignment.busy == (interval > 1 or not first)
