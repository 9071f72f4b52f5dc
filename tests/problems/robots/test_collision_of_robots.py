"""The verdicts about robots among MotionBenchMaker's obstacles, beside coal's on the exact meshes."""

import numpy as np
import pytest

from benchmarks.motion_bench import DATA, problems, scene_of
from benchmarks.robot_collisions import Coal
from problems.robots.collision import Collisions

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="needs ../shared/data")
CASES = [(robot, family) for robot in ("panda", "ur5") for family in ("bookshelf_tall", "cage", "table_pick")]


@pytest.fixture(scope="module", params=CASES, ids=str)
def case(request):
    pytest.importorskip("pinocchio")
    robot, family = request.param
    problem = next(problems(robot, 1, (family,)))
    scene = scene_of(problem)
    return problem, scene, Collisions(scene), Coal(problem)


def test_no_configuration_is_called_free_that_touches(case):
    _, scene, collisions, coal = case
    low, high = scene.arm.limits.T
    qs = np.random.default_rng(1).uniform(low, high, (700, len(low)))
    free = collisions.are_free(qs)
    touches = np.array([coal.touches(q) for q in qs])
    assert not (free & touches).any()
    assert (~free & ~touches).mean() < 0.01
    assert 0.2 < free.mean() < 0.95


def test_start_and_goal_are_free(case):
    problem, _, collisions, _ = case
    assert collisions.is_free(problem.start)
    assert collisions.is_free(problem.goal)


def test_a_motion_called_free_touches_nothing(case):
    problem, scene, collisions, coal = case
    low, high = scene.arm.limits.T
    rng = np.random.default_rng(2)
    starts = np.repeat([problem.start, problem.goal], 40, axis=0)
    ends = np.clip(starts + rng.normal(size=starts.shape) * 0.3, low, high)
    free = collisions.are_ways_free(starts, ends)
    assert (free == collisions.are_ways_free(ends, starts)).all()
    assert free.any()
    for a, b in list(zip(starts[free], ends[free], strict=True))[:2]:
        assert not any(coal.touches(a + share * (b - a)) for share in np.linspace(0, 1, 1000))
