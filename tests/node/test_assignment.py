"""What a node makes of how long its generations take."""

import time
from types import SimpleNamespace

import pytest
from one_max import plan_of

from lowlevel import capabilities
from node.assignment import Assignment
from node.cell import Cell
from node.cpu_affinity import LONG
from node.events import Halt, Start
from node.plan import Plan
from problems import Run
from problems.function import Function
from wire.control import Wiring


@pytest.fixture
def clock(monkeypatch):
    """Processor time that goes on by so many seconds with each look at it; two cores."""
    shown = SimpleNamespace(now=0.0, step=0.0)

    def look():
        shown.now += shown.step
        return shown.now

    monkeypatch.setattr(time, "thread_time", look)
    monkeypatch.setattr("node.cpu_affinity.CORES", [2, 3])
    return shown


def compiled(mode, **run):
    return Plan(Function(kind="function", name="onemax", dimension=8), Run(topology="torus 4x4", mode=mode, **run))


def in_python(mode):
    return plan_of(topology="torus 4x4", mode=mode)


def started(plan):
    """The node on the cell 9, and what it needs to breed once: the first messages of its neighbours."""
    first = {other: Cell(plan, other, job=1).step(events=[Start()])[0] for other in (5, 8, 10, 13)}
    links = SimpleNamespace(cell=9, wiring=Wiring(0, tuple(range(16))))
    assignment = Assignment(Cell(plan, 9, job=1), links)
    assignment.events.append(Start())
    assignment.news += first.items()
    return assignment


@pytest.mark.skipif(not capabilities().numba_calls, reason="no plan breeds in compiled code here")
@pytest.mark.parametrize(
    ("plan", "seconds", "core", "slice_seconds", "needs_token"),
    [
        (compiled("lockstep"), 1e-4, 3, 0.0, False),
        # where nodes wait for each other, some have more to do than others
        (compiled("lockstep"), 1e-2, None, 0.0, False),
        # it is in Python most of the time, and so is the network thread
        (compiled("async"), 1e-4, None, 0.0, False),
        (compiled("async"), 1e-2, 3, LONG, True),
        (compiled("async"), 2 * LONG, 3, LONG, False),
        (in_python("async"), 1e-2, None, 0.0, False),
    ],
    ids=["inline", "lockstep", "async inline", "async", "async, longer than a turn", "async in Python"],
)
def test_who_keeps_to_a_core(clock, plan, seconds, core, slice_seconds, needs_token):
    assignment = started(plan)
    assert (assignment.core, assignment.slice_seconds) == (None, 0.0)
    clock.step = seconds
    assignment.step()
    assert assignment.cell.rows.generation == 1
    assert (assignment.core, assignment.slice_seconds, assignment.needs_token) == (core, slice_seconds, needs_token)
    assignment.events.append(Halt())
    assignment.step()
    assert (assignment.core, assignment.slice_seconds) == (None, 0.0)
    assert (assignment.needs_token, assignment.hears) == (False, False)


def test_after_a_slow_generation_the_next_is_measured_too(clock):
    assignment = started(compiled("lockstep", interval=3))
    clock.step = 1e-2  # as the first one can be, whose code and memory nobody has touched
    assignment.step()
    assert not assignment.inline
    clock.step = 1e-4
    assignment.step()
    assert assignment.inline
    assert assignment.cell.rows.generation == 2
