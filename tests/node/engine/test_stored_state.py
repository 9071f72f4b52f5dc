"""What a state says without its cell is what the cell reports if it stops there."""

import dataclasses

import pytest
from one_max import plan_of

from node.cell import Cell
from node.engine import sha256, state_size
from node.engine.stored_state import of_job, report_of
from node.events import AskedForStates, Start
from node.simulation import simulate
from wire.report import Staleness
from wire.takeover import Takeover


def states_of(plan, generation):
    """By cell, the state in a generation that its neighbours keep, on a ring of cells that take turns."""
    cells = [Cell(plan, number, job=1) for number in range(plan.topology.cells)]
    news = [[] for _ in cells]
    events = [[Start()] for _ in cells]
    kept = {}
    while len(kept) < len(cells):
        for cell in cells:
            taken, news[cell.number] = news[cell.number], []
            for action in cell.step(taken, events[cell.number]):
                if isinstance(action, bytes):
                    for other in cell.neighbours:
                        news[other].append((cell.number, action))
                elif hasattr(action, "kept"):
                    kept |= {whose: state for whose, its, state in action.kept.states if its == generation}
            events[cell.number] = [AskedForStates(None, once=True)] if cell.rows.generation >= generation else []
    return kept


@pytest.mark.parametrize("settings", [{}, {"deme": 5, "emigrants": 2}], ids=str)
def test_it_says_what_the_cell_would_report(settings):
    generation = 8
    run = {"topology": "ring 5", "target": -1.0} | settings
    states = states_of(plan_of(size=64, generations=40, **run), generation)
    for expected in simulate(plan_of(size=64, generations=generation, **run)):
        plan = plan_of(size=64, **run)
        report = report_of(states[expected.cell], expected.cell, plan.run.deme, plan.run.emigrants)
        unknown = {"champion": None, "received": 0, "staleness": Staleness(0, 0, 0, 0), "proposals": (), "state": b""}
        # A cell that goes on has sent one message more.
        assert report == dataclasses.replace(expected, sent=expected.sent + 1, **unknown)


def test_the_size_counts_a_digest_as_it_is():
    assert state_size._SHA256 == sha256.STATE


def test_one_of_another_size_is_refused():
    with pytest.raises(ValueError, match="does not have 700 bytes"):
        report_of(bytes(700), 0, 7, 1)


def test_another_job_can_go_on_from_it():
    plan = plan_of(size=64, topology="ring 5", target=-1.0, generations=40)
    state = states_of(plan, 8)[0]
    cell = Cell(plan, 0, job=9)
    cell.step(events=[Start(takeover=Takeover(8, of_job(state, 9)))])
    assert (cell.state, cell.rows.generation) == ("running", 8)
