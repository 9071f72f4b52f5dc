"""The paper recipe of robot-path: Ariadne's clew."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jointed_robots import file_of

from genetics import Keys
from node.plan import Plan
from node.simulation import simulate
from problems import Run
from problems.robot_path import checker
from problems.robot_path.clew import MOST_LANDMARKS, ROUNDS

PAPER = Run(topology="torus 2x2", recipe="paper", generations=40, seed=3)


@pytest.fixture(scope="module")
def plan():
    return Plan.of(file_of(PAPER))


def keys_of(seed, generation):
    return Keys(np.arange(1), np.uint64(seed), generation)


def lived(plan, generations, seed=1):
    """The offspring of some individuals after so many generations among themselves."""
    genomes = plan.coding.random(keys_of(seed, 0), 6)
    for generation in range(1, generations + 1):
        couples = np.stack([genomes[0], np.roll(genomes[0], 1, axis=0)], axis=1)[None].copy()
        genomes = plan.coding.recombine(couples, plan.recipe, keys_of(seed, generation))[:, ::2].copy()
    return genomes[0]


def test_clews_grow_where_exploration_ends(plan):
    counts = [{len(plan.coding.items(each)) for each in lived(plan, generations)} for generations in (7, 8, 24)]
    assert counts[0] == {ROUNDS}
    assert max(counts[1]) > ROUNDS
    assert max(counts[2]) > max(counts[1])


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 30))
def test_individuals_are_sound(plan, seed, generations):
    assert all(plan.coding.alphabet.admits(each) for each in lived(plan, generations, seed))


def test_no_clew_is_too_long(plan):
    assert max(len(plan.coding.items(each)) for each in lived(plan, 400)) == MOST_LANDMARKS + ROUNDS


def test_all_but_the_last_segment_is_free(plan):
    """Ways to landmarks, and motions that are cut at the first contact; the last segment leads to the goal."""
    for genome in lived(plan, 30):
        path = plan.problem.decode(genome)["path"]
        assert len(path) > 2
        assert checker.objections_to(plan.problem, path[:-1]) == ()


def test_a_path_of_moves_of_one_joint_is_found():
    best = min(
        (report.champion for report in simulate(Plan.of(file_of(PAPER))) if report.champion is not None),
        key=lambda champion: champion.fitness,
    )
    assert best.fitness < 1000.0
    problem = file_of(PAPER).problem()
    solution = problem.decode(np.frombuffer(best.genome, np.uint8).copy())
    steps = np.diff(np.array(solution["path"]), axis=0)
    assert (np.count_nonzero(steps, axis=1) == 1).all()
    verdict = problem.check(solution)
    assert verdict.objections == ()
    assert verdict.fitness == pytest.approx(best.fitness)
