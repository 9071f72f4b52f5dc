"""Where messages are kept, against a plain model of it: dictionaries of what the slow reader reads."""

import dataclasses
import random

import hypothesis
import msgpack
import numpy as np
import pytest
from exchanges import Emigrant, Exchange, decode, read_slowly
from hypothesis import given
from hypothesis import strategies as st
from one_max import plan_of

from node.engine.inbox import NEXT, Inbox, next_exchange
from node.engine.kernels import PUBLISHED, note_staleness
from wire.champion import Champion
from wire.report import Staleness
from wire.strict import Rejected

JOB = 3
EPOCH = 2
TORI = ["torus 1x1", "torus 1x2", "torus 2x2", "torus 2x3", "torus 4x4"]


def plan_in(**settings):
    """A plan of one of a job's later epochs."""
    return dataclasses.replace(plan_of(**settings), epoch=EPOCH)


def take(inbox, generation):
    """The row of each slot's message, to breed the generation after this one with: as `node.engine.rule` takes them."""
    if inbox.source_rows.shape[0] == 2:  # in lockstep
        exchange = inbox.exchange % 2
        next_exchange(inbox.latest, inbox.counts)
        return inbox.source_rows[exchange : exchange + 1]
    note_staleness(inbox.messages.header, inbox.source_rows[0], generation, inbox.used, inbox.staleness)
    return inbox.source_rows


class Model:
    """What an inbox is to do, in plain Python."""

    def __init__(self, plan, cell):
        self.plan = plan
        self.slots = plan.topology.neighbours(cell)
        self.neighbours = [other for other in dict.fromkeys(self.slots) if other != cell]
        self.kept = self.refused = self.of_no_use = 0

    def hear(self, news):
        complaints = set()
        for sender, payload in news:
            if sender not in self.neighbours:
                continue
            message = read_slowly(payload, self.plan.limits)
            if message is None:
                self.refused += 1
                complaints.add((sender, reason_of(payload, self.plan)))
            elif (message.job, message.epoch) != (JOB, EPOCH):
                pass  # whatever it says, it was not meant for this inbox
            elif self.is_of_use(sender, message):
                self.kept += 1
                self.keep(sender, self.as_believed(sender, message))
            else:
                self.of_no_use += 1
        return complaints

    def as_believed(self, sender, message):
        """Under the paper's spy the champion is the best emigrant."""
        if self.plan.run.spy == "champion":
            return message
        best = message.emigrants[0]
        champion = Champion(best.fitness, message.generation, sender, best.genome)
        return dataclasses.replace(message, champion=champion if best.fitness < np.inf else None)


class Lockstep(Model):
    def __init__(self, plan, cell):
        super().__init__(plan, cell)
        self.next = 0
        self.messages = {}  # by exchange and sender

    def is_of_use(self, sender, message):
        exchange, between = divmod(message.generation, self.plan.run.interval)
        return between == 0 and exchange in (self.next, self.next + 1) and (exchange, sender) not in self.messages

    def keep(self, sender, message):
        self.messages[message.generation // self.plan.run.interval, sender] = message

    def missing(self):
        return [other for other in self.neighbours if (self.next, other) not in self.messages]

    def take(self):
        self.next += 1
        return [self.messages.get((self.next - 1, other)) for other in self.slots]


class Async(Model):
    def __init__(self, plan, cell):
        super().__init__(plan, cell)
        self.latest = {}
        self.lost = 0
        self.used = [None] * len(self.slots)
        self.behind = []
        self.again = 0

    def is_of_use(self, sender, message):
        return message.sent > (self.latest[sender].sent if sender in self.latest else 0)

    def keep(self, sender, message):
        self.lost += message.sent - 1 - (self.latest[sender].sent if sender in self.latest else 0)
        self.latest[sender] = message

    def take(self, generation):
        for slot, other in enumerate(self.slots):
            if other in self.latest:
                message = self.latest[other]
                self.behind.append(max(0, generation - message.generation))
                self.again += self.used[slot] == message.sent
                self.used[slot] = message.sent
        return [self.latest.get(other) for other in self.slots]

    @property
    def staleness(self):
        return Staleness(len(self.behind), sum(self.behind), max(self.behind, default=0), self.again)


def reason_of(payload, plan):
    with pytest.raises(Rejected) as caught:
        decode(payload, plan.limits)
    return caught.value.reason


def a_message(rng, generation, sent=1, job=JOB, size=40, emigrants=1, epoch=EPOCH):
    """Any message; now and then somebody is infeasible, nobody is champion, or a stop is proposed."""

    def fitness():
        return rng.choice((rng.random(), rng.random(), np.inf))

    def genome():
        return rng.randbytes(size // 8)

    told = tuple(Emigrant(genome(), fitness()) for _ in range(emigrants))
    champion = rng.choice((None, Champion(rng.random(), rng.randrange(50), 0, genome())))
    return Exchange(job, epoch, generation, rng.choice((None, 99)), told, champion, sent, rng.randrange(1000))


def spoilt(rng, payload):
    bits = bytearray(payload)
    for _ in range(rng.randint(1, 3)):
        bits[rng.randrange(len(bits))] ^= 1 << rng.randrange(8)
    return bytes(bits[: rng.choice((len(bits), rng.randrange(len(bits))))])


def in_slots(inbox, source_row):
    """The messages that the slots stand for; None for the cell's own."""
    (row,) = source_row
    return [None if place <= PUBLISHED else Exchange.of(inbox.messages, place) for place in row]


def some_news(rng, plan, model, generations, sent):
    """A batch, mostly of neighbours' sound messages of this epoch of the job, of now and then hundreds."""
    senders = [*model.neighbours, *model.neighbours, *range(plan.topology.cells)]
    news = []
    for _ in range(rng.choice((0, 1, 1, 2, 5, 30)) if rng.random() < 0.98 else 500):
        job = JOB if rng.random() < 0.9 else rng.randrange(6)
        epoch = EPOCH if rng.random() < 0.9 else rng.randrange(4)
        message = a_message(rng, rng.choice(generations), sent(), job, emigrants=plan.run.emigrants, epoch=epoch)
        payload = message.encode()
        news.append((rng.choice(senders), payload if rng.random() < 0.9 else spoilt(rng, payload)))
        if rng.random() < 0.1:
            news.append(news[-1])
    return news


SETTINGS = [{}, {"interval": 3}, {"spy": "root"}, {"interval": 2, "deme": 4, "emigrants": 3, "spy": "root"}]


@pytest.mark.parametrize("settings", SETTINGS, ids=str)
@pytest.mark.parametrize("shape", TORI)
def test_in_lockstep_it_keeps_what_the_model_keeps(shape, settings):
    rng = random.Random(f"{shape} {settings}")
    plan = plan_in(topology=shape, **settings)
    taken = 0
    for cell in range(min(plan.topology.cells, 6)):
        inbox, model = Inbox(plan, cell, JOB), Lockstep(plan, cell)
        assert list(inbox.neighbours) == model.neighbours
        for _ in range(150):
            near = range(max(0, (model.next - 2) * plan.run.interval), (model.next + 4) * plan.run.interval)
            of_now = [model.next * plan.run.interval, (model.next + 1) * plan.run.interval] * len(near)
            news = some_news(rng, plan, model, [*near, *of_now], lambda: 1)
            assert inbox.hear(news) == model.hear(news)
            assert (inbox.kept, inbox.refused, inbox.lost) == (model.kept, model.refused, 0)
            assert inbox.of_no_use == model.of_no_use
            assert inbox.missing_senders() == set(model.missing())
            assert inbox.missing_count() == len(model.missing())
            if inbox.missing_count() == 0:
                assert in_slots(inbox, take(inbox, model.next * plan.run.interval)) == model.take()
                taken += 1
        assert not inbox.staleness.any()
    assert taken > 20


@pytest.mark.parametrize("settings", SETTINGS, ids=str)
@pytest.mark.parametrize("shape", TORI)
def test_in_async_mode_it_keeps_what_the_model_keeps(shape, settings):
    rng = random.Random(f"{shape} {settings}")
    plan = plan_in(topology=shape, mode="async", **settings)
    for cell in range(min(plan.topology.cells, 6)):
        inbox, model = Inbox(plan, cell, JOB), Async(plan, cell)
        for now in range(150):
            latest = max((message.sent for message in model.latest.values()), default=0)
            ages = range(max(0, now - 10), now + 5)
            news = some_news(
                rng, plan, model, ages, lambda latest=latest: rng.randrange(max(0, latest - 3), latest + 4)
            )
            assert inbox.hear(news) == model.hear(news)
            assert (inbox.kept, inbox.refused, inbox.lost) == (model.kept, model.refused, model.lost)
            assert inbox.of_no_use == model.of_no_use
            if rng.random() < 0.5:
                assert in_slots(inbox, take(inbox, now)) == model.take(now)
            assert Staleness(*inbox.staleness.tolist()) == model.staleness
        if model.neighbours:
            assert min(model.staleness) > 0
            assert min(model.lost, model.refused) > 0


@pytest.mark.parametrize("mode", ["lockstep", "async"])
def test_a_message_of_another_epoch_is_neither_kept_nor_refused_nor_counted_at_all(mode):
    plan = plan_in(topology="torus 1x2", mode=mode)
    inbox = Inbox(plan, 0, JOB)
    rng = random.Random(1)
    before = inbox.counts.copy()
    others = [(JOB, 0), (JOB, EPOCH - 1), (JOB, EPOCH + 1), (JOB + 1, EPOCH)]
    assert inbox.hear([(1, a_message(rng, 0, job=job, epoch=epoch).encode()) for job, epoch in others]) == set()
    assert inbox.counts.tolist() == before.tolist()
    assert inbox.hear([(1, a_message(rng, 0).encode())]) == set()
    assert inbox.kept == 1


def test_the_messages_of_two_exchanges_are_kept_apart():
    plan = plan_in(topology="torus 1x2")
    inbox = Inbox(plan, 0, JOB)
    rng = random.Random(1)
    now, ahead, two_ahead = (a_message(rng, generation) for generation in range(3))
    inbox.hear([(1, ahead.encode()), (1, two_ahead.encode())])
    assert (inbox.kept, inbox.missing_senders(), inbox.missing_count()) == (1, {1}, 1)
    inbox.hear([(1, now.encode())])
    assert (inbox.kept, inbox.missing_senders(), inbox.missing_count()) == (2, set(), 0)
    assert in_slots(inbox, take(inbox, 0)) == [None, now, None, now]
    assert (inbox.missing_senders(), inbox.missing_count()) == (set(), 0)
    assert in_slots(inbox, take(inbox, 1)) == [None, ahead, None, ahead]
    assert (inbox.missing_senders(), inbox.missing_count()) == ({1}, 1)


def test_what_was_taken_stays_as_it_is_while_the_next_exchange_comes_in():
    plan = plan_in(topology="torus 1x2", interval=3)
    inbox = Inbox(plan, 0, JOB)
    rng = random.Random(1)
    first, second = (a_message(rng, generation) for generation in (0, 3))
    inbox.hear([(1, first.encode())])
    source_row = take(inbox, 0)
    inbox.hear([(1, second.encode()), *[(1, spoilt(rng, second.encode())) for _ in range(300)]])
    assert in_slots(inbox, source_row) == [None, first, None, first]


def test_a_cut_message_is_not_read_on_into_the_one_behind_it():
    plan = plan_in(topology="torus 1x2")
    rng = random.Random(1)
    payload = a_message(rng, 0).encode()
    for cut in range(1, len(payload)):
        inbox = Inbox(plan, 0, JOB)
        assert inbox.hear([(1, payload[:cut]), (1, payload[cut:]), (0, payload), (5, b"")])
        assert (inbox.kept, inbox.refused) == (0, 2)


def test_an_empty_message_is_refused_and_the_one_behind_it_read():
    inbox = Inbox(plan_in(topology="torus 1x2"), 0, JOB)
    payload = a_message(random.Random(1), 0).encode()
    assert inbox.hear([(1, b""), (1, payload), (1, b"")]) == {(1, "not msgpack")}
    assert (inbox.kept, inbox.refused) == (1, 2)


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 24)), max_size=80))
@hypothesis.settings(max_examples=50)
def test_it_keeps_the_latest_three_states_of_each_neighbour_however_often_others_send_theirs(sent):
    plan = plan_in(topology="torus 4x4", mode="async", deme=2)
    inbox = Inbox(plan, 5, JOB)
    rng, expected = random.Random(1), {other: [] for other in inbox.neighbours}
    for number, (place, improvements) in enumerate(sent, 1):
        neighbour = inbox.neighbours[place]
        state = rng.randbytes(plan.limits.most_state_bytes - 16 * (24 - improvements))
        message = a_message(rng, number, number).encode()
        inbox.hear([(neighbour, with_state(message, state))])
        expected[neighbour].append((neighbour, number, state))
    assert list(inbox.states) == [state for states in expected.values() for state in states[-3:]]
    assert inbox.kept == len(sent)


@given(st.lists(st.integers(1, 6), max_size=60), st.sampled_from((1, 3)))
@hypothesis.settings(max_examples=50)
def test_in_lockstep_states_that_all_tell_are_not_displaced_by_others(steps, interval):
    plan = plan_in(topology="torus 4x4", mode="lockstep", deme=2, interval=interval)
    inbox = Inbox(plan, 5, JOB)
    rng, neighbour, expected, generation = random.Random(1), inbox.neighbours[0], [], 0
    for step in steps:
        generation += step * interval
        state = rng.randbytes(plan.limits.most_state_bytes - 16 * rng.randrange(25))
        inbox.hear([(neighbour, with_state(a_message(rng, generation, generation).encode(), state))])
        if expected and expected[-1][1] % (4 * interval):
            expected.pop()
        expected.append((neighbour, generation, state))
        assert list(inbox.states) == expected[-3:]


def with_state(message, state):
    """The message with one field more."""
    return bytes([message[0] + 1]) + message[1:] + msgpack.packb(state)


def test_messages_of_cells_with_large_numbers():
    plan = plan_in(topology="torus 20x20")
    inbox, payload = Inbox(plan, 300, JOB), a_message(random.Random(1), 0).encode()
    assert inbox.hear([(other, payload) for other in plan.topology.neighbours(300)]) == set()
    assert inbox.missing_senders() == set()


def test_before_anything_is_heard_the_cell_stands_in_for_its_neighbours():
    inbox = Inbox(plan_in(mode="async"), 5, JOB)
    assert (take(inbox, 0) <= PUBLISHED).all()
    assert inbox.hear([]) == set()
    assert not inbox.staleness.any()


@pytest.mark.parametrize("mode", ["lockstep", "async"])
def test_each_neighbour_has_a_row_of_its_own_in_each_exchange(mode):
    rng = random.Random(1992)
    plan = plan_in(topology="torus 2x3", mode=mode)
    slots = plan.topology.neighbours(0)
    inbox, model = Inbox(plan, 0, JOB), Model(plan, 0)
    for _ in range(300):
        now = int(inbox.counts[NEXT])
        inbox.hear(some_news(rng, plan, model, (now, now + 1), lambda: rng.randrange(100)))
        held = {
            (row, other, exchange)
            for exchange, source_row in enumerate(inbox.source_rows.tolist())
            for other, row in zip(slots, source_row, strict=True)
            if row > PUBLISHED
        }
        assert len({row for row, *_ in held}) == len({(other, exchange) for _, other, exchange in held}) == len(held)
        assert all(0 < row < len(inbox.messages.header) for row, *_ in held)
        if mode == "lockstep" and inbox.missing_count() == 0:
            take(inbox, now)
