"""A trial on several hosts: one that is cut off holds up all others, and nothing is lost."""

import json
import os
import subprocess
import sys

import pytest
from places import ROOT
from user_namespaces import needs_namespaces

from coordinator.threads import ONE_THREAD
from supernode.chaos.schedule import Fault
from supernode.chaos.trial import _bred_apart

# A node dies while its host is cut off; later the other host dies.
SCRIPT = """
import json, sys
from pathlib import Path
from supernode.chaos.network import Network

network = Network(2)  # before anything starts a thread
from problems import load
from supernode.chaos import report, trial
from supernode.chaos.schedule import Fault

faults = [
    Fault(1.0, "part", "host 1", 6.0),
    Fault(4.0, "kill", "node 8"),
    Fault(7.5, "kill", "host 0"),
]
file = load(sys.argv[1]).with_run(target=-1.0, stall=10**9)
outcome = trial.run(file, faults, False, lambda line: None, network=network)
print(json.dumps(report.as_json(outcome)))
"""
PROBLEM = 'kind = "function"\nname = "onemax"\ndimension = 64\n[run]\ntorus = "3x3"\n'


@needs_namespaces
@pytest.mark.timeout(300)
def test_a_cut_holds_up_all_cells_and_loses_nothing(tmp_path):
    problem = tmp_path / "ones.toml"
    problem.write_text(PROBLEM)
    command, variables = [sys.executable, "-c", SCRIPT, problem], os.environ | ONE_THREAD
    done = subprocess.run(command, cwd=ROOT, env=variables, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    outcome = json.loads(done.stdout)
    assert [(each["do"], each["process"]) for each in outcome["faults"]] == [
        ("part", "host 1"),
        ("kill", "node 8"),
        ("kill", "host 0"),
    ]
    assert (outcome["lost"], outcome["repeats"]) == ([], True)
    (bred,) = outcome["bred_apart"]
    assert bred == 0
    assert outcome["generations"] > 100  # of which many in so many seconds if the cut were none


@pytest.mark.parametrize(
    ("told", "bred"),
    [
        ([(12.5, 0, 40), (13.5, 0, 41), (14.5, 0, 41)], [1]),
        ([(11.0, 0, 30), (12.5, 0, 40), (15.5, 0, 90)], []),  # only one piece of news is of the time
        ([(12.5, 0, 900), (13.5, 1, 7), (14.5, 1, 9)], [2]),
        ([], []),
    ],
)
def test_what_was_bred_apart(told, bred):
    records = [{"at": at, "epoch": epoch, "generation": generation} for at, epoch, generation in told]
    assert _bred_apart([(10.0, Fault(1.0, "part", "host 1", 5.0))], records) == bred
    assert _bred_apart([(10.0, Fault(1.0, "kill", "host 1"))], records) == []
