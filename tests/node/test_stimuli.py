"""What an error shows of a cell's latest steps, and that a cell whose state is wrong is noticed."""

import numpy as np
import pytest
from one_max import plan_of
from valid_cells import validate

from node.cell import Cell
from node.events import Answered, Asked, Propose, Start, Waited
from node.stimuli import _KEPT, Stimuli


def running(**run):
    """A cell that has bred a generation, and its neighbours' first messages."""
    plan = plan_of(target=-1.0, **run)
    news = [(other, Cell(plan, other, job=1).step(events=[Start()])[0]) for other in (12, 1, 4, 3)]
    cell = Cell(plan, 0, job=1)
    cell.step(events=[Start()])
    cell.step(news)
    return cell


def test_each_step_is_a_line():
    stimuli = Stimuli()
    stimuli.note(0, 0, [Start(np.zeros((1, 5), np.uint8))])
    stimuli.note(0, 4, [])
    stimuli.note(1, 2, [Answered(3, 7, [bytes(99)]), Asked(1, object()), Waited(), Propose("cancel")])
    assert str(stimuli).splitlines() == [
        "  in generation 0: 0 messages; Start()",
        "  in generation 0: 4 messages",
        "  in generation 1: 2 messages; "
        "Answered(sender=3, generation=7), Asked(generation=1), Waited(), Propose(reason=cancel)",
    ]


def test_only_the_latest_steps_are_kept():
    stimuli = Stimuli()
    for generation in range(3 * _KEPT):
        stimuli.note(generation, 4, [])
    lines = str(stimuli).splitlines()
    assert len(lines) == _KEPT
    assert lines[-1] == f"  in generation {3 * _KEPT - 1}: 4 messages"


def test_a_mistake_in_the_program_shows_what_the_cell_was_given(monkeypatch):
    cell = running()

    def breaks():
        raise ZeroDivisionError

    monkeypatch.setattr(cell, "_questions", breaks)
    with pytest.raises(ZeroDivisionError) as error:
        cell.step(events=[Waited()])
    (note,) = error.value.__notes__
    assert note.splitlines() == [
        "cell 0, running, in generation 1; lately it was given:",
        "  in generation 0: 0 messages; Start()",
        "  in generation 0: 4 messages",
        "  in generation 1: 0 messages; Waited()",
    ]


WRONG = {
    "the number missing is wrong": lambda cell: cell.inbox.counts.__setitem__(2, 1),
    "rows are lost, or used twice": lambda cell: cell.inbox.source_rows.__setitem__((0, 0), 2),
    "a fitness is NaN or -inf": lambda cell: cell.rows.fitness.fill(np.nan),
    "an individual is fitter than the champion": lambda cell: cell.rows.fitness.fill(-1.0),
    "the message is of another generation": lambda cell: cell.rows.clock.__iadd__(3),
    "the champion became fitter in the future": lambda cell: cell.rows.better_at.fill(2),
    "an improvement is none": lambda cell: cell.generations._birth_count.fill(3),
    "the cell runs on after its last generation": lambda cell: cell.rows.stop_at.fill(1),
    "a message was left out, or sent twice": lambda cell: cell.take_back(),
    "the first emigrant is not the fittest individual": lambda cell: cell.rows.messages.fitness[0, :1].fill(99.0),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_must_hold_between_steps_is_checked(what):
    cell = running()
    validate(cell)
    WRONG[what](cell)
    with pytest.raises(AssertionError, match=what) as error:
        validate(cell)
    assert "row" in what or "missing" in what or "in generation 0: 4 messages" in str(error.value)
