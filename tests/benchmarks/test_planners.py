"""The benchmark of the planners: its runs, its rivals' collision test, and what it says of both."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import evaluations
from benchmarks.planners import arm_ik, mobile_robot, ompl_run, ompl_se2
from benchmarks.planners.__main__ import with_section
from benchmarks.planners.runs import on_all_cores, run, share
from benchmarks.robot_worlds import robot_world
from node.plan import Plan
from node.simulation import simulate
from problems import load, registry
from problems.arm_ik.oracle import enumerate_best
from problems.mobile_robot.checker import objection_to

OFFICE = Path(__file__).resolve().parents[2] / "examples" / "mobile-robot.toml"


def test_a_run_is_what_the_simulator_finds():
    file = robot_world(1)
    outcome = run(file, seed=3, stall=20)
    plan = Plan.of(file.with_run(seed=3, stall=20))
    reports = simulate(plan)
    assert (outcome.status, outcome.feasible, outcome.fitness) == ("solved", True, 0.0)
    assert outcome.generations == reports[0].generation
    assert outcome.evaluations == sum(report.evaluations for report in reports)
    assert 16 <= outcome.found_after <= outcome.evaluations
    assert plan.problem.check(outcome.solution).feasible


def test_a_problem_of_ones_own_may_be_run_too():
    problem = arm_ik.arm_world(1)
    optimum, _ = enumerate_best(problem)
    outcome = run(problem, seed=1, topology="torus 8x8", target=optimum + 1e-9)
    assert outcome.status == "solved"
    assert outcome.fitness == pytest.approx(optimum, abs=1e-9)


def test_tasks_are_done_in_order_on_all_cores():
    assert list(on_all_cores(abs, range(-5, 5))) == [5, 4, 3, 2, 1, 0, 1, 2, 3, 4]


def test_a_share_in_words():
    assert share([True, False, True, True]) == "3 of 4 (75.0 %)"
    assert share([]) == "0 of 0 (0.0 %)"


def test_distinct_genomes_are_counted_once_up_to_the_optimum():
    optimum = enumerate_best(arm_ik.arm_world(2))[0] + 1e-9
    trial = arm_ik._trial(arm_ik.ENTRIES[0], 2, optimum)
    assert trial.found
    assert 64 < trial.distinct < trial.total
    assert (trial.total - 64) % (64 * 8) == 0, "whole generations"


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_the_rivals_collision_test_is_that_of_the_check(number):
    problem = robot_world(number).problem()
    is_free = ompl_se2._validity(problem)
    x0, y0, x1, y1 = problem.bounds
    poses = np.random.default_rng(number).uniform([x0, y0, -np.pi], [x1, y1, np.pi], (300, 3))
    verdicts = []
    for x, y, heading in poses.tolist():
        state = SimpleNamespace(getX=lambda x=x: x, getY=lambda y=y: y, getYaw=lambda heading=heading: heading)
        verdicts.append(is_free(state))
        assert verdicts[-1] == (objection_to(problem, (x, y, heading)) is None)
    assert 30 < sum(verdicts) < 270


@pytest.mark.parametrize("planner", ompl_run.PLANNERS)
def test_a_rival_finds_a_way_that_is_no_shorter_than_the_shortest(planner, monkeypatch):
    pytest.importorskip("ompl", reason="an extra")
    monkeypatch.setattr(ompl_se2, "LIMITS", ompl_se2.LIMITS._replace(improving=0.1))
    problem = robot_world(2).problem()
    way = ompl_se2.plan(problem, planner, seed=1)
    assert 0.0 < way.seconds < ompl_se2.LIMITS.finding
    assert way.length >= problem.oracle().figures["shortest_length_at_least"]


def test_a_hard_floor_is_one_that_nobody_solves_by_chance():
    assert mobile_robot._is_hard(load(OFFICE))
    assert not mobile_robot._is_hard(robot_world(1))


def test_evaluations_are_measured_of_every_kind():
    files = list(evaluations.files())
    assert {file.kind for file in files} == set(registry.kinds())
    assert "mobile-robot-disc.toml" in {file.name for file in files}
    assert evaluations.rate(Plan.of(files[0]), 8, 0.01) > 1000


def test_a_part_of_the_page_takes_the_place_of_the_old_one():
    page = with_section("", "terrain", "## terrain\n\nold")
    page = with_section(page, "arm-ik", "## arm-ik\n\nfirst")
    page = with_section(page, "terrain", "## terrain\n\nnew")
    head, *parts = page.split("\n\n## ")
    assert head.startswith("# How good")
    assert parts == ["arm-ik\n\nfirst", "terrain\n\nnew\n"]
    assert with_section(page, "arm-ik", "## arm-ik\n\nfirst") == page
