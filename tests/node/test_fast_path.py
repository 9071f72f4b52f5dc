"""The fast path: the same lives as by the ordinary way, whatever comes between, and nothing swallowed."""

import gc
import random
import sys
import threading
from dataclasses import replace
from types import SimpleNamespace

import pytest
from functions import DEMES, PROBLEMS, plan_of
from lone_node import LoneNode

from lowlevel import capabilities
from node.assignment import MANY_UNREAD, Coming
from node.cell import Cell
from node.core_token import CoreToken
from node.events import Ask, Complain, Start, Waited
from node.plan import Plan
from node.simulation import simulate
from problems import Run
from problems.function import Function
from wire.report import Report

pytestmark = pytest.mark.skipif(not capabilities().c_api, reason="the fast path must not be used here")

SHAPES = ["torus 1x2", "torus 2x3", "torus 4x4"]
TIMES = 5000
ENDS = [{"generations": 150}, {"target": -1.0, "stall": 70}, {}]  # the last: the problem's own target


@pytest.fixture(autouse=True)
def cores(monkeypatch):
    monkeypatch.setattr("node.cpu_affinity.CORES", list(range(16)))  # so many that nobody keeps to one


class Torus:
    """Nodes whose messages come in any order, but for those of one sender."""

    def __init__(self, plan, seed, disturb=0.0):
        self.nodes = [LoneNode(plan, cell) for cell in range(plan.topology.cells)]
        self.random = random.Random(seed)
        self.disturb = disturb
        self.bad = 0  # messages of cells that had not ended
        self.on_their_way = {
            (other, node.assignment.cell.number): [] for node in self.nodes for other in node.assignment.cell.neighbours
        }

    def run(self):
        """What the nodes report."""
        for number in range(len(self.nodes)):
            self.collect(number)
        while any(self.on_their_way.values()):
            sender, number = self.random.choice([edge for edge, payloads in self.on_their_way.items() if payloads])
            payload = self.on_their_way[sender, number].pop(0)
            if self.random.random() < self.disturb:
                self.disturb_it(number, sender, payload)
            self.nodes[number].gets(sender, payload)
            self.collect(number)
        for node in self.nodes:
            node.run_queued()
        return [action for node in self.nodes for action in node.done if isinstance(action, Report)]

    def collect(self, number):
        node = self.nodes[number]
        while not node.assignment.inline and node.assignment.busy:  # this machine has been slow for once
            node.carries_on()
        for payload in node.published:
            for other in node.assignment.cell.neighbours:
                self.on_their_way[number, other].append(payload)
        node.published.clear()

    def disturb_it(self, number, sender, payload):
        node = self.nodes[number]
        assignment = node.assignment
        what = self.random.choice(["bad", "again", "waited", "main thread", "turn"])
        if what == "bad":
            self.bad += not assignment.cell.ended
            node.gets(sender, payload[:-1])
        elif what == "again":
            node.gets(sender, payload)
        elif what == "waited":
            assignment.events.append(Waited())
            node.carries_on()
        elif what == "main thread":
            node.carries_on()
        else:
            with assignment.lock:
                node.gets(sender, payload)
            while assignment.busy:
                node.carries_on()


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("shape", SHAPES)
def test_nodes_report_what_the_simulator_does(shape, name):
    number = SHAPES.index(shape) + list(PROBLEMS).index(name)
    for spy in ("champion", "root"):
        for interval in (1, 3):
            number += 1
            end = ENDS[number % len(ENDS)]
            rule = {"topology": shape, "spy": spy, "interval": interval} | DEMES[number % len(DEMES)] | end
            plan = plan_of(name, **rule)
            torus = Torus(plan, number)
            assert torus.run() == simulate(plan), rule
            assert all(node.driver.queue.empty() for node in torus.nodes)


def test_hardly_any_generation_goes_the_ordinary_way():
    plan = plan_of("onemax", topology="torus 4x4", target=-1.0, generations=640)
    torus = Torus(plan, 1)
    torus.run()
    steps = sum(node.assignment.steps for node in torus.nodes) / len(torus.nodes)
    assert 640 / 64 <= steps <= 20


@pytest.mark.parametrize("seed", range(20))
def test_whatever_comes_between_their_lives_are_the_same(seed):
    name = list(PROBLEMS)[seed % len(PROBLEMS)]
    plan = plan_of(name, topology="torus 2x3", interval=1 + seed % 2, target=-1.0, generations=90)
    torus = Torus(plan, seed, disturb=0.15)
    reports = torus.run()
    assert [report.digest for report in reports] == [report.digest for report in simulate(plan)]
    assert [report.received for report in reports] == [report.received for report in simulate(plan)]
    assert sum(report.rejected for report in reports) == torus.bad > 0
    done = [action for node in torus.nodes for action in node.done]
    assert {type(action) for action in done} == {Report, Complain, Ask}


def in_async(**run):
    """A plan whose generations take so long that a node breeds a dozen in a turn."""
    fields = {"kind": "function", "name": "onemax", "dimension": 30, "cost_us": 200}
    return Plan(Function.model_validate(fields), Run(topology="torus 4x4", mode="async", **run))


def waiting_for_turns(plan):
    """The root of nodes that share one core."""
    return LoneNode(plan, 0, inline=False, core_tokens={0: CoreToken(1.0)})


@pytest.mark.parametrize("bad", [False, True])
@pytest.mark.parametrize("end", [{"target": -1.0, "generations": 150}, {"target": -1.0, "stall": 40}, {}])
def test_a_turn_is_the_same_as_its_generations_one_by_one(one_core, end, bad):
    plan, rng = in_async(seed=3, **end), random.Random(1)
    node, cell = waiting_for_turns(plan), Cell(plan, 0, job=1)
    assignment, wanted = node.assignment, cell.step(events=[Start()])
    others = {other: Cell(plan, other, job=1) for other in cell.neighbours}
    said = {other: each.step(events=[Start()]) for other, each in others.items()}
    in_turns = 0
    while not assignment.cell.ended:
        for other in rng.sample(list(others), 2):
            node.gets(other, said[other][-1])
            said[other] += others[other].step() if not others[other].ended else []
        if bad and rng.random() < 0.5:
            node.gets(1, b"bad")
        news, before = list(assignment.news), node.generation
        node.carries_on()
        in_turns += node.generation > before + 1
        for generation in range(before, node.generation):
            wanted += cell.step(news if generation == before else [])
    reports = [action for action in (*node.done, *wanted) if isinstance(action, Report)]
    assert [replace(report, sent=0) for report in reports] == [replace(reports[1], sent=0)] * 2
    assert reports[0].sent == len(node.published) < node.generation / 2
    assert in_turns > 2
    assert (reports[0].rejected > 0) == bad
    assert {type(action) for action in node.done} == ({Report, Complain} if bad else {Report})


def test_in_async_mode_messages_are_put_among_the_news(one_core):
    node = waiting_for_turns(in_async(generations=1000))
    node.carries_on()
    payloads = [bytes([number]) * 9 for number in range(MANY_UNREAD)]
    for payload in payloads[:-1]:
        node.gets(1, payload)
    assert node.assignment.news == [(1, payload) for payload in payloads[:-1]]
    alone = sys.getrefcount(bytes(100))
    assert {sys.getrefcount(payloads[number]) for number in range(MANY_UNREAD - 2)} == {alone + 2}
    with node.assignment.lock:
        node.gets(1, payloads[-1])
    assert len(node.assignment.news) == MANY_UNREAD
    node.gets(1, payloads[-1])
    assert (node.assignment.news, node.assignment.cell.inbox.refused) == ([], MANY_UNREAD + 1)


def test_in_async_mode_an_epoch_to_come_hears_its_messages(one_core):
    node = waiting_for_turns(in_async(generations=1000))
    node.carries_on()
    node.driver.coming = Coming(1, node.assignment.cell.plan, None, None, b"")
    node.carries_on()
    node.gets(1, b"for any epoch")
    assert node.driver.coming.news == node.assignment.news == [(1, b"for any epoch")]
    node.driver.coming = None
    node.carries_on()
    assert node.fast_path.is_open(node.assignment)


@pytest.mark.parametrize("payload", ["good", "bad"])
def test_what_comes_during_a_turn_is_looked_at_in_it(one_core, payload):
    plan = in_async(target=-1.0, generations=10**6)
    node = waiting_for_turns(plan)
    assignment, inbox = node.assignment, node.assignment.cell.inbox
    sender = Cell(plan, 1, job=1)
    said = sender.step(events=[Start()])[-1:]
    turns = 0
    for _ in range(1000):
        if turns == 3:
            break
        said += sender.step()
        over = threading.Event()
        telling = threading.Thread(target=tell_in_turn, args=(node, said[-1] if payload == "good" else b"bad", over))
        in_turn = assignment.needs_token and node.fast_path.is_open(assignment) and not assignment.is_to_be_measured
        before, kept, refused = node.generation, inbox.kept, inbox.refused
        telling.start()
        node.carries_on()
        over.set()
        telling.join()
        if in_turn and node.generation > before + 1 and payload == "good":
            turns += inbox.kept > kept
        elif in_turn and node.generation > before and payload == "bad":
            assert inbox.refused == refused
            turns += assignment.news[-1:] == [(1, b"bad")]
        while assignment.news:
            node.carries_on()
    assert turns == 3
    node.turn_taking.hand_on()
    assert assignment.cell.sent == len(node.published)


def tell_in_turn(node, payload, over):
    """As the network thread does, while the main thread is at it, or else afterwards."""
    while not node.assignment.lock.locked() and not over.is_set():
        pass
    node.gets(1, payload)


@pytest.fixture
def one_core(monkeypatch):
    monkeypatch.setattr("node.cpu_affinity.CORES", [0])


@pytest.fixture
def pair(monkeypatch):
    """Two neighbours on the fast path, the second with its message for the first still unsent."""
    monkeypatch.setattr("node.assignment.INLINE_SECONDS", 1.0)  # so that no busy machine takes them off it
    plan = plan_of("onemax", topology="torus 1x2", target=-1.0, generations=3000)
    one, other = LoneNode(plan, 0), LoneNode(plan, 1)
    for _ in range(5):
        one.gets(1, other.published.pop(0))
        other.gets(0, one.published.pop(0))
    assert (one.generation, one.assignment.steps) == (5, 1)
    return one, other


class Interrupted(list):
    """News; the main thread steps just before or just after the next."""

    steps, before = None, False

    def append(self, message):
        steps, self.steps = self.steps, None
        if steps is not None and self.before:
            steps()
        super().append(message)
        if steps is not None and not self.before:
            steps()


@pytest.mark.parametrize("before", [True, False])
def test_the_path_opens_while_a_message_is_on_its_ordinary_way(before):
    plan = plan_of("onemax", topology="torus 4x4", target=-1.0, generations=1000)
    node = LoneNode(plan, 9)
    news = node.assignment.news = Interrupted()
    *first, third, last = [(other, LoneNode(plan, other).published[0]) for other in node.assignment.cell.neighbours]
    for sender, payload in first:
        node.gets(sender, payload)

    def steps():
        node.assignment.events.append(Waited())
        node.carries_on()
        assert node.fast_path.is_open(node.assignment)

    news.steps, news.before = steps, before
    node.hears(*third)
    assert (node.generation, news.steps) == (0, None)
    node.gets(*last)
    assert node.generation == 1


def test_a_message_of_the_next_epoch_waits_for_it(pair):
    one, other = pair
    plan = plan_of("onemax", topology="torus 1x2", target=-1.0, generations=1000)
    plan = type(plan)(plan.problem, plan.run, 1)
    (early,) = LoneNode(plan, 1).published
    one.driver.coming = Coming(1, plan, None, None, b"")
    one.gets(1, early)
    assert (one.driver.coming.news, one.generation) == ([(1, early)], 5)
    one.gets(1, other.published.pop(0))
    assert one.generation == 6


def test_while_another_thread_has_the_turn_nothing_is_bred(pair):
    one, other = pair
    with one.assignment.lock:
        one.gets(1, other.published.pop(0))
        assert (one.generation, one.assignment.busy) == (5, True)
    one.carries_on()
    assert one.generation == 6


def test_what_cannot_be_published_ends_the_process(pair):
    one, other = pair

    def breaks(_):
        raise ZeroDivisionError

    one.assignment.links.publish = breaks
    one.gets(1, other.published.pop(0))
    with pytest.raises(ZeroDivisionError):
        one.run_queued()
    assert not one.assignment.lock.locked()


def test_who_publishes_may_change(pair):
    one, other = pair
    before, after = len(one.published), []
    one.assignment.links.publish = after.append
    one.gets(1, other.published.pop(0))
    assert (len(one.published), len(after)) == (before, 1)


def test_a_step_for_the_epoch_before_leaves_this_one_its_fast_path(pair):
    one, other = pair
    past = LoneNode(plan_of("onemax", topology="torus 1x2", generations=10), 0).assignment
    one.driver.carry_on(past)
    one.gets(1, other.published.pop(0))
    assert (one.generation, one.assignment.steps) == (6, 1)


def test_a_job_that_is_forgotten_hears_nothing_more(pair):
    one, other = pair
    cell = one.assignment.cell
    one.driver.leave(one.assignment)
    one.gets(1, other.published.pop(0))
    assert (one.assignment, cell.rows.generation, cell.inbox.missing_count()) == (None, 5, 1)


def test_what_is_no_sample_is_an_error_of_the_caller(pair):
    one, _ = pair
    with pytest.raises(AttributeError, match="payload"):
        one.handlers[1](object())
    with pytest.raises(TypeError):
        one.handlers[1](SimpleNamespace(payload=None))
    with pytest.raises(TypeError):
        one.handlers[1]()


def test_no_object_is_kept_or_given_back_twice(pair):
    one, other = pair
    objects = [None, True, False, "payload", "publish", *one.fast_path._objects]
    payloads = []
    before = [sys.getrefcount(each) for each in objects]
    for _ in range(2000):
        payloads.append(other.published.pop(0))
        one.gets(1, payloads[-1])
        payloads.append(one.published.pop(0))
        other.gets(0, payloads[-1])
    after = [sys.getrefcount(each) for each in objects]
    assert one.generation == 2005
    # Others use None too, but not once for each message.
    assert all(abs(more - less) < 500 for less, more in zip(before, after, strict=True))
    alone = sys.getrefcount(bytes(100))
    assert {sys.getrefcount(payloads[number]) for number in range(len(payloads))} == {alone + 1}


class PassesTheLock:
    """A payload during whose reading other threads run: one of them closes the path."""

    def __init__(self, payload, meanwhile):
        self.payload, self.meanwhile = payload, meanwhile

    def __bytes__(self):
        self.meanwhile()
        return self.payload

    def to_bytes(self):
        return self.payload


@pytest.mark.parametrize("mode", ["lockstep", "async"])
def test_a_path_that_is_closed_while_a_payload_is_read_takes_no_message(mode):
    """Thousands of times, by another thread: each message must go the ordinary way, and none be lost or taken twice."""
    plan = plan_of("onemax", topology="torus 2x3", mode=mode, target=-1.0, generations=100_000)
    node = LoneNode(plan, 0, inline=mode == "lockstep")
    node.carries_on()
    sender = node.assignment.cell.neighbours[0]
    payload = Torus(plan, 1).nodes[sender].published[0]
    ordinary, asked, closed = [], threading.Semaphore(0), threading.Semaphore(0)
    handler = node.fast_path.make_handler(sender, ordinary.append)

    def close():
        for _ in range(TIMES):
            asked.acquire()
            node.fast_path.close(node.assignment)
            closed.release()

    def meanwhile():
        asked.release()
        closed.acquire()

    closer = threading.Thread(target=close, daemon=True)
    closer.start()
    received = node.assignment.cell.inbox.kept
    for _ in range(TIMES):
        node.fast_path.open(node.assignment, pytest.fail)
        assert node.fast_path.is_open(node.assignment)
        handler(SimpleNamespace(payload=PassesTheLock(payload, meanwhile)))
    closer.join()
    assert len(ordinary) == TIMES
    assert node.assignment.news == []
    assert node.assignment.cell.inbox.kept == received


@pytest.mark.parametrize("mode", ["lockstep", "async"])
def test_an_assignment_that_is_forgotten_while_a_payload_is_read_is_not_touched(mode):
    """Its memory may be another's by then."""
    plan = plan_of("onemax", topology="torus 2x3", mode=mode, target=-1.0, generations=100_000)
    payload = Torus(plan, 1).nodes[1].published[0]
    ordinary = []
    for _ in range(4):
        node = LoneNode(plan, 0, inline=mode == "lockstep")
        handler = node.fast_path.make_handler(1, ordinary.append)
        node.carries_on()

        def forget(node=node):
            node.driver.leave(node.assignment)
            gc.collect()

        handler(SimpleNamespace(payload=PassesTheLock(payload, forget)))
    assert len(ordinary) == 4
