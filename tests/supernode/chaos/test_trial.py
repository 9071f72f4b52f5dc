"""A trial on real processes: what is done is told, and what was lost would be."""

import json
import subprocess
import sys
from dataclasses import replace

import pytest
from command_line import in_process
from user_namespaces import needs_namespaces

from spy.result import Result
from supernode.chaos.report import as_json, in_words
from supernode.chaos.schedule import Fault
from supernode.chaos.trial import Outcome, _stood_still

PROBLEM = 'kind = "function"\nname = "onemax"\ndimension = 64\ncost_us = 500\n[run]\ntorus = "3x3"\n'


@pytest.fixture
def problem(tmp_path):
    path = tmp_path / "ones.toml"
    path.write_text(PROBLEM)
    return path


@pytest.mark.timeout(300)
def test_a_cluster_loses_nothing(problem, capsys):
    code, out, told = in_process(capsys, "chaos", problem, "--for", "6", "--draw", "3", "--json")
    outcome = json.loads(out)
    assert (code, outcome["lost"], outcome["status"]) == (0, [], "cancelled")
    assert outcome["repeats"] is True
    done = [each["process"] for each in outcome["faults"]]
    assert {"spy", "router", "coordinator"} <= set(done)
    assert "kill router" in told


def test_a_run_that_ends_before_the_faults_is_no_failure(problem, capsys):
    code, out, _ = in_process(capsys, "chaos", problem, "--for", "2", "--generations", "1", "--target", "-1", "--quiet")
    assert code == 0
    assert "exhausted after 1 generations" in out
    assert out.endswith("lost: nothing\n")


@needs_namespaces
@pytest.mark.timeout(300)
def test_nothing_is_lost_while_the_disk_is_full(problem):
    command = [sys.executable, "-m", "supernode", "chaos", problem, "--for", "4", "--draw", "2", "--full-disk", "2"]
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    outcome = json.loads(done.stdout)
    assert {"disk"} < {each["process"] for each in outcome["faults"]}
    assert (outcome["lost"], outcome["repeats"]) == ([], True)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--full-disk", "9", "--for", "9"], "--full-disk: expected less than --for, 9, found 9"),
        (["--full-disk", "9", "--simulate"], "--full-disk: expected none with --simulate"),
        (["--hosts", "2", "--simulate"], "--hosts: expected none with --simulate"),
        (["--hosts", "0"], "--hosts: expected 1 to 1000, found 0"),
    ],
)
def test_what_a_trial_cannot_do(problem, capsys, options, said):
    code, _, err = in_process(capsys, "chaos", problem, *options)
    assert code == 2
    assert said in err


def result(**changed):
    made = Result.__new__(Result)
    for name, value in {
        "status": "cancelled",
        "message": None,
        "fitness": 3.0,
        "generations": 9,
        "directives": [],
    }.items():
        object.__setattr__(made, name, changed.get(name, value))
    object.__setattr__(made, "history_sha256", "ab")
    return made


SOUND = Outcome([(1.0, Fault(1.0, "kill", "node 3"))], result(), [0.2, 0.4], {0: 5.0, 1: 3.0}, repeats=True)


@pytest.mark.parametrize(
    ("told", "longest"),
    [
        ([], None),
        ([(1.0, 0, 5)], None),
        ([(1.0, 0, 5), (2.0, 0, 6), (5.5, 0, 9)], 3.5),
        ([(1.0, 0, 5), (2.0, 0, 6), (3.0, 0, 6), (4.0, 0, 6)], 2.0),
        ([(1.0, 0, 900), (2.0, 1, 3), (3.0, 1, 40)], 1.0),
    ],
)
def test_how_long_it_stood_still(told, longest):
    records = [{"at": at, "epoch": epoch, "generation": generation} for at, epoch, generation in told]
    assert _stood_still(records) == longest


def test_what_was_lost_is_said():
    assert SOUND.lost == []
    assert "2 dead cells went on exactly" in in_words(SOUND)
    assert "without news of a new generation: 1.5 s" in in_words(replace(SOUND, stood_still=1.5))
    assert "the others bred at most 7 generations" in in_words(replace(SOUND, bred_apart=[0, 7]))
    assert as_json(SOUND)["whole_again"] == [0.2, 0.4]
    for wrong, words in (
        ({"result": None}, "did not end"),
        ({"result": result(status="failed", message="out of paper")}, "out of paper"),
        ({"result": result(fitness=4.0)}, "worse than an answer"),
        ({"worse_told": 2}, "2 improvements were worse"),
        ({"repeats": False}, "another history"),
        ({"broken": "nobody answers"}, "the cluster broke: nobody answers"),
        ({"result": result(directives=[{"do": "restart"}])}, "all demes were lost"),
    ):
        outcome = replace(SOUND, **wrong)
        assert len(outcome.lost) == 1
        assert words in outcome.lost[0]
        assert f"lost: {outcome.lost[0]}" in in_words(outcome)
