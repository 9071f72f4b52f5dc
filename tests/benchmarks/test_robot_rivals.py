import importlib.util
import math
import time

import numpy as np
import pytest
from jointed_robots import file_of, problem_of

from benchmarks import robot_own_checks, robot_rivals, robots
from benchmarks.robot_outcomes import HEAD, MOMENTS, Outcome, head, row
from benchmarks.robot_rivals import Search, solver_of

STRAIGHT = {"obstacles": []}
SECONDS = 0.3


@pytest.mark.parametrize("name", ["RRTConnect", "AORRTC", "BITstar"])
def test_a_rival_finds_a_proven_path_around_a_wall(name):
    pytest.importorskip("ompl", reason="an extra")
    file = file_of()
    outcome = solver_of(name)(file, SECONDS)
    assert outcome.first < 1.0, outcome.message
    problem = file.problem(checked=True)
    straight = float(np.linalg.norm(np.subtract(problem.start, problem.goal)))
    assert straight < outcome.length_at(math.inf) < 10.0
    assert outcome.cpu > 0.0


@pytest.mark.parametrize("name", ["RRTConnect", "AORRTC", "BITstar"])
def test_a_rival_finds_the_straight_line(name):
    pytest.importorskip("ompl", reason="an extra")
    file = file_of(**STRAIGHT)
    outcome = solver_of(name)(file, 0.1)
    straight = float(np.linalg.norm(np.subtract(file.fields["start"], file.fields["goal"])))
    assert outcome.length_at(math.inf) == pytest.approx(straight), outcome.message


def test_a_rival_that_is_not_installed_is_named_before_anything_runs(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ModuleNotFoundError, match="AORRTC: expected the package ompl; pip install ompl"):
        solver_of("AORRTC")


def test_a_rival_that_stops_early_says_why():
    pytest.importorskip("ompl", reason="an extra")
    blocked = file_of()
    blocked.fields["start"] = [0.0, 0.0, 0.0]  # in the wall; `load` would have refused it
    for name in ("RRTConnect", "AORRTC", "BITstar"):
        outcome = solver_of(name)(blocked, SECONDS)
        assert outcome.found == []
        assert outcome.message.startswith(f"{name}: it stopped with ")


def test_a_rival_may_fail():
    def rival(problem, folder, seed):
        raise ValueError("no such joint")

    outcome = _solve_by(rival)
    assert (outcome.found, outcome.proven, outcome.message) == ([], False, "mplib: no such joint")


def _solve_by(rival, **options):
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(robot_rivals.RIVALS, "mplib", rival)
        return solver_of("mplib", **options)(file_of(), SECONDS)


def test_a_path_counts_once_it_is_proven():
    problem = problem_of()
    blocked, around = [problem.start, problem.goal], [problem.start, [-0.9, -1.5, 0.3], [0.9, -1.5, 0.0], problem.goal]
    search = Search(problem, 10.0)
    search.offer(blocked)
    assert not search.has_proven
    search.offer(around)
    assert search.has_proven
    outcome = search.outcome()
    assert [proven for _, _, proven in outcome.found] == [False, True]
    assert outcome.first == outcome.found[1][0]
    assert not outcome.proven  # as the shortest is blocked
    assert outcome.message.startswith("1 of 2 paths fail the proof, one on segment ")
    assert outcome.length_at(math.inf) == pytest.approx(3.0 + np.hypot(1.8, 0.3) + 0.2, abs=0.3)


def test_what_is_found_too_late_does_not_count():
    problem = problem_of(**STRAIGHT)
    search = Search(problem, 1e-9)
    search.offer([problem.start, problem.goal])
    assert search.is_over
    assert search.outcome().first == math.inf


def test_a_clock_of_processor_time_counts_what_other_processes_use():
    search = Search(problem_of(), 10.0, by_cpu=True)
    search.cpu_elsewhere = 4.0
    assert 4.0 <= search.now < 5.0
    assert 5.0 < search.left <= 6.0
    assert Search(problem_of(), 10.0).now < 1.0 < time.monotonic()


def test_moments_are_stretched_for_a_rival_with_more_processor_time():
    outcome = Outcome([(0.5, 9.0, True), (1.5, 8.0, True), (1.6, 7.0, False)], True, pace=2.0)
    assert math.isnan(outcome.length_at(0.1))
    assert outcome.length_at(0.5) == 9.0
    assert outcome.length_at(1.0) == 8.0


def test_a_path_of_ours_must_be_in_time_too():
    outcome = Outcome([(1.06, 4.0, True)], True, until=1.05)
    assert outcome.first == math.inf
    assert math.isnan(outcome.length_at(5.0))


def test_a_row_compares_with_the_problems_that_both_solved():
    own = [Outcome([(1.0, 4.0, True)], True), Outcome([(0.5, 9.0, True)], True), Outcome(message="refused: start")]
    other = [Outcome([(2.0, 5.0, True)], True), Outcome(), Outcome(message="refused: start")]
    line = row("ours", own, other).split()
    assert line[:5] == ["ours", "2", "1", "2", "2"]
    assert line[-3:] == ["1", "0.500", "0.800"]
    assert row("theirs", other[1:], own[1:]).split()[-3:] == ["0", "–", "–"]


def test_head_and_rows_have_the_same_columns():
    assert {len(line) for line in HEAD.split("\n")} == {len(row("x", [Outcome()]))}
    assert {len(line) for line in head("RRTConnect").split("\n")} == {len(row("x", [Outcome()], [Outcome()]))}
    assert all(f"at {moment:g} s" in HEAD for moment in MOMENTS)


def test_values_that_are_beyond_a_limit_by_rounding_are_put_on_it():
    limits = {"turn": (-3.14159, 3.14159), "bend": (-1.0, 2.0)}
    put = robots.put_within(limits, ["bend", "turn", "spin"], [2.1, -3.1415926535, 9.0])
    assert put == [2.1, -3.14159, 9.0]


def test_only_what_no_joint_moves_may_touch_obstacles():
    problem = problem_of()
    assert robot_own_checks._standing(problem.robot.urdf, list(problem.scene.arm.joints)) == ["post"]
    assert robot_own_checks._standing(problem.robot.urdf, ["joint_2", "joint_3"]) == ["post", "bar_1"]
