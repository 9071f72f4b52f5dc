"""Faults of a simulated cluster that wait for a step of a job strike just after it."""

import re
from dataclasses import replace

import pytest

from supernode.chaos.simulated.plans import NEIGHBOUR, PROPOSER, Fault, Plan, PlannedJob
from supernode.chaos.simulated.trial import run

JOB = PlannedJob(0.0, "torus 2x3", "lockstep", seed=1, deme=1, generations=200, seconds=None)
PLAN = Plan(1, "torus 2x3", (), (JOB,), (), latency=1e-3, work=5e-3, faults=())


def killed(outcome):
    return [line.split("kill ")[1] for line in outcome.log if re.search(r"\bkill \w", line)]


@pytest.mark.parametrize("step", ["question", "prepare", "begin", "finish", "drop"])
@pytest.mark.parametrize("whom", ["spy", "coordinator", "node 2"])
def test_a_fault_strikes_after_a_step_of_a_job(file, step, whom):
    outcome = run(replace(PLAN, faults=(Fault(1e-3, "kill", whom, upon=step, count=1),)), file)
    assert outcome.broken == []
    assert killed(outcome) == [f"{whom} after {step} 1"]


def test_a_fault_strikes_once_however_often_the_step_is_made(file):
    # The first two are to the nodes and to the spy, as the job begins.
    faults = Fault(0.5, "kill", "node 1"), Fault(1e-3, "kill", "node 2", upon="prepare", count=3)
    outcome = run(replace(PLAN, faults=faults), file)
    assert outcome.broken == []
    assert killed(outcome) == ["node 1", "node 2 after prepare 3"]


def test_a_cell_that_proposes_to_stop_dies_with_a_neighbour(file):
    faults = tuple(Fault(0.0, "kill", whom, upon="proposal", count=1) for whom in (PROPOSER, NEIGHBOUR))
    outcome = run(replace(PLAN, jobs=(replace(JOB, generations=5000, stall=5),), faults=faults), file)
    assert outcome.broken == []
    one, other = killed(outcome)
    assert one == "node 0 after proposal 1"
    assert re.fullmatch(r"node [1-5] after proposal 1", other)


def test_a_fault_whose_step_is_not_made_does_not_strike(file):
    outcome = run(replace(PLAN, faults=(Fault(0.0, "kill", "node 2", upon="halt", count=1),)), file)
    assert outcome.broken == []
    assert killed(outcome) == []
