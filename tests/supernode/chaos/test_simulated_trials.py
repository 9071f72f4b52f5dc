"""Simulated clusters lose nothing under drawn faults; a seed repeats a trial; a bug that is planted is found."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import in_process

from benchmarks import planted_bugs
from supernode.chaos.simulated import invariants
from supernode.chaos.simulated.campaign import in_words, trial
from supernode.chaos.simulated.drawing import drawn
from supernode.chaos.simulated.plans import Fault, Plan, PlannedHost, PlannedJob, PlannedRequest
from supernode.chaos.simulated.trial import Outcome, run, shortest

ROOT = Path(__file__).resolve().parents[3]
PROBLEM = ROOT / "examples" / "rastrigin.toml"
SEEDS = 200
IN_A_BLOCK = 10


@pytest.mark.timeout(300)
@pytest.mark.parametrize("first", range(1, SEEDS + 1, IN_A_BLOCK))
def test_nothing_is_lost(file, first):
    for seed in range(first, first + IN_A_BLOCK):
        outcome = run(drawn(seed), file)
        assert not outcome.broken, in_words(outcome) + "\n" + "\n".join(outcome.log)


@pytest.mark.parametrize("seed", [3, 21, 44])  # a cluster of one zygote, one whose disk fails, and one of hosts
def test_the_same_seed_gives_the_same_events(file, seed):
    one, other = run(drawn(seed), file), run(drawn(seed), file)
    assert one.log == other.log
    assert one.digest == other.digest != run(replace(drawn(seed), seed=seed + 1000), file).digest


def test_a_job_that_waits_without_a_reason_is_noticed(file, monkeypatch):
    job = PlannedJob(0.0, "torus 2x2", "lockstep", seed=2, deme=1, generations=30, seconds=None)
    plan = Plan(1, "torus 2x2", (), (job,), (), latency=4e-3, work=1e-3, faults=())
    assert not run(plan, file).broken
    monkeypatch.setattr(invariants, "_WAITS", 0.01)  # seconds: to prepare four nodes takes longer
    assert run(plan, file).broken == ["job-0 is preparing, waits and has no running cells"]


def test_cells_of_a_job_that_began_again_elsewhere_end_once_their_host_is_back(file):
    """All hosts of the job are cut off as a coordinator takes over, and come back long before the job ends."""
    hosts = tuple(PlannedHost(0.1 * place, f"h{place}", 4, "") for place in range(2))
    job = PlannedJob(0.0, "torus 2x2", "lockstep", seed=2, deme=1, generations=1500, seconds=None)
    faults = (Fault(1.9, "part", "h0", 7.0, other="router"), Fault(2.0, "kill", "coordinator"))
    outcome = run(Plan(1, "torus 2x4", hosts, (job,), (), latency=0.004, work=0.01, faults=faults), file)
    assert any("all its hosts are out of reach" in line for line in outcome.log)
    assert not outcome.broken, in_words(outcome)


def test_cells_of_a_job_that_began_again_elsewhere_have_no_say_as_it_moves(file):
    """They are cut off as a coordinator takes over, come back, and are still there as the job is halted to move."""
    hosts = tuple(PlannedHost(0.3 + 0.2 * place, f"h{place}", 2, "") for place in (0, 1, 2))
    job = PlannedJob(0.0, "torus 2x2", "lockstep", seed=2, deme=1, generations=300, seconds=None)
    cut = tuple(Fault(1.2, "part", f"h{place}", 1.0, other="router") for place in (0, 1, 2))
    killed = Fault(1.5, "kill", "coordinator"), Fault(1.6, "stop", "router", 2.2)
    for leaves in ("h0", "h1", "h2"):
        faults = (*cut, *killed, Fault(7.5, "leave", leaves, 5.0))
        outcome = run(Plan(3, "torus 2x3", hosts, (job,), (), latency=1e-3, work=0.05, faults=faults), file)
        assert any("all its hosts are out of reach" in line for line in outcome.log)
        assert not outcome.broken, in_words(outcome)


@pytest.mark.parametrize("seed", [7, 10, 13, 18])
def test_a_job_begins_again_though_a_coordinator_died_that_had_begun_with_that(file, seed):
    """New processes are prepared to begin again, and the next coordinator must not take them for those of before."""
    hosts = tuple(PlannedHost(0.05 + 0.05 * place, f"h{place}", 4, "") for place in (0, 1))
    job = PlannedJob(0.0, "torus 2x2", "async", seed=3, deme=4, generations=300, seconds=None)
    faults = Fault(0.6, "kill", "h0", 5.0), Fault(2e-3, "kill", "coordinator", upon="look", count=3)
    outcome = run(Plan(seed, "torus 2x2", hosts, (job,), (), latency=4e-3, work=1e-2, faults=faults), file)
    assert "kill coordinator after look 3" in "\n".join(outcome.log)
    assert not outcome.broken, in_words(outcome)


@pytest.mark.parametrize("killed", [("coordinator",), ("coordinator", "node 2")])
@pytest.mark.parametrize("upon", [("halt", 1), ("prepare", 3), ("prepare", 4)])
def test_a_job_whose_coordinator_dies_as_it_moves_does_not_end_where_its_cells_were_halted(file, upon, killed):
    """The next coordinator learns it from their reports, and has nowhere to move them to: h2 and h3 are cut off."""
    hosts = tuple(PlannedHost(0.1 + 0.1 * place, f"h{place}", 2, "") for place in (0, 1, 2, 3))
    job = PlannedJob(0.0, "torus 2x2", "lockstep", seed=1, deme=4, generations=300, seconds=None)
    step, count = upon
    cut = (Fault(5e-3, "part", each, 2.0, other="router", upon=step, count=count) for each in ("h2", "h3"))
    deaths = (Fault(5e-3, "kill", whom, upon=step, count=count) for whom in killed)
    faults = (Fault(2.0, "leave", "h0", 2.0), *cut, *deaths)
    outcome = run(Plan(1, "torus 2x3", hosts, (job,), (), latency=1e-3, work=2e-2, faults=faults), file)
    log = "\n".join(outcome.log)
    assert f"kill coordinator after {step} {count}" in log
    assert "another epoch begins, since cells are halted" in log
    assert not outcome.broken, in_words(outcome)


def test_a_job_that_is_cancelled_as_it_moves_ends_though_one_of_its_nodes_does_not_answer(file):
    """As in an evaluation that does not end; the others are halted, and wait for that one to halt."""
    hosts = tuple(PlannedHost(0.1 + 0.1 * place, f"h{place}", 2, "") for place in (0, 1, 2))
    job = PlannedJob(0.0, "torus 2x2", "lockstep", seed=1, deme=4, generations=10**6, seconds=None)
    faults = Fault(1.9, "stop", "node 3", 200.0), Fault(2.0, "leave", "h0", 2.0)
    cancel = PlannedRequest(3.0, "cancel", 0)
    outcome = run(Plan(1, "torus 2x3", hosts, (job,), (cancel,), latency=1e-3, work=2e-2, faults=faults), file)
    (ended,) = (line for line in outcome.log if "client: job-0 is cancelled" in line)
    assert float(ended.split()[0]) < 100.0  # seconds: 60 from when h0 is gone


@pytest.mark.parametrize("seconds", [0.005, 0.012])
def test_a_job_that_was_given_up_before_it_began_ends_though_its_coordinator_dies(file, seconds):
    """The next coordinator takes it over: some nodes are prepared for it, and some have forgotten it already."""
    hosts = tuple(PlannedHost(0.1 + 0.1 * place, f"h{place}", 3, "") for place in (0, 1))
    job = PlannedJob(1.0, "torus 2x3", "lockstep", seed=2, deme=4, generations=340, seconds=1.8)
    away = Fault(1.03, "kill", "h0", 0.35), Fault(1.04, "stop", "node 5", 3.0)  # so that it is not prepared in time
    faults = (*away, Fault(seconds, "kill", "coordinator", upon="drop", count=1))
    outcome = run(Plan(1, "torus 2x3", hosts, (job,), (), latency=4e-3, work=1e-2, faults=faults), file)
    assert "client: job-0 is deadline" in "\n".join(outcome.log)
    assert not outcome.broken, in_words(outcome)


@pytest.mark.parametrize("seed", [2, 7, 8, 11])
def test_a_job_that_ends_without_a_judgement_has_the_answer_that_only_clients_were_told(file, seed):
    """No coordinator lived when they were told, and none of the job's nodes is left at its deadline."""
    job = PlannedJob(0.0, "torus 2x2", "lockstep", seed=3, deme=4, generations=640, seconds=4.2, target=80.0)
    deaths = [(0.15, "node 1"), (0.3, "node 3"), (1.5, "node 2"), (1.9, "node 0")]
    faults = (
        Fault(5e-3, "kill", "coordinator", upon="tell states", count=1),
        *(Fault(at, "kill", whom) for at, whom in deaths),
        Fault(0.6, "part", "router", 4.6, other="node 0"),
    )
    outcome = run(Plan(seed, "torus 2x3", (), (job,), (), latency=4e-3, work=1e-4, faults=faults), file)
    assert "client: job-0 is deadline" in "\n".join(outcome.log)
    assert not outcome.broken, in_words(outcome)


def test_cells_that_breed_on_where_all_that_they_send_is_held_back_are_no_second_ones(file):
    """The router dies with what it was told of them, so a new coordinator lets the job begin again elsewhere."""
    hosts = tuple(PlannedHost(0.3 + 0.2 * place, f"h{place}", 4, "") for place in (0, 1))
    job = PlannedJob(0.0, "torus 2x2", "lockstep", seed=2, deme=1, generations=300, seconds=None)
    killed = Fault(1.25, "kill", "coordinator"), Fault(1.5, "kill", "router")
    faults = (Fault(1.2, "hold", "h0", 6.0, other="router"), *killed)
    outcome = run(Plan(1, "torus 2x2", hosts, (job,), (), latency=4e-3, work=1e-2, faults=faults), file)
    assert any("all its hosts are out of reach" in line for line in outcome.log)
    assert not outcome.broken, in_words(outcome)


def test_an_answer_to_the_function_before_an_update_is_none_to_that_after_it(file):
    """The spy dies with what it has told, and the job ends before it has told anything of the other function."""
    job = PlannedJob(0.0, "torus 2x2", "lockstep", seed=0, deme=4, generations=652, seconds=None)
    updates = tuple(PlannedRequest(at, "update", 0, to) for at, to in ((3.355, "sphere"), (5.198, "rastrigin")))
    faults = tuple(Fault(5e-3, "kill", whom, upon="tell states", count=3) for whom in ("spy", "coordinator"))
    outcome = run(Plan(2, "torus 2x2", (), (job,), updates, latency=4e-3, work=1e-4, faults=faults), file)
    assert "'epoch': 2" in "\n".join(outcome.log)
    assert not outcome.broken, in_words(outcome)


def test_another_process_gives_the_same_events_wherever_the_problem_is(capsys, tmp_path):
    elsewhere = shutil.copy(PROBLEM, tmp_path)
    commands = [
        [sys.executable, "-m", "supernode", "chaos", each, "--simulate", "--draw", "3", "--json"]
        for each in (PROBLEM, elsewhere)
    ]
    told = [subprocess.run(command, capture_output=True, text=True, check=True).stdout for command in commands]
    code, out, _ = in_process(capsys, "chaos", PROBLEM, "--simulate", "--draw", "3", "--json")
    assert told == [out, out]
    outcome = json.loads(out)
    assert (code, outcome["lost"], outcome["seed"]) == (0, [], 3)
    assert [each["at"] for each in outcome["faults"]] == sorted(each["at"] for each in outcome["faults"])


def test_a_command_shows_the_events_and_counts_trials(capsys):
    code, out, _ = in_process(capsys, "chaos", PROBLEM, "--simulate", "--draw", "3", "--trials", "2", "--events")
    assert code == 0
    assert "client: job-0 is accepted" in out
    assert out.endswith("2 trials, something was lost in 0\n")


BUGS = ("reports that a dead router", "a coordinator that takes over takes all nodes", "a node that does not answer")


@pytest.mark.parametrize("bug", planted_bugs.BUGS, ids=lambda bug: bug.name)
def test_every_bug_can_be_planted(bug):
    source = ROOT.joinpath(*bug.module.split(".")).with_suffix(".py").read_text()
    assert source.count(bug.old) == 1


@pytest.mark.parametrize("name", BUGS)
def test_a_planted_bug_is_found(name):
    command = [sys.executable, "-m", "benchmarks.planted_bugs", "--only", name, "--most", "300"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    assert "1 of 1 bugs found" in done.stdout


def test_a_way_to_a_failure_is_shortened(file, monkeypatch):
    """Whatever kills node 1 counts as broken here, so the shortest way is one fault."""
    plan = drawn(3)
    faults = tuple(sorted((*plan.faults, Fault(1.0, "kill", "node 1")), key=lambda fault: fault.at))

    def breaks(plan, file):
        return Outcome(plan, broken=[str(fault) for fault in plan.faults if str(fault) == "kill node 1"] + ["x"] * 3)

    monkeypatch.setattr("supernode.chaos.simulated.trial.run", breaks)
    plan = replace(plan, faults=faults)
    found = shortest(Outcome(plan, broken=["kill node 7"]), file)
    assert [str(fault) for fault in found.plan.faults] == ["kill node 1"]


def test_a_trial_that_breaks_something_says_how_to_get_there(file, monkeypatch):
    def breaks(plan, file):
        return Outcome(plan, broken=["the sky falls"])

    monkeypatch.setattr("supernode.chaos.simulated.campaign.run", breaks)
    monkeypatch.setattr("supernode.chaos.simulated.trial.run", breaks)
    told = in_words(trial(file, 3))
    assert "broken: the sky falls" in told
    assert "submit {'topology': " in told
    assert "the shortest way there, 0 faults" in told


def test_users_own_problems_are_refused(capsys):
    code, _, told = in_process(capsys, "chaos", ROOT / "examples" / "inspection_tour.py", "--simulate")
    assert code == 2
    assert "Traceback" not in told
