"""Cells die on an in-process bus, alone or many at once, and others go on from their states: no bit changes."""

import dataclasses
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_max import AskingBus, plan_of

import topologies
from coordinator.jobs.recovering import choose_states, least_stop
from node.cell import Cell, known_stop
from node.events import Propose, Start
from node.simulation import simulate
from spy.result import stop_reasons
from wire.takeover import KeptStates, Takeover

TORUS = topologies.parse("torus 3x4")


class Mortal(AskingBus):
    """A bus on which cells die: ``deaths`` says after how many steps, and how many at once."""

    def __init__(self, plan, source, deaths):
        super().__init__(plan, source)
        self.deaths = deaths
        self.taken_over = 0

    def run(self):
        for after, count in self.deaths:
            for _ in range(after):
                self.one_step()
            if len(self.reports) < len(self.cells):
                self.kill(self.random.sample(range(len(self.cells)), min(count, len(self.cells) - 1)))
        return super().run()

    def reached(self):
        return max(cell.rows.generation for cell in self.cells) + 8 * self.cells[0].plan.run.interval

    def choose(self, dead):
        self.ask_for_states(set(range(len(self.cells))) - set(dead))
        return choose_states(self.cells[0].plan.topology, self.kept, range(len(self.cells)))

    def kill(self, dead):
        chosen = self.choose(dead)
        assert chosen.keys() == set(dead)
        for number in dead:
            plan = self.cells[number].plan
            self.news[number].clear()
            self.reports.pop(number, None)
            self.cells[number] = Cell(plan, number, job=1)
            takeover = Takeover(self.reached(), chosen[number][1], stop_at=least_stop(self.kept))
            self.events[number] = [Start(takeover=takeover)]
            self.taken_over += 1


def without_counters(reports):
    """What must be equal: all but how many messages came by asking."""
    return [dataclasses.replace(report, lost=0, received=0) for report in reports]


SETTINGS = [
    {},
    {"deme": 5},
    {"deme": 4, "emigrants": 2, "interval": 3},
    {"interval": 4},
    {"spy": "root"},
    {"topology": "torus 1x2"},
    {"topology": "ring 7"},
]


@pytest.mark.parametrize("settings", SETTINGS, ids=str)
@pytest.mark.parametrize("seed", range(4))
def test_one_after_another_dies_and_nothing_changes(settings, seed):
    plan = plan_of(size=64, **{"topology": "torus 3x4", "generations": 120, "target": -1.0, "seed": seed} | settings)
    source = random.Random(seed)
    steps = 12 * len(Mortal(plan, source, []).cells)
    bus = Mortal(plan, source, [(source.randrange(steps, 3 * steps), 1) for _ in range(6)])
    assert without_counters(bus.run()) == without_counters(simulate(plan))
    assert bus.taken_over >= 2


@pytest.mark.parametrize("seed", range(8))
def test_a_quarter_dies_at_once_and_nothing_changes(seed):
    plan = plan_of(size=64, topology="torus 4x4", generations=80, target=-1.0, seed=seed)
    source = random.Random(seed)
    bus = Mortal(plan, source, [(600, 4), (300, 1)])
    assert without_counters(bus.run()) == without_counters(simulate(plan))
    assert bus.taken_over >= 4


@pytest.mark.parametrize("seed", range(4))
def test_the_target_is_reached_all_the_same(seed):
    plan = plan_of(size=24, topology="torus 3x4", seed=seed)
    source = random.Random(seed)
    bus = Mortal(plan, source, [(source.randrange(50, 200), 1) for _ in range(3)])
    assert without_counters(bus.run()) == without_counters(simulate(plan))


def beginning_with(plan, source, demes):
    bus = Mortal(plan, source, [])
    for number, deme in enumerate(demes):
        bus.events[number] = [Start(deme)]
    return bus


@pytest.mark.parametrize("seed", range(6))
def test_one_that_dies_as_an_epoch_begins_begins_it_with_the_same_deme(seed):
    plan = plan_of(size=64, topology="torus 3x4", generations=40, target=-1.0, seed=seed, deme=2)
    demes = np.random.default_rng(seed).integers(0, 256, (12, 2, 8), np.uint8)
    undisturbed = beginning_with(plan, random.Random(seed), demes).run()
    bus = beginning_with(plan, random.Random(seed), demes)
    for _ in range(8):
        bus.one_step()
    for number in random.Random(seed).sample(range(12), 3):
        if bus.cells[number].state == "prepared":
            bus.cells[number] = Cell(plan, number, job=1)
            bus.events[number] = [Start(demes[number], Takeover(bus.reached(), b""))]
            bus.taken_over += 1
    assert without_counters(bus.run()) == without_counters(undisturbed)
    assert bus.taken_over


def tell_a_stop_to_one(bus):
    """Let the root propose a stop, and step until another cell knows it; return the stop and that cell's number."""
    root, *others = bus.cells
    while root.rows.generation < 12:
        bus.one_step()
    bus.events[0].append(Propose("deadline"))
    while not root.rows.proposals:
        bus.one_step()
    stop = root.rows.stop_at.item(0)
    while all(known_stop(cell.rows, cell.inbox) is None for cell in others):
        bus.one_step()
    return stop, next(cell.number for cell in others if known_stop(cell.rows, cell.inbox) is not None)


STOPPED = [{"topology": "torus 2x3"}, {"topology": "torus 3x4"}, {"topology": "ring 7"}, {"deme": 4, "interval": 3}]


@pytest.mark.parametrize("settings", STOPPED, ids=str)
@pytest.mark.parametrize("seed", range(20))
def test_all_stop_after_the_same_generation_though_those_died_who_could_tell_the_stop(settings, seed):
    run = {"size": 64, "topology": "torus 3x4", "target": -1.0, "seed": seed} | settings
    source = random.Random(seed)
    bus = Mortal(plan_of(**run), source, [])
    stop, who_knows = tell_a_stop_to_one(bus)
    bus.kill([0, source.choice([cell.number for cell in bus.cells[1:] if cell.number != who_knows])])
    reports = bus.run()
    assert {report.generation for report in reports} == {stop}
    assert [each.digest for each in reports] == [each.digest for each in simulate(plan_of(**run, generations=stop))]


@pytest.mark.parametrize("seed", range(250, 290))
def test_a_new_process_tells_the_stop_that_it_was_told_if_it_dies_before_it_has_bred_so_far(seed):
    run = {"size": 64, "topology": "ring 7", "target": -1.0, "seed": seed}
    source = random.Random(seed)
    bus = Mortal(plan_of(**run), source, [])
    stop, who_knows = tell_a_stop_to_one(bus)
    told = source.choice([cell.number for cell in bus.cells[1:] if cell.number != who_knows])
    bus.kill([0, told])
    while bus.cells[told].state == "prepared":
        bus.one_step()
    if bus.choose([0, who_knows]).keys() != {0, who_knows}:
        return  # as two neighbours died of which one had just taken over: another epoch begins
    bus.kill([0, who_knows])
    assert {report.generation for report in bus.run()} == {stop}


@pytest.mark.parametrize("settings", [*STOPPED, {"size": 24, "target": 0.0, "stall": None}], ids=str)
@pytest.mark.parametrize("seed", range(10))
def test_a_cell_that_proposed_a_stop_by_itself_does_so_again(settings, seed):
    plan = plan_of(**{"size": 64, "topology": "torus 3x4", "target": -1.0, "stall": 20, "seed": seed} | settings)
    source = random.Random(seed)
    bus = Mortal(plan, source, [])
    while not any(cell.rows.proposals for cell in bus.cells):
        bus.one_step()
    proposer = next(cell for cell in bus.cells if cell.rows.proposals)
    while all(known_stop(cell.rows, cell.inbox) is None for cell in bus.cells if cell is not proposer):
        bus.one_step()
    bus.kill([proposer.number])
    reports, expected = bus.run(), simulate(plan)
    assert [report.digest for report in reports] == [report.digest for report in expected]
    assert stop_reasons(reports, "lockstep") == stop_reasons(expected, "lockstep") != ()


@pytest.mark.parametrize("wrong", [b"\0", b"\x05", b"\xff" * 400])
def test_a_state_of_something_else_fails_the_cell_and_says_so(wrong):
    plan = plan_of(topology="torus 3x4")
    cell = Cell(plan, 3, job=1)
    (report,) = cell.step(events=[Start(takeover=Takeover(0, wrong))])
    assert cell.state == "failed"
    assert "state" in report.error


# Which states are chosen ----------------------------------------------------------------------------------------------
def keeping(dead, states, generation=100, oldest=0):
    """What the living cells of the torus keep, if each keeps these states of all its neighbours."""
    return {
        cell: KeptStates(
            cell,
            generation,
            oldest,
            tuple(
                (each, its, b"%d" % its) for each in TORUS.neighbours(cell) if each in states for its in states[each]
            ),
            tuple((each, max(states.get(each, (0,)))) for each in set(TORUS.neighbours(cell))),
            stop_at=None,
        )
        for cell in range(12)
        if cell not in dead
    }


def choose(kept):
    """In an epoch that began with the demes of another one."""
    return choose_states(TORUS, kept, ())


def test_a_cell_that_has_sent_no_state_begins_anew_where_the_epoch_did():
    kept = keeping({5}, {}, generation=3)
    assert choose_states(TORUS, kept, range(TORUS.cells)) == {5: (0, b"")}
    kept[1] = dataclasses.replace(kept[1], oldest=1)
    assert choose_states(TORUS, kept, range(TORUS.cells)) == {}, "its messages are needed from the beginning on"


def test_where_an_epoch_began_with_demes_those_begin_anew_whose_demes_are_known():
    kept = keeping({5}, {}, generation=3)
    assert choose_states(TORUS, kept, {5, 6}) == {5: (0, b"")}
    assert choose_states(TORUS, kept, {6}) == {}


def test_a_cell_alone_goes_on_from_its_latest_state():
    assert choose(keeping({5}, {5: (80, 88, 96)})) == {5: (96, b"96")}


def test_its_neighbours_can_die_next_and_have_the_messages_since_their_own_states():
    beside = dict.fromkeys(TORUS.neighbours(5), (88, 96))
    assert choose(keeping({5}, beside | {5: (80, 88, 96)})) == {5: (96, b"96")}
    assert choose(keeping({5}, beside | {1: (80, 88), 5: (80, 88, 96)})) == {5: (88, b"88")}
    assert choose(keeping({5}, beside | {1: (72,), 5: (80, 88, 96)})) == {5: (96, b"96")}, "it cannot be helped"
    assert choose(keeping({5}, beside | {1: (80, 88, 95), 5: (80, 88, 94)})) == {5: (88, b"88")}, "those also have it"
    assert choose(keeping({5}, beside | {1: (80, 92, 95), 5: (80, 88, 94)})) == {5: (94, b"94")}, "not later at least"


def test_dead_neighbours_go_on_from_the_same_generation_and_others_from_theirs():
    kept = keeping({0, 1, 10}, {0: (80, 88), 1: (88, 96), 10: (80, 96)})
    assert {cell: its for cell, (its, _) in choose(kept).items()} == {0: 88, 1: 88, 10: 96}


def test_a_neighbour_of_two_dead_cells_can_die_next():
    ahead = dict.fromkeys((7, *TORUS.neighbours(7)), (80, 88, 96))
    kept = keeping({5, 7}, dict.fromkeys(range(12), (80, 88)) | ahead)
    assert {cell: its for cell, (its, _) in choose(kept).items()} == {5: 88, 7: 88}, "4 and 6 are beside both"


def test_a_neighbour_that_is_behind_needs_the_messages_since():
    kept = keeping({5}, {5: (80, 88, 96)})
    kept[1] = dataclasses.replace(kept[1], generation=90, states=(), heard=((5, 90),))
    assert choose(kept) == {5: (88, b"88")}


def test_a_neighbour_that_is_behind_may_have_heard_more():
    kept = keeping({5}, {5: (80, 88, 96)})
    kept[1] = dataclasses.replace(kept[1], generation=90)
    assert choose(kept) == {5: (96, b"96")}


@pytest.mark.parametrize(
    ("states", "oldest"),
    [({}, 0), ({5: (80,)}, 81), ({5: (80, 88), 6: (84, 96)}, 0)],
    ids=["none is kept", "the messages are gone", "none in common"],
)
def test_where_there_is_no_such_state_there_is_none(states, oldest):
    assert choose(keeping({5, 6} & {*states, 5}, states, oldest=oldest)) == {}


@given(st.sets(st.integers(0, 11), min_size=1, max_size=11))
def test_every_dead_cell_with_a_living_neighbour_gets_a_state(dead):
    everybody = dict.fromkeys(range(12), (80, 88))
    chosen = choose(keeping(dead, everybody))
    alone = {cell for cell in dead if set(TORUS.neighbours(cell)) <= dead}
    assert chosen.keys() <= dead - alone
    if not alone:
        assert chosen.keys() == dead
